"""The bench: which instruments there are, their state, and their last fault."""

from __future__ import annotations

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QKeyEvent, QMouseEvent
from PySide6.QtWidgets import QFrame, QGridLayout, QGroupBox, QHBoxLayout, QLabel, QPushButton, QVBoxLayout, QWidget

from acquire.gui.messages import LIVE, NEEDS_RESET, InstrumentInfo, View
from acquire.gui.panels.elided import Elided
from acquire.gui.theme import LIGHTS

CLOSED = ("off", "idle")
#: States in the words of somebody at the bench.
WORDS = {
    "off": "not connected",
    "idle": "not connected",
    "connecting": "connecting …",
    "ready": "ready",
    "armed": "armed",
    "running": "running",
    "paused": "paused, vented",
    "completed": "ready, last run complete",
    "aborted": "ready, last run stopped",
    "tripped": "stopped, to be reset",
    "failed": "failed, to be reset",
    "lost": "not known",
}


class InstrumentRow(QFrame):
    """One instrument: light, name, state, last error, and the one button that its state calls for."""

    chosen = Signal(str)
    wanted = Signal(str, str)  # action, instrument

    def __init__(self, info: InstrumentInfo, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.info = info
        self.state = "off"
        self._action = "connect"
        self.setProperty("role", "row")
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setAccessibleName(info.label)
        self.light = QLabel("●")
        title = Elided(info.label)
        title.setStyleSheet("font-weight: 600")
        title.whole = f"{info.name} in the station: {info.title}"
        self.words = Elided(WORDS["off"])
        self.words.setProperty("role", "faint")
        self.error = QLabel("")
        self.error.setProperty("role", "error")
        self.error.setWordWrap(True)
        self.error.hide()
        self.button = QPushButton("Connect")
        longest = max(self.button.fontMetrics().horizontalAdvance(text) for text in ("Disconnect", "Connect", "Retry"))
        self.button.setFixedWidth(longest + 28)
        self.button.clicked.connect(self._act)
        grid = QGridLayout(self)
        grid.setContentsMargins(8, 6, 8, 6)
        grid.setHorizontalSpacing(8)
        grid.addWidget(self.light, 0, 0, 2, 1)
        grid.setVerticalSpacing(2)
        grid.addWidget(title, 0, 1, 1, 2)
        grid.addWidget(self.words, 1, 1)
        grid.addWidget(self.button, 1, 2)
        grid.addWidget(self.error, 2, 0, 1, 3)
        grid.setColumnStretch(1, 1)
        self._light("off")

    def show_state(self, state: str, error: str = "") -> None:
        """Show a state; nothing is painted where nothing changed."""
        if (state, error) == (self.state, self.error.toolTip()):
            return
        self.state = state
        self._light(state)
        simulated = " (simulated)" if self.info.simulated else ""
        self.words.setText(WORDS.get(state, state) + simulated * (state in ("ready", "off")))
        self.error.setText(error.splitlines()[0] if error else "")
        self.error.setToolTip(error)
        self.error.setVisible(bool(error))
        self._action, text = _action(state, error)
        self.button.setText(text)
        self.button.setEnabled(state not in ("connecting", "lost"))

    def mark(self, chosen: bool) -> None:
        """Show whether this is the one that runs are started on."""
        self.setProperty("chosen", chosen)
        self.style().polish(self)

    def mousePressEvent(self, event: QMouseEvent) -> None:
        """A click anywhere on the row chooses the instrument."""
        self.chosen.emit(self.info.name)
        super().mousePressEvent(event)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """So do the space bar and Return, where the row has the focus."""
        if event.key() in (Qt.Key.Key_Space, Qt.Key.Key_Return, Qt.Key.Key_Enter):
            self.chosen.emit(self.info.name)
            return
        super().keyPressEvent(event)

    def _light(self, state: str) -> None:
        self.light.setStyleSheet(f"color: {LIGHTS.get(state, LIGHTS['off'])}; font-size: 20pt")
        self.light.setAccessibleName(f"{self.info.label}: {WORDS.get(state, state)}")

    def _act(self) -> None:
        action = self._action
        if action == "connect":
            self.show_state("connecting")
        self.wanted.emit(action, self.info.name)


def _action(state: str, error: str) -> tuple[str, str]:
    """Action and label of an instrument's one button."""
    if state in NEEDS_RESET:
        return "reset", "Reset"
    if state in CLOSED:
        return "connect", "Retry" if error else "Connect"
    if state in LIVE:
        return "abort", "Stop"
    return "disconnect", "Disconnect"


class InstrumentsPanel(QGroupBox):
    """Every instrument of the station."""

    chosen = Signal(str)
    wanted = Signal(str, str)
    station_wanted = Signal(bool)  # True: the simulated bench; False: a station file

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__("Instruments", parent)
        self.rows: dict[str, InstrumentRow] = {}
        self.current = ""
        self.bench = QLabel("starting …")
        self.bench.setWordWrap(True)
        self.connect_all = QPushButton("Connect all")
        self.connect_all.setToolTip("Each by itself: one that cannot be reached keeps no other one waiting")
        self.connect_all.clicked.connect(self._connect_all)
        self.simulated = QPushButton("Simulated")
        self.station = QPushButton("Station file …")
        self.simulated.clicked.connect(lambda: self.station_wanted.emit(True))
        self.station.clicked.connect(lambda: self.station_wanted.emit(False))
        head, buttons = QHBoxLayout(), QHBoxLayout()
        head.addWidget(self.bench, 1)
        head.addWidget(self.connect_all)
        buttons.addWidget(self.simulated)
        buttons.addWidget(self.station)
        self._list = QVBoxLayout()
        layout = QVBoxLayout(self)
        layout.addLayout(head)
        layout.addLayout(self._list)
        layout.addLayout(buttons)
        layout.setAlignment(Qt.AlignmentFlag.AlignTop)

    def show_bench(self, name: str, instruments: tuple[InstrumentInfo, ...]) -> None:
        """The instruments of a station, none connected yet."""
        for row in self.rows.values():
            self._list.removeWidget(row)
            row.deleteLater()
        self.rows = {info.name: InstrumentRow(info) for info in instruments}
        for row in self.rows.values():
            self._list.addWidget(row)
            row.chosen.connect(self.choose)
            row.wanted.connect(self.wanted)
        self.bench.setText(name)
        self.bench.setProperty("role", "")
        self.bench.style().polish(self.bench)
        self.connect_all.setVisible(len(instruments) > 1)
        self.current = ""

    def show_refusal(self, fault: str) -> None:
        """The station cannot be used: no instrument, and why."""
        self.show_bench(fault, ())
        self.bench.setProperty("role", "error")
        self.bench.style().polish(self.bench)

    def show_lost(self) -> None:
        """Nothing is known of any instrument: the worker is gone."""
        for row in self.rows.values():
            row.show_state("lost")

    def choose(self, name: str) -> None:
        """Make an instrument the one that runs are started on."""
        if name in self.rows and name != self.current:
            self.current = name
            for other, row in self.rows.items():
                row.mark(other == name)
            self.chosen.emit(name)

    def show_views(self, views: tuple[View, ...]) -> None:
        """New states."""
        for view in views:
            if view.name in self.rows:
                self.rows[view.name].show_state(view.state, view.trip or view.error)

    def _connect_all(self) -> None:
        for row in self.rows.values():
            if row.state in CLOSED:
                row.button.click()
