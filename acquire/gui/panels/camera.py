"""The camera's picture, its contour, and the threshold of the contour."""

from __future__ import annotations

import math

import pyqtgraph as pg
from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QCheckBox, QHBoxLayout, QLabel, QSlider, QVBoxLayout, QWidget

from acquire.gui import theme
from acquire.gui.fresh import Reading
from acquire.gui.messages import LIVE, Picture, View
from acquire.gui.plots import plot

CONTOUR = "#ffd400"  # seen on black and on white
APEX = "apex_height"  # the channel: how far the apex has risen above the tissue at rest
FIXED = "The threshold belongs to the run: it can be changed again when the run is over. The pictures are kept raw."
FREE = "Grey value between tissue and background. It is the recording's too."


class CameraPanel(QWidget):
    """The live picture. ``threshold`` tells the grey-value threshold that is wanted, None for the proposed one."""

    threshold = Signal(object)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.plot = plot("", "")
        for side in ("left", "bottom"):
            self.plot.hideAxis(side)
        self.plot.showGrid(x=False, y=False)
        self.plot.setAspectLocked(True)
        self.plot.invertY(True)
        self.image = pg.ImageItem(axisOrder="row-major", levels=(0, 255))
        self.outline = pg.PlotCurveItem(pen=pg.mkPen(CONTOUR, width=1))
        self.plot.addItem(self.image)
        self.plot.addItem(self.outline)
        self.apex = QLabel("apex –")
        self.apex.setProperty("role", "number")
        self.apex.setToolTip("Apex height: how far the apex has risen above the tissue at rest")
        self.quality = QLabel("no picture yet")
        self.quality.setProperty("role", "faint")
        self.quality.setWordWrap(True)
        self.proposed = QCheckBox("proposed")
        self.proposed.setChecked(True)
        self.slider = QSlider(Qt.Orientation.Horizontal)
        self.slider.setRange(1, 254)
        self.slider.setValue(128)
        self.value = QLabel("128")
        self.value.setMinimumWidth(36)
        self.proposed.toggled.connect(self._changed)
        self.slider.valueChanged.connect(self._changed)
        self.row = QWidget()
        row = QHBoxLayout(self.row)
        row.setContentsMargins(0, 0, 0, 0)
        row.addWidget(QLabel("Threshold"))
        row.addWidget(self.slider, 1)
        row.addWidget(self.value)
        row.addWidget(self.proposed)
        column = QVBoxLayout(self)
        column.addWidget(self.apex)
        column.addWidget(self.quality)
        column.addWidget(self.plot, 1)
        column.addWidget(self.row)
        self._shape = (0, 0)
        self._height = Reading()
        self.lock(False)

    @property
    def gvt(self) -> float | None:
        """The threshold set by hand; None for the proposed one."""
        return None if self.proposed.isChecked() else float(self.slider.value())

    def lock(self, running: bool) -> None:
        """Whether a run goes on: its threshold is the plan's."""
        self.row.setEnabled(not running)
        self.row.setToolTip(FIXED if running else FREE)
        self.slider.setEnabled(not running and not self.proposed.isChecked())

    def show_view(self, view: View, drawn: bool) -> None:
        """The newest picture and apex."""
        if (view.state in LIVE) == self.row.isEnabled():
            self.lock(view.state in LIVE)
        if APEX in view.latest:
            self._height.take(view.latest[APEX])
        if view.picture is not None and drawn:
            self._draw(view.picture)

    def tell(self) -> None:
        """The apex in large type, grey where it is past or none is found."""
        reading, age = self._height, self._height.age
        text = f"apex {1e3 * reading.value:z.3f} mm" if reading.known else "apex –  no contour"
        faint = bool(age) or not reading.known
        _tell(self.apex, f"{text}  · {age}" if age else text, f"color: {theme.current().faint}" if faint else "")

    def _draw(self, picture: Picture) -> None:
        if picture.image.shape != self._shape:
            self._shape = picture.image.shape
            height, width = self._shape
            self.plot.setRange(xRange=(0, width), yRange=(0, height), padding=0)
        self.image.setImage(picture.image, autoLevels=False)
        self.outline.setData(picture.outline[:, 0] + 0.5, picture.outline[:, 1] + 0.5)
        if self.proposed.isChecked() and math.isfinite(picture.gvt):
            self.slider.blockSignals(True)
            self.slider.setValue(round(picture.gvt))
            self.slider.blockSignals(False)
            self.value.setText(f"{picture.gvt:.0f}")
        sure = f"confidence {picture.confidence:.2f}" if math.isfinite(picture.confidence) else "no contour"
        notes = "".join(f" · {flag.replace('_', ' ')}" for flag in picture.flags)
        _tell(self.quality, f"above the tissue at rest · contour at grey {picture.gvt:.0f}, {sure}{notes}")

    def _changed(self) -> None:
        self.slider.setEnabled(not self.proposed.isChecked())
        self.value.setText(str(self.slider.value()))
        self.threshold.emit(self.gvt)


def _tell(label: QLabel, text: str, style: str = "") -> None:
    """A label lays itself out anew at every change: only where it says something else."""
    if label.text() != text:
        label.setText(text)
    if label.styleSheet() != style:
        label.setStyleSheet(style)
