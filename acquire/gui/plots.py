"""Plots as this window wants them: fixed ranges, thin pens, no menus, nothing that costs time while running."""

from __future__ import annotations

import pyqtgraph as pg
from PySide6.QtCore import Qt

from acquire.gui.theme import Theme, current


def plot(bottom: str, unit: str = "", left: str = "") -> pg.PlotWidget:
    """A plot in the present theme, without automatic ranges."""
    widget = pg.PlotWidget()
    widget.setMenuEnabled(False)
    widget.hideButtons()
    widget.setMouseEnabled(x=False, y=False)
    widget.getAxis("bottom").setLabel(f"{bottom} ({unit})" if unit else bottom)
    if left:
        widget.getAxis("left").setLabel(left)
    widget.getAxis("left").setWidth(64)
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
