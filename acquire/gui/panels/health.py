"""Whether everything keeps up: lost samples, the disk, the recorder, the screen."""

from __future__ import annotations

import math
import time

from PySide6.QtWidgets import QHBoxLayout, QLabel, QWidget

from acquire.gui.messages import LIVE, View
from acquire.gui.theme import LEVELS
from acquire.words import share, span

SHORT = 3600.0  # s of disk time left from which it is a warning
FULL = 0.3  # of the recorder's queue


class Health(QWidget):
    """Numbers for the status bar."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.lost, self.disk, self.recorder, self.rate = (QLabel("") for _ in range(4))
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.addStretch(1)
        for label, longest in (
            (self.lost, "lost samples 99999"),
            (self.disk, "disk lasts 99.9 min"),
            (self.recorder, "recorder 100 % full"),
            (self.rate, "screen 30 Hz"),
        ):
            label.setMinimumWidth(label.fontMetrics().horizontalAdvance(longest) + 12)  # so that nothing dances
            row.addWidget(label)
        self._frames = 0
        self._since = time.monotonic()
        self.show_view(None)

    def show_view(self, view: View | None) -> None:
        """The chosen instrument's figures."""
        lost = view.lost if view is not None else 0
        _tell(self.lost, f"lost samples {lost}", "bad" if lost else "ok")
        disk = view.disk if view is not None else math.nan
        _tell(self.disk, f"disk lasts {span(disk)}", "bad" if disk < SHORT else "ok")
        fill = view.fill if view is not None and view.state in LIVE else 0.0
        _tell(self.recorder, f"recorder {share(round(fill, 2))} full", "warning" if fill > FULL else "ok")

    def count_frame(self) -> None:
        """The window's timer turned once."""
        self._frames += 1
        now = time.monotonic()
        if now - self._since >= 1.0:
            rate = self._frames / (now - self._since)
            _tell(self.rate, f"screen {rate:.0f} Hz", "warning" if rate < 15 else "ok")
            self._frames, self._since = 0, now


def _tell(label: QLabel, text: str, level: str) -> None:
    if label.text() != text:
        label.setText(text)
        label.setStyleSheet("" if level == "ok" else f"color: {LEVELS[level]}; font-weight: 700")
