"""Where the probe is: its path in three projections, the force on it, and how far it may go."""

from __future__ import annotations

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QGridLayout, QLabel, QWidget

from acquire.gui.fresh import Reading
from acquire.gui.messages import PATH, Preview, View
from acquire.gui.plots import plot
from acquire.gui.theme import current

REACH = 3e-3  # m, the hardware's excursion (assumed), where no protocol says less
KEPT = 800  # points of the path
EVERY = 2  # views between two paintings: fifteen per second are enough for the eye here
#: Horizontal and vertical axis of each projection, and from where it looks.
PROJECTIONS = ((0, 1, "from above"), (0, 2, "from the front"), (1, 2, "from the side"))


class Projection:
    """One of the three views."""

    def __init__(self, across: int, up: int, seen: str) -> None:
        self.across, self.up = across, up
        theme = current()
        self.plot = plot("xyz"[across], "mm", "xyz"[up], "mm")
        self.plot.setTitle(seen, size="10pt", color=theme.faint)
        self.plot.setAspectLocked(True)
        self.plot.getAxis("left").setWidth(52)
        self.border = self._curve(theme.limit, Qt.PenStyle.DashLine)
        self.path = self._curve(theme.curves[0])
        self.force = self._curve(theme.curves[1])
        self.tip = pg.ScatterPlotItem(size=9, pen=None, brush=theme.curves[0])
        self.plot.addItem(self.tip)

    def _curve(self, colour: str, style: Qt.PenStyle = Qt.PenStyle.SolidLine) -> pg.PlotCurveItem:
        curve = pg.PlotCurveItem(pen=pg.mkPen(colour, width=1, style=style))
        self.plot.addItem(curve)
        return curve

    def limit(self, radius: float) -> None:
        """Draw the border of the workspace, ``radius`` in m: the sphere seen as a circle."""
        angle = np.linspace(0, 2 * np.pi, 90)
        self.border.setData(1e3 * radius * np.cos(angle), 1e3 * radius * np.sin(angle))
        reach = 1.1e3 * radius
        self.plot.setRange(xRange=(-reach, reach), yRange=(-reach, reach), padding=0)

    def draw(self, path: np.ndarray, length: float) -> None:
        """Path (n, 6) of position in m and force in N; ``length`` is mm on the screen for one N."""
        position = 1e3 * path[:, [self.across, self.up]]
        self.path.setData(position[:, 0], position[:, 1])
        tip, force = position[-1], path[-1, [3 + self.across, 3 + self.up]]
        self.tip.setData([tip[0]], [tip[1]])
        self.force.setData(*np.column_stack(_arrow(tip, tip + length * force)))


def _arrow(begin: np.ndarray, end: np.ndarray) -> list[np.ndarray]:
    """The points of an arrow from ``begin`` to ``end``."""
    way = end - begin
    across = np.array([-way[1], way[0]])
    return [begin, end, end - 0.2 * way + 0.1 * across, end, end - 0.2 * way - 0.1 * across]


class RobotPanel(QWidget):
    """Three projections and the numbers."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.projections = [Projection(*axes) for axes in PROJECTIONS]
        self.numbers = QLabel("")
        self.numbers.setTextFormat(Qt.TextFormat.RichText)
        self.numbers.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self.numbers.setMinimumWidth(1)
        self.numbers.setWordWrap(True)
        grid = QGridLayout(self)
        for projection, cell in zip(self.projections, ((0, 0), (1, 0), (1, 1)), strict=True):
            grid.addWidget(projection.plot, *cell)
        grid.addWidget(self.numbers, 0, 1)
        for line in (0, 1):
            grid.setColumnStretch(line, 1)
            grid.setRowStretch(line, 1)
        self._path = np.empty((0, 6))
        self._run = 0
        self._most = 0.1  # N, the greatest force of this run
        self._frames = 0
        self._newest = np.full(6, np.nan)
        self._reading = Reading()
        self._told = ""
        self.expect(None)

    def expect(self, preview: Preview | None) -> None:
        """The limits of the next run."""
        radius = preview.limits.get("probe", (0.0, REACH))[1] if preview is not None else REACH
        self.radius = radius if np.isfinite(radius) else REACH
        for projection in self.projections:
            projection.limit(self.radius)

    def show_view(self, view: View, drawn: bool) -> None:
        """New positions and forces."""
        if view.run != self._run:
            self._run, self._path, self._most = view.run, np.empty((0, 6)), 0.1
        if view.path is None:
            return
        self._path = np.concatenate([self._path, view.path])[-KEPT:]
        self._most = max(self._most, float(np.linalg.norm(view.path[:, 3:], axis=1).max()))
        if all(name in view.latest for name in PATH):
            self._newest = np.array([view.latest[name] for name in PATH])
            self._reading.take(float(self._newest[0]))
        self._frames += 1
        if not drawn or self._frames % EVERY:
            return
        length = 0.8e3 * self.radius / self._most
        for projection in self.projections:
            projection.draw(self._path, length)

    def tell(self) -> None:
        """How far the probe is from its centre and how strong the force is; grey and with their age where past."""
        if not self._reading.known:
            return
        theme, age = current(), self._reading.age
        colours = (theme.faint, theme.faint) if age else theme.curves[:2]
        way, strength = 1e3 * float(np.linalg.norm(self._newest[:3])), float(np.linalg.norm(self._newest[3:]))
        text = (
            f'<p style="font-size:19pt; font-weight:600; color:{colours[0]}">{way:.3f} mm</p><p>from the centre</p>'
            f'<p style="font-size:19pt; font-weight:600; color:{colours[1]}">{strength:.3f} N</p>'
            f'<p style="color:{theme.limit}">border {1e3 * self.radius:.1f} mm</p>'
            f'<p style="color:{theme.faint}">{age}</p>'
        )
        if text != self._told:
            self._told = text
            self.numbers.setText(text)
