"""One instrument while it measures: its live plots, and beside them its own views (camera, robot)."""

from __future__ import annotations

import math
import time

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QHBoxLayout, QSplitter, QWidget

from acquire.gui.fresh import LEGIBLE
from acquire.gui.messages import InstrumentInfo, Preview, View
from acquire.gui.panels.camera import CameraPanel
from acquire.gui.panels.live import LivePanel
from acquire.gui.panels.robot import RobotPanel


class MeasurePanel(QWidget):
    """Plots, camera and robot view of one instrument."""

    def __init__(self, info: InstrumentInfo, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.live = LivePanel(info.channels, info.label)
        names = {channel.name for channel in info.channels}
        self.camera = CameraPanel() if info.camera else None
        self.robot = RobotPanel() if {"probe_x", "probe_y", "probe_z", "force_x"} <= names else None
        self._told = -math.inf
        splitter = QSplitter(Qt.Orientation.Horizontal)
        splitter.addWidget(self.live)
        for beside in (self.camera, self.robot):
            if beside is not None:
                splitter.addWidget(beside)
                splitter.setSizes([500, 500])
        row = QHBoxLayout(self)
        row.addWidget(splitter)

    def expect(self, preview: Preview | None) -> None:
        """The protocol that the next run will be of."""
        self.live.expect(preview)
        if self.robot is not None:
            self.robot.expect(preview)

    def tick(self) -> None:
        """The window's timer: the numbers, all of them at once; old values are greyed."""
        now = time.monotonic()
        if now - self._told >= LEGIBLE and self.isVisible():
            self._told = now
            for panel in (self.live, self.camera, self.robot):
                if panel is not None:
                    panel.tell()

    def show_view(self, view: View, drawn: bool) -> None:
        """New data; painted only where they are seen."""
        self.live.show_view(view, drawn)
        for beside in (self.camera, self.robot):
            if beside is not None:
                beside.show_view(view, drawn)
