"""The bench in the window: instruments that cannot be reached, stations that cannot be used, one latch each."""

from __future__ import annotations

import os
import signal
import socket
from pathlib import Path

import pytest
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QApplication, QMessageBox
from pytestqt.qtbot import QtBot

from acquire.cli import app
from acquire.gui.messages import View
from acquire.gui.window import MainWindow
from sim_devices.servers import serve
from tests.acquire.gui.conftest import PATIENCE, MakeWindow, press, state

FAULTY = """\
schema: station/1
instruments:
  cutometer:
    adress: /dev/ttyUSB0
"""


def both_ready(qtbot: QtBot, window: MainWindow) -> None:
    press(qtbot, window.instruments.connect_all)
    qtbot.waitUntil(lambda: {state(window, "left"), state(window, "right")} == {"ready"}, timeout=PATIENCE)


def test_an_instrument_that_cannot_be_reached_keeps_no_other_waiting(
    qtbot: QtBot, make_window: MakeWindow, tmp_path: Path
) -> None:
    with socket.socket() as nobody, serve("cutometer", "tcp", watchdog=1.0, speed=5.0) as there:
        nobody.bind(("127.0.0.1", 0))  # bound and not listening: refused
        path = tmp_path / "station.yaml"
        path.write_text(f"""\
schema: station/1
instruments:
  far: {{instrument: microrobot, address: 'socket://127.0.0.1:{nobody.getsockname()[1]}', simulated: true}}
  near: {{instrument: cutometer, address: '{there.entry.address}', simulated: true, interlock: {{stale: 5 s}}}}
""")
        window = make_window(station=path)
        far, near = window.instruments.rows["far"], window.instruments.rows["near"]
        press(qtbot, far.button)
        qtbot.waitUntil(lambda: far.error.isVisible(), timeout=PATIENCE)
        press(qtbot, near)
        press(qtbot, near.button)
        qtbot.waitUntil(lambda: state(window, "near") == "ready", timeout=PATIENCE)
        qtbot.waitUntil(window.controls.start_button.isEnabled, timeout=PATIENCE)
        assert "127.0.0.1" in far.error.text()
        assert far.button.text() == "Retry"
        # It can be tried again, and what failed says so again; nothing else is touched.
        press(qtbot, far.button)
        qtbot.waitUntil(lambda: not far.button.isEnabled(), timeout=PATIENCE)
        qtbot.waitUntil(lambda: far.button.isEnabled() and far.error.isVisible(), timeout=PATIENCE)
        assert window.controls.start_button.isEnabled()
        assert not window.alarm.isVisible()


def test_after_a_crash_the_next_run_starts_and_what_was_found_is_told(
    qtbot: QtBot, make_window: MakeWindow, tmp_path: Path
) -> None:
    with serve("cutometer", "tcp", watchdog=1.0, speed=5.0) as there:
        path = tmp_path / "station.yaml"
        entry = f"{{address: '{there.entry.address}', simulated: true, watchdog: 1 s, interlock: {{stale: 5 s}}}}"
        path.write_text(f"schema: station/1\ninstruments:\n  cutometer: {entry}\n")
        window = make_window(station=path)
        press(qtbot, window.instruments.rows["cutometer"].button)
        qtbot.waitUntil(window.controls.start_button.isEnabled, timeout=PATIENCE)
        press(qtbot, window.controls.start_button)
        qtbot.waitUntil(lambda: there.back_door.truth().signals["line_pressure"] < -1e4, timeout=PATIENCE)
        assert window.client.process.pid is not None
        os.kill(window.client.process.pid, signal.SIGKILL)
        there.back_door.wait_vented(5.0)  # by the device's own watchdog, which it remembers
        qtbot.waitUntil(window.alarm.isVisible, timeout=PATIENCE)
        press(qtbot, window.alarm.button)  # another worker
        qtbot.waitUntil(lambda: "cutometer" in window.instruments.rows, timeout=PATIENCE)
        row = window.instruments.rows["cutometer"]
        press(qtbot, row.button)
        qtbot.waitUntil(window.controls.start_button.isEnabled, timeout=PATIENCE)
        assert "no heartbeat" in row.error.text()
        assert "made safe" in row.error.toolTip()
        assert not window.alarm.isVisible()


def test_a_faulty_station_is_refused_and_nothing_opens_in_its_place(
    qtbot: QtBot, make_window: MakeWindow, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "faulty.yaml"
    path.write_text(FAULTY)
    window = make_window(up=False, station=path)
    qtbot.waitUntil(lambda: isinstance(QApplication.activeModalWidget(), QMessageBox), timeout=PATIENCE)
    box = QApplication.activeModalWidget()
    assert isinstance(box, QMessageBox)
    for text in (box.text(), window.instruments.bench.text()):
        assert "faulty.yaml:4" in text
        assert "adress" in text
    press(qtbot, box.button(QMessageBox.StandardButton.Ok))
    assert not window.instruments.rows
    assert not window.ready
    assert not window.controls.start_button.isEnabled()
    # A person may choose the simulated bench, knowingly.
    press(qtbot, window.instruments.simulated)
    qtbot.waitUntil(lambda: len(window.instruments.rows) == 3, timeout=PATIENCE)
    # The command does not open a window at all.
    assert app.run(["gui", "--station", str(path)]) == 2
    assert "faulty.yaml:4" in capsys.readouterr().err


def test_one_latch_for_each_instrument_whichever_button_resets_it(
    qtbot: QtBot, make_window: MakeWindow, two: Path
) -> None:
    window = make_window(station=two)
    left, right = window.instruments.rows["left"], window.instruments.rows["right"]
    titles = [label.text() for row in (left, right) for label in row.findChildren(type(row.words))]
    assert any("left" in title for title in titles)  # two of a kind are told apart
    assert any("right" in title for title in titles)
    both_ready(qtbot, window)
    assert window.controls.state.text().startswith("left")
    qtbot.mousePress(window.controls.estop_button, Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: {state(window, "left"), state(window, "right")} == {"tripped"}, timeout=PATIENCE)
    assert "left" in window.alarm.text.text()
    assert "right" in window.alarm.text.text()
    assert not window.controls.start_button.isEnabled()
    # The row's button resets that instrument and no other; the banner stays for the other.
    press(qtbot, left.button)
    qtbot.waitUntil(lambda: state(window, "left") == "ready", timeout=PATIENCE)
    qtbot.waitUntil(window.controls.start_button.isEnabled, timeout=PATIENCE)
    assert window.alarm.isVisible()
    assert "left" not in window.alarm.text.text()
    assert state(window, "right") == "tripped"
    press(qtbot, right)
    assert not window.controls.start_button.isEnabled()
    # The banner's button does the same for what is left.
    press(qtbot, window.alarm.button)
    qtbot.waitUntil(lambda: state(window, "right") == "ready", timeout=PATIENCE)
    qtbot.waitUntil(window.controls.start_button.isEnabled, timeout=PATIENCE)
    assert not window.alarm.isVisible()


def test_an_alarm_does_not_survive_its_station(qtbot: QtBot, make_window: MakeWindow, two: Path) -> None:
    window = make_window(station=two)
    both_ready(qtbot, window)
    qtbot.mousePress(window.controls.estop_button, Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: state(window, "right") == "tripped", timeout=PATIENCE)
    press(qtbot, window.instruments.simulated)
    qtbot.waitUntil(lambda: "cutometer" in window.instruments.rows, timeout=PATIENCE)
    assert not window.alarm.isVisible()
    assert not window.latched


def test_after_the_worker_died_nothing_looks_alive(qtbot: QtBot, make_window: MakeWindow) -> None:
    window = make_window(speed=2.0)
    press(qtbot, window.instruments.rows["cutometer"].button)
    qtbot.waitUntil(window.controls.start_button.isEnabled, timeout=PATIENCE)
    press(qtbot, window.controls.start_button)
    qtbot.waitUntil(window.controls.pause_button.isEnabled, timeout=PATIENCE)
    qtbot.waitUntil(lambda: window.controls.bar.value() > 0, timeout=PATIENCE)
    assert window.client.process.pid is not None
    os.kill(window.client.process.pid, signal.SIGKILL)
    qtbot.waitUntil(window.alarm.isVisible, timeout=PATIENCE)
    bar = window.controls
    assert not any(button.isEnabled() for button in (bar.start_button, bar.pause_button, bar.stop_button))
    assert bar.bar.value() == 0
    assert bar.countdown.text() == ""
    assert "no connection" in bar.state.text()
    row = window.instruments.rows["cutometer"]
    assert row.words.text() == "not known"
    assert not row.button.isEnabled()
    plot = window.measure.currentWidget().live.plots[0]
    qtbot.waitUntil(lambda: " ago" in plot.numbers.text(), timeout=PATIENCE)


def test_latches_know_what_was_asked_for_before_it_is_told() -> None:
    from acquire.gui.latches import Latches  # here, so that the other tests can be tried on revisions without it

    latches = Latches()
    running, tripped, ready = (View("a", state, trip="too high" * (state == "tripped")) for state in STATES)
    latches.stop(["a"])
    latches.see(running)  # a view from before the stop
    assert latches.stopped == ("a",)
    latches.see(tripped)
    assert "a: too high" in latches.words()
    latches.reset("a")
    latches.see(tripped)  # a view from before the reset
    assert latches.stopped == ()
    assert latches.holds("a")
    latches.answered("a")
    latches.see(ready)
    assert not latches.holds("a")
    latches.stop(["a"])
    latches.clear()
    assert latches.words() == ""


STATES = ("running", "tripped", "ready")
