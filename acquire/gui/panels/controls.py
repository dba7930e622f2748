"""The bar that is always there: state, time left, START, PAUSE, STOP and the emergency stop."""

from __future__ import annotations

import re
from collections.abc import Sequence

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QFrame, QGridLayout, QHBoxLayout, QLabel, QProgressBar, QPushButton, QWidget

from acquire.gui.estop import button_for
from acquire.gui.messages import LIVE, NEEDS_RESET, View
from acquire.gui.panels.elided import Elided
from acquire.words import clock

PHASES = {"load": "loading", "hold": "holding", "unload": "unloading", "rest": "waiting"}
AWAY = {"pressure": "under suction"}  # how a quantity's dwell is called; limits are in docs/safety.md
STARTABLE = frozenset({"ready", "completed", "aborted"})


class ControlBar(QFrame):
    """Commands for the instrument that it names; the emergency stop is for all of them.

    The one that runs is named, whichever is chosen; START is for the chosen one, and says so where it is another.
    """

    start = Signal()
    pause = Signal()
    resume = Signal()
    halt = Signal()
    estop = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setProperty("role", "bar")
        self.state = Elided("no instrument")
        self.state.setProperty("role", "title")
        self.countdown = QLabel("")
        self.countdown.setProperty("role", "number")
        self.countdown.setToolTip("left of this step, min:s")
        self.detail = Elided("")
        self.detail.setProperty("role", "faint")
        self.bar = QProgressBar()
        self.bar.setRange(0, 1000)
        self.bar.setTextVisible(False)
        self.bar.setFixedHeight(8)
        self.start_button = self._button("START", "start", "F5", self.start.emit)
        self.pause_button = self._button("PAUSE", "pause", "F6", self._pause_or_resume)
        self.stop_button = self._button("STOP", "halt", "F7", self.halt.emit)
        self.estop_button = button_for(self.estop.emit)
        self._paused = False
        words = QGridLayout()
        words.addWidget(self.state, 0, 0)
        words.addWidget(self.countdown, 0, 1)
        words.addWidget(self.detail, 1, 0, 1, 2)
        words.addWidget(self.bar, 2, 0, 1, 2)
        words.setColumnStretch(0, 1)
        layout = QHBoxLayout(self)
        layout.addLayout(words, 1)
        for button in (self.start_button, self.pause_button, self.stop_button):
            button.setMinimumSize(104, 56)
            layout.addWidget(button)
        layout.addSpacing(16)
        self.estop_button.setMinimumSize(170, 72)
        layout.addWidget(self.estop_button)
        self.show_view(None, missing="connect an instrument")

    def show_view(
        self,
        view: View | None,
        label: str = "",
        *,
        missing: str,
        fault: str = "",
        startable: bool = False,
        beside: str = "",
        also: Sequence[str] = (),
    ) -> None:
        """The state of the instrument that the bar is for, which is called ``label``.

        ``missing`` names the steps to be done before START, '' where nothing is; ``fault`` why nothing is known of the
        instruments. START is for the chosen instrument, called ``beside`` where it is another one. ``also`` are those
        that run besides.
        """
        self._label = label
        self._also = also
        state = view.state if view is not None else "off"
        self.start_button.setEnabled(startable)
        self._name_start(beside)
        self.stop_button.setEnabled(state in LIVE)
        self.pause_button.setEnabled(state in ("running", "paused"))
        if self._paused != (state == "paused"):
            self._paused = state == "paused"
            self.pause_button.setText("RESUME" if self._paused else "PAUSE")
            self.pause_button.setShortcut("F6")  # a text takes the key away
        for button, what in ((self.pause_button, "F6"), (self.stop_button, "F7")):
            button.setToolTip(f"{what}: {label}" if label and state in LIVE else what)
        if view is None or state not in LIVE:
            self._idle(state, missing, fault)
        else:
            self._running(view)

    def _name_start(self, beside: str) -> None:
        """START names its instrument where that is not the bar's."""
        room = self.start_button.width() - 12
        name = self.fontMetrics().elidedText(beside, Qt.TextElideMode.ElideRight, room)
        text = f"START\n{name}" if beside else "START"
        if self.start_button.text() != text:
            self.start_button.setText(text)
            self.start_button.setShortcut("F5")  # a text takes the key away
            self.start_button.setToolTip(f"F5: start {beside} as well" if beside else "F5")

    def _idle(self, state: str, missing: str, fault: str) -> None:
        if fault:
            words = "no connection to the instruments"
        elif state in NEEDS_RESET:
            words = "stopped: reset the instrument"
        elif state in STARTABLE:
            words = missing or "ready to start"
        else:
            words = "connect an instrument" if state in ("off", "idle") else "connecting …"
        self._say(words)
        _set(self.countdown, "")
        _set(self.detail, "START F5   PAUSE F6   STOP F7   E-STOP Esc")
        self.bar.setValue(0)

    def _running(self, view: View) -> None:
        if view.state == "paused":
            words = "PAUSED – vented"
        elif view.state == "armed":
            words = "starting"
        else:
            labels = [f"{name} {_degrees(value)}" for name, value in view.labels.items()]
            words = " · ".join([PHASES.get(view.phase, view.phase), *labels])
        self._say(words)
        _set(self.countdown, clock(view.left) if view.state == "running" else "")
        left = clock(view.duration - view.elapsed)
        parts = [f"step {view.segment + 1} of {view.segments}", f"{left} left of {clock(view.duration)}"]
        parts += [
            f"{AWAY.get(name, 'away from rest')} {clock(t)} of {clock(most)}" for name, (t, most) in view.dwell.items()
        ]
        parts += [f"{name} is running too" for name in self._also]
        _set(self.detail, " · ".join(parts))
        self.bar.setValue(round(1000 * view.elapsed / view.duration) if view.duration else 0)

    def _say(self, words: str) -> None:
        _set(self.state, f"{self._label} · {words}" if self._label else words)

    def _pause_or_resume(self) -> None:
        (self.resume if self._paused else self.pause).emit()

    def _button(self, text: str, role: str, key: str, action: object) -> QPushButton:
        button = QPushButton(text)
        button.setProperty("role", role)
        button.setShortcut(key)
        button.setToolTip(key)
        button.clicked.connect(action)
        return button


def _degrees(value: str) -> str:
    """A label's value with the angles of a direction as people write them: ``theta=0 phi=90`` is ``θ 0° φ 90°``."""
    return re.sub(r"(theta|phi)=(-?[\d.]+)", lambda found: f"{'θφ'[found[1] == 'phi']} {found[2]}°", value)


def _set(label: QLabel, text: str) -> None:
    """A label lays itself out anew at every setText: only where it says something else."""
    if label.text() != text:
        label.setText(text)
