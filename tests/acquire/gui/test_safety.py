"""Whatever happens to the window, the device ends vented: asserted at the device. The recording can be had."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from PySide6.QtCore import Qt, QTimer
from PySide6.QtWidgets import QApplication, QMessageBox, QPushButton
from pytestqt.qtbot import QtBot

from acquire.gui.window import MainWindow
from acquire.recording import open_recording
from acquire.recording.recovery import recover
from sim_devices.servers import BackDoor, Server, serve
from tests.acquire.gui.conftest import PATIENCE, MakeWindow, connected, state

SPEED = 5.0
WATCHDOG = 1.0  # s: the event loop of a busy machine stands still for longer than a bench should allow
PROTOCOL = "cutometer-instant-300"  # holds 300 mbar for long enough to look


def sucking(door: BackDoor) -> bool:
    return door.truth().signals.get("line_pressure", 0.0) < -20e3


@pytest.fixture
def server() -> Iterator[Server]:
    """An instrument that is in no process of the window's, as a real one is."""
    with serve("cutometer", "tcp", speed=SPEED, watchdog=WATCHDOG) as server:
        yield server


@pytest.fixture
def station(server: Server, tmp_path: Path) -> Path:
    path = tmp_path / "station.yaml"
    entry = f"{{address: '{server.entry.address}', simulated: true, watchdog: {WATCHDOG} s, interlock: {{stale: 5 s}}}}"
    path.write_text(f"schema: station/1\ninstruments:\n  cutometer: {entry}\n")
    return path


@pytest.fixture
def acting(qtbot: QtBot, make_window: MakeWindow, server: Server, station: Path) -> tuple[MainWindow, BackDoor]:
    """A window in the middle of a run, with suction on the skin."""
    window = make_window(station=station)
    connected(qtbot, window, "cutometer")
    window.prepare.choose(PROTOCOL)
    qtbot.waitUntil(lambda: window.controls.start_button.isEnabled(), timeout=PATIENCE)
    window.controls.start_button.click()
    qtbot.waitUntil(lambda: sucking(server.back_door), timeout=PATIENCE)
    return window, server.back_door


def ended(qtbot: QtBot, window: MainWindow) -> str:
    qtbot.waitUntil(lambda: window.recordings.result.result is not None, timeout=PATIENCE)
    assert window.recordings.result.result is not None
    recording = open_recording(window.recordings.result.result.path)
    assert recording.streams["pressure"].value.min() < -20e3
    return recording.info.status


def test_the_key_works_while_a_modal_dialog_is_open(qtbot: QtBot, acting: tuple[MainWindow, BackDoor]) -> None:
    window, door = acting
    box = QMessageBox(window)
    box.setText("something else altogether")
    seen = []

    def press() -> None:
        assert QApplication.activeModalWidget() is box
        qtbot.keyClick(box, Qt.Key.Key_Escape)
        door.wait_vented()
        seen.append(box.isVisible())  # the key meant the stop, not the dialog
        box.done(0)

    QTimer.singleShot(50, press)
    box.exec()
    assert seen == [True]
    assert window.alarm.isVisible()
    assert ended(qtbot, window) == "tripped"
    # It is latched: START stays off until a person resets.
    assert state(window, "cutometer") == "tripped"
    assert not window.controls.start_button.isEnabled()
    window.start()
    assert state(window, "cutometer") == "tripped"
    qtbot.mouseClick(window.alarm.button, Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: window.controls.start_button.isEnabled(), timeout=PATIENCE)
    assert not window.alarm.isVisible()
    # At rest the key is the dialog's own again.
    box = QMessageBox(window)
    QTimer.singleShot(50, lambda: qtbot.keyClick(box, Qt.Key.Key_Escape))
    box.exec()
    assert not window.latched


def test_one_reset_is_enough_for_a_slow_window(qtbot: QtBot, acting: tuple[MainWindow, BackDoor]) -> None:
    window, _ = acting
    qtbot.mousePress(window.controls.estop_button, Qt.MouseButton.LeftButton)
    assert ended(qtbot, window) == "tripped"
    assert state(window, "cutometer") == "tripped"
    qtbot.mouseClick(window.alarm.button, Qt.MouseButton.LeftButton)
    time.sleep(1.0)  # views from before the reset, its reply and views from after it arrive together
    qtbot.waitUntil(lambda: state(window, "cutometer") == "ready", timeout=PATIENCE)
    assert not window.latched
    assert window.controls.start_button.isEnabled()


def test_a_modal_dialog_has_a_button_of_its_own(qtbot: QtBot, acting: tuple[MainWindow, BackDoor]) -> None:
    window, door = acting
    box = QMessageBox(window)

    def press() -> None:
        button = box.findChild(QPushButton, "estop")
        qtbot.mouseClick(button, Qt.MouseButton.LeftButton)
        door.wait_vented()
        box.done(0)

    QTimer.singleShot(50, press)
    box.exec()
    assert ended(qtbot, window) == "tripped"


def test_the_big_button(qtbot: QtBot, acting: tuple[MainWindow, BackDoor]) -> None:
    window, door = acting
    qtbot.mousePress(window.controls.estop_button, Qt.MouseButton.LeftButton)
    door.wait_vented()
    assert ended(qtbot, window) == "tripped"
    assert window.latched


def test_a_frozen_window(qtbot: QtBot, acting: tuple[MainWindow, BackDoor]) -> None:
    window, door = acting
    door.wait_vented(5.0)  # the event loop stands still meanwhile
    assert ended(qtbot, window) == "tripped"


def test_the_worker_s_own_stop_while_the_window_is_frozen(qtbot: QtBot, acting: tuple[MainWindow, BackDoor]) -> None:
    window, door = acting
    pid = window.client.process.pid
    assert pid is not None
    os.kill(pid, signal.SIGINT)  # Ctrl-C in the terminal
    door.wait_vented(5.0)
    assert ended(qtbot, window) == "tripped"
    assert window.recordings.result.result is not None
    assert "Ctrl-C" in window.recordings.result.result.summary["trip_reason"]


def test_closing_the_window(qtbot: QtBot, acting: tuple[MainWindow, BackDoor], tmp_path: Path) -> None:
    window, door = acting

    def answer(button: QMessageBox.StandardButton) -> None:
        box = QApplication.activeModalWidget()
        assert isinstance(box, QMessageBox)
        box.button(button).click()

    QTimer.singleShot(50, lambda: answer(QMessageBox.StandardButton.Cancel))
    assert not window.close()
    assert state(window, "cutometer") == "running"
    QTimer.singleShot(50, lambda: answer(QMessageBox.StandardButton.Close))
    assert window.close()
    door.wait_vented()
    assert not window.client.process.is_alive()
    (path,) = (tmp_path / "runs").glob("*.h5")
    assert open_recording(path).info.status == "aborted"


# A window of its own process, which starts a run by itself and tells the ids of its worker and its analyst.
HOST = """
import json, sys
from pathlib import Path
from PySide6.QtCore import QSettings
from PySide6.QtWidgets import QApplication
from acquire.gui.messages import BenchSettings
from acquire.gui.window import MainWindow
if __name__ == "__main__":
    station, out, protocol = sys.argv[1:]
    app = QApplication([])
    store = QSettings(out + ".ini", QSettings.Format.IniFormat)
    window = MainWindow(BenchSettings(station=Path(station), out=Path(out)), store)
    print(json.dumps([window.client.process.pid, *window.recordings.analyst._pool._processes]), flush=True)
    started = []
    def go():
        if window.instruments.rows and window.prepare.entries and "cutometer" not in started:
            started.append("cutometer")
            window.instruments.rows["cutometer"].button.click()
            window.prepare.choose(protocol)
        if window.controls.start_button.isEnabled() and window.prepare.preview.name == protocol and len(started) < 2:
            started.append("run")
            window.controls.start_button.click()
    window._timer.timeout.connect(go)
    app.exec()
"""


Elsewhere = tuple[subprocess.Popen[str], list[int], Path]


@pytest.fixture
def elsewhere(server: Server, station: Path, tmp_path: Path) -> Iterator[Elsewhere]:
    """A window in a process of its own, in the middle of a run; and the ids of its worker and its analyst."""
    script, out = tmp_path / "host.py", tmp_path / "out"
    script.write_text(HOST)
    command = [sys.executable, str(script), str(station), str(out), PROTOCOL]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as host:
        try:
            assert host.stdout is not None
            processes = json.loads(host.stdout.readline())
            eventually(lambda: sucking(server.back_door))
            yield host, processes, out
        finally:
            host.kill()


def eventually(condition: Callable[[], bool], timeout: float = 60.0) -> None:
    deadline = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < deadline, "it did not happen"
        time.sleep(0.01)


def gone(pid: int) -> bool:
    """Whether a process has ended, be it that nobody has collected it."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except FileNotFoundError:
        return True


def test_a_killed_window(elsewhere: Elsewhere, server: Server) -> None:
    host, processes, out = elsewhere
    host.kill()
    server.back_door.wait_vented()
    eventually(lambda: len(list(out.glob("*.h5"))) == 1)  # the worker ends the recording by itself
    recording = open_recording(next(out.glob("*.h5")))
    assert recording.info.status == "aborted"
    assert recording.streams["pressure"].value.min() < -20e3
    eventually(lambda: all(gone(pid) for pid in processes))  # nothing is left behind


def test_a_killed_window_and_worker(elsewhere: Elsewhere, server: Server) -> None:
    host, processes, out = elsewhere
    os.kill(processes[0], signal.SIGKILL)
    host.kill()
    server.back_door.wait_vented()
    (journal,) = out.glob("*.journal")
    recording = open_recording(recover(journal))
    assert recording.info.status == "recovered"
    assert recording.streams["pressure"].value.min() < -2e3  # killed as soon as the device sucked
