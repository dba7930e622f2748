"""An instrument that runs stays in the bar and under its buttons, whichever one is chosen meanwhile."""

from __future__ import annotations

from pathlib import Path

import pytest
from PySide6.QtCore import Qt, QTimer
from PySide6.QtWidgets import QApplication, QMessageBox
from pytestqt.qtbot import QtBot

from acquire.gui.messages import View
from acquire.gui.panels.controls import ControlBar
from acquire.gui.window import MainWindow
from tests.acquire.gui.conftest import PATIENCE, MakeWindow, press, state

LONG = "cutometer-instant-300"  # a minute's hold


@pytest.fixture
def window(qtbot: QtBot, make_window: MakeWindow, two: Path) -> MainWindow:
    """Two instruments connected; ``left`` runs."""
    window = make_window(station=two, speed=2.0)
    press(qtbot, window.instruments.connect_all)
    qtbot.waitUntil(lambda: {state(window, "left"), state(window, "right")} == {"ready"}, timeout=PATIENCE)
    window.prepare.choose(LONG)
    qtbot.waitUntil(window.controls.start_button.isEnabled, timeout=PATIENCE)
    press(qtbot, window.controls.start_button)
    qtbot.waitUntil(lambda: state(window, "left") == "running", timeout=PATIENCE)
    return window


def test_another_row_takes_nothing_from_the_run(qtbot: QtBot, window: MainWindow) -> None:
    bar = window.controls
    press(qtbot, window.instruments.rows["right"])
    assert window.current == "right"
    qtbot.waitUntil(bar.start_button.isEnabled, timeout=PATIENCE)
    assert bar.state.text().startswith("left")
    assert bar.countdown.text()
    assert "under suction" in bar.detail.text()
    assert "right" in bar.start_button.text()  # START is for the chosen one, and says so
    # The keys act on the one that runs; F6 again goes on.
    qtbot.keyClick(window, Qt.Key.Key_F6)
    qtbot.waitUntil(lambda: state(window, "left") == "paused", timeout=PATIENCE)
    assert "PAUSED" in bar.state.text()
    qtbot.waitUntil(lambda: bar.pause_button.text() == "RESUME", timeout=PATIENCE)
    qtbot.keyClick(window, Qt.Key.Key_F6)
    qtbot.waitUntil(lambda: state(window, "left") == "running", timeout=PATIENCE)
    press(qtbot, bar.stop_button)
    qtbot.waitUntil(lambda: state(window, "left") == "aborted", timeout=PATIENCE)
    assert state(window, "right") == "ready"
    qtbot.waitUntil(lambda: bar.state.text().startswith("right"), timeout=PATIENCE)
    assert bar.start_button.text() == "START"


def test_a_second_instrument_is_not_started_by_a_slip(qtbot: QtBot, window: MainWindow) -> None:
    bar = window.controls
    press(qtbot, window.instruments.rows["right"])
    qtbot.waitUntil(bar.start_button.isEnabled, timeout=PATIENCE)
    asked = []

    def answer(role: QMessageBox.ButtonRole) -> None:
        box = QApplication.activeModalWidget()
        assert isinstance(box, QMessageBox)
        asked.append(box.text())
        next(button for button in box.buttons() if box.buttonRole(button) == role).click()

    QTimer.singleShot(100, lambda: answer(QMessageBox.ButtonRole.RejectRole))
    bar.start_button.click()
    assert "left" in asked[0]
    assert "right" in asked[0]
    assert state(window, "right") == "ready"
    assert window.running == ("left",)
    QTimer.singleShot(100, lambda: answer(QMessageBox.ButtonRole.AcceptRole))
    bar.start_button.click()
    qtbot.waitUntil(lambda: state(window, "right") == "running", timeout=PATIENCE)
    assert bar.state.text().startswith("right")
    qtbot.waitUntil(lambda: "left" in bar.detail.text(), timeout=PATIENCE)
    # Each row stops its own; the bar goes on to the one that still runs.
    press(qtbot, window.instruments.rows["right"].button)
    qtbot.waitUntil(lambda: state(window, "right") == "aborted", timeout=PATIENCE)
    assert state(window, "left") == "running"
    qtbot.waitUntil(lambda: bar.state.text().startswith("left"), timeout=PATIENCE)
    window.activateWindow()  # without a screen nobody gives the focus back after a dialog
    qtbot.waitUntil(window.isActiveWindow, timeout=PATIENCE)
    qtbot.keyClick(window, Qt.Key.Key_F7)
    qtbot.waitUntil(lambda: state(window, "left") == "aborted", timeout=PATIENCE)


def test_a_stop_right_after_start_holds(qtbot: QtBot, make_window: MakeWindow) -> None:
    window = make_window(speed=2.0)
    press(qtbot, window.instruments.rows["cutometer"].button)
    qtbot.waitUntil(window.controls.start_button.isEnabled, timeout=PATIENCE)
    window.controls.start_button.click()
    assert window.controls.stop_button.isEnabled()  # before the worker has said anything
    assert not window.controls.start_button.isEnabled()
    window.controls.stop_button.click()
    qtbot.waitUntil(lambda: window.recordings.result.result is not None, timeout=PATIENCE)
    result = window.recordings.result.result
    assert result is not None
    assert result.summary["status"] == "aborted"
    assert state(window, "cutometer") == "aborted"


def test_an_instrument_is_chosen_by_the_keyboard(qtbot: QtBot, make_window: MakeWindow) -> None:
    window = make_window()
    row = window.instruments.rows["microrobot"]
    row.setFocus()
    qtbot.keyClick(row, Qt.Key.Key_Space)
    assert window.current == "microrobot"
    assert row.property("chosen")


def test_the_bar_names_what_it_is_for(qtbot: QtBot) -> None:
    bar = ControlBar()
    qtbot.addWidget(bar)
    running = View("a", "running", phase="hold", duration=60.0, segments=1)
    bar.show_view(running, "a", missing="", startable=True, beside="b", also=["c"])
    assert bar.state.text() == "a · holding"
    assert "c is running too" in bar.detail.text()
    assert bar.start_button.text() == "START\nb"
    assert bar.start_button.shortcut().toString() == "F5"
    assert "a" in bar.stop_button.toolTip()
