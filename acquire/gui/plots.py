"""Plots as this window wants them: fixed ranges, thin pens, no menus, nothing that costs time while running."""

from __future__ import annotations

from typing import Any

import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtGui import QFont, QFontMetrics

from acquire.gui.theme import Theme, current


class TitledAxis(pg.AxisItem):  # type: ignore[misc]
    """An axis whose title is never cut: where there is no room for it its unit alone stands there, or nothing."""

    _titles: tuple[str, ...] = ()

    def title(self, words: str, unit: str = "") -> None:
        """``words (unit)`` where there is room, ``unit`` where there is less."""
        whole = f"{words} ({unit})" if words and unit else words or unit
        self._titles = tuple(dict.fromkeys(text for text in (whole, unit) if text))
        self._fit()

    def resizeEvent(self, event: Any = None) -> None:
        """Qt's hook: another size."""
        super().resizeEvent(event)
        self._fit()

    def _fit(self) -> None:
        if not self._titles:
            return
        size, metrics = self.size(), QFontMetrics(self.label.font() if self.label is not None else QFont())
        room = size.height() if self.orientation == "left" else size.width()
        text = next((text for text in self._titles if metrics.horizontalAdvance(text) <= room), "")
        if text != self.labelText:
            self.setLabel(text)
            super().resizeEvent(None)  # in the middle again


def plot(bottom: str, unit: str = "", left: str = "", scale: str = "") -> pg.PlotWidget:
    """A plot in the present theme, without automatic ranges. ``unit`` is that of ``bottom``, ``scale`` of ``left``."""
    widget = pg.PlotWidget(axisItems={side: TitledAxis(side) for side in ("left", "bottom")})
    widget.setMenuEnabled(False)
    widget.hideButtons()
    widget.setMouseEnabled(x=False, y=False)
    widget.getAxis("bottom").title(bottom, unit)
    widget.getAxis("left").title(left, scale)
    widget.getAxis("left").setWidth(round(4.4 * QFontMetrics(QFont()).height()) if left else None)
    for side in ("left", "bottom"):
        widget.getAxis(side).enableAutoSIPrefix(False)
    widget.showGrid(x=True, y=True, alpha=0.2)
    dress(widget, current())
    return widget


def dress(widget: pg.PlotWidget, theme: Theme) -> None:
    """Put a plot into a theme's colours."""
    widget.setBackground(theme.base)
    for side in ("left", "bottom"):
        widget.getAxis(side).setPen(theme.faint)
        widget.getAxis(side).setTextPen(theme.text)


def limit_line(value: float, theme: Theme) -> pg.InfiniteLine:
    """A dashed line where a limit is."""
    return pg.InfiniteLine(value, angle=0, pen=pg.mkPen(theme.limit, width=1, style=Qt.PenStyle.DashLine))
