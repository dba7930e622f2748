"""Where the window's panels stand, and its menu. `MainWindow` gives them life."""

from __future__ import annotations

from functools import partial

from PySide6.QtCore import QSize, Qt, QTimer
from PySide6.QtGui import QAction, QKeySequence
from PySide6.QtWidgets import QHBoxLayout, QMainWindow, QScrollArea, QStackedWidget, QTabWidget, QVBoxLayout, QWidget

from acquire.gui.messages import BenchSettings
from acquire.gui.panels.banner import Banner
from acquire.gui.panels.controls import ControlBar
from acquire.gui.panels.elided import Elided
from acquire.gui.panels.health import Health
from acquire.gui.panels.instruments import InstrumentsPanel
from acquire.gui.panels.livefit import LiveFitPanel
from acquire.gui.panels.prepare import PreparePanel
from acquire.gui.panels.qualify import QualifyPanel
from acquire.gui.panels.subject import SubjectPanel
from acquire.gui.recordings import Recordings

SIDE = (336, 408)  # px, the column of instruments and subject, three tenths of the width between the two
FIRST = QSize(1280, 860)  # when nothing is remembered, where the screen has room for it


class Layout(QMainWindow):
    """Commands and alarms across the top, the bench and the subject at the left, the pages beside them."""

    def __init__(self, bench: BenchSettings) -> None:
        super().__init__()
        self.setWindowTitle("skinrig")
        self.instruments, self.subject = InstrumentsPanel(), SubjectPanel()
        self.controls, self.health = ControlBar(), Health()
        self.alarm, self.prepare = Banner("alarm", "Reset"), PreparePanel()
        self.measure = QStackedWidget()
        self.qualify, self.live_fit = QualifyPanel(bench), LiveFitPanel()
        self.recordings = Recordings(bench.out, lambda: self.subject.operator.text().strip(), self)
        kept = self.recordings
        self.tabs = QTabWidget()
        self.tabs.setElideMode(Qt.TextElideMode.ElideNone)
        for widget, title in (
            (self.prepare, "Protocol"), (self.measure, "Measure"), (kept.result, "Result"),
            (kept.browser, "Recordings"), (kept.diagnosis, "Diagnosis"), (kept.fit, "Fit"),
            (self.qualify, "Qualify"), (self.live_fit, "Live fit"),
        ):  # fmt: skip
            self.tabs.addTab(widget, title)
        row = QHBoxLayout()
        row.addWidget(self._side(), 3)
        row.addWidget(self.tabs, 7)
        central = QWidget()
        column = QVBoxLayout(central)
        column.addWidget(self.controls)
        column.addWidget(self.alarm)
        column.addWidget(kept.offer)
        column.addLayout(row, 1)
        self.setCentralWidget(central)
        self.said = Elided("")
        self.statusBar().addWidget(self.said, 1)
        self.statusBar().addPermanentWidget(self.health)
        self._silence = QTimer(self)
        self._silence.setSingleShot(True)
        self._silence.timeout.connect(lambda: self.said.setText(""))
        self.resize(FIRST.boundedTo(self.screen().availableSize()))
        self._menu()

    def _say(self, text: str, seconds: float = 20.0) -> None:
        """A line at the bottom, for a while."""
        self.said.setText(text)
        self._silence.start(round(1e3 * seconds))

    def _side(self) -> QScrollArea:
        side = QWidget()
        column = QVBoxLayout(side)
        column.setContentsMargins(0, 0, 6, 0)
        column.addWidget(self.instruments)
        column.addWidget(self.subject)
        column.addStretch(1)
        scroll = QScrollArea()
        scroll.setWidget(side)
        scroll.setWidgetResizable(True)
        scroll.setFrameShape(QScrollArea.Shape.NoFrame)
        scroll.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        scroll.setMinimumWidth(SIDE[0])
        scroll.setMaximumWidth(SIDE[1])
        return scroll

    def _menu(self) -> None:
        view = self.menuBar().addMenu("&View")
        for number in range(self.tabs.count()):
            action = QAction(self.tabs.tabText(number), self)
            action.setShortcut(QKeySequence(f"Ctrl+{number + 1}"))
            action.triggered.connect(partial(self.tabs.setCurrentIndex, number))
            view.addAction(action)
        view.addSeparator()
        self.dark_action = QAction("Light or &dark (from the next start)", self)
        self.dark_action.setShortcut("Ctrl+D")
        view.addAction(self.dark_action)
        quit_action = QAction("&Quit", self)
        quit_action.setShortcut(QKeySequence.StandardKey.Quit)
        quit_action.triggered.connect(self.close)
        view.addAction(quit_action)
