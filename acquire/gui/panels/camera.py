"""What the camera sees, the contour found in it, and the threshold that the contour is found at."""

from __future__ import annotations

import math

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QCheckBox, QHBoxLayout, QLabel, QSlider, QVBoxLayout, QWidget

from acquire.gui.messages import View
from acquire.gui.plots import plot

CONTOUR = "#ffd400"  # seen on black and on white


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
        self.quality = QLabel("no picture yet")
        self.quality.setProperty("role", "faint")
        self.proposed = QCheckBox("proposed")
        self.proposed.setChecked(True)
        self.slider = QSlider(Qt.Orientation.Horizontal)
        self.slider.setRange(1, 254)
        self.slider.setValue(128)
        self.value = QLabel("128")
        self.value.setMinimumWidth(36)
        self.proposed.toggled.connect(self._changed)
        self.slider.valueChanged.connect(self._changed)
        row = QHBoxLayout()
        row.addWidget(QLabel("Threshold"))
        row.addWidget(self.slider, 1)
        row.addWidget(self.value)
        row.addWidget(self.proposed)
        column = QVBoxLayout(self)
        column.addWidget(self.apex)
        column.addWidget(self.plot, 1)
        column.addWidget(self.quality)
        column.addLayout(row)
        self.slider.setEnabled(False)
        self._shape = (0, 0)
        self._zero = math.nan

    @property
    def gvt(self) -> float | None:
        """The threshold set by hand; None for the proposed one."""
        return None if self.proposed.isChecked() else float(self.slider.value())

    def show_view(self, view: View, drawn: bool) -> None:
        """The newest picture."""
        picture = view.picture
        if picture is None or not drawn:
            return
        if picture.image.shape != self._shape:
            self._shape = picture.image.shape
            height, width = self._shape
            self.plot.setRange(xRange=(0, width), yRange=(0, height), padding=0)
        self.image.setImage(picture.image, autoLevels=False)
        outline = picture.outline if len(picture.outline) else np.empty((0, 2))
        self.outline.setData(outline[:, 0] + 0.5, outline[:, 1] + 0.5)
        _, heights = view.points.get("apex_height", (np.empty(0), np.empty(0)))
        heights = heights[np.isfinite(heights)]
        risen = f"{1e3 * heights[-1]:.2f} mm" if len(heights) else "–"
        self._tell(self.apex, f"apex {risen}")
        if self.proposed.isChecked() and math.isfinite(picture.gvt):
            self.slider.blockSignals(True)
            self.slider.setValue(round(picture.gvt))
            self.slider.blockSignals(False)
            self.value.setText(f"{picture.gvt:.0f}")
        above = f"{1e3 * picture.height:.2f} mm above the foot" if math.isfinite(picture.height) else "no contour"
        notes = f" · {', '.join(flag.replace('_', ' ') for flag in picture.flags)}" if picture.flags else ""
        self._tell(self.quality, f"{above} · confidence {picture.confidence:.2f}{notes}")

    def _tell(self, label: QLabel, text: str) -> None:
        if label.text() != text:
            label.setText(text)

    def _changed(self) -> None:
        self.slider.setEnabled(not self.proposed.isChecked())
        self.value.setText(str(self.slider.value()))
        self.threshold.emit(self.gvt)
