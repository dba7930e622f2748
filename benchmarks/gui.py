"""The window at work: frames per second, processor time and the event loop's lag, with all instruments delivering.

The micro-robot (1 kHz, six curves drawn) runs its protocol while the aspiration device's camera delivers frames; the
window shows the one, then the other. Processor time is that of the window's process alone, as a share of one core.
"""

from __future__ import annotations

import argparse
import os
import resource
import signal
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

import numpy as np
from PySide6.QtCore import QSettings
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

from acquire.gui import theme
from acquire.gui.messages import BenchSettings
from acquire.gui.window import FRAME, MainWindow
from sim_devices.servers import serve

WINDOW = (1440, 900)


class Meter:
    """Watches the window's own timer: how late each turn comes, and what the process spends."""

    def __init__(self, window: MainWindow) -> None:
        self._turns: list[float] = []
        self._began = self._spent = 0.0
        window._timer.timeout.connect(lambda: self._turns.append(time.perf_counter()))

    def begin(self) -> None:
        """Count from here."""
        self._turns.clear()
        self._began, self._spent = time.perf_counter(), time.process_time()

    def line(self, what: str) -> str:
        """The figures since `begin`."""
        wall, spent = time.perf_counter() - self._began, time.process_time() - self._spent
        lag = np.maximum(np.diff(self._turns) * 1e3 - FRAME, 0.0)
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        return (
            f"{what:<34} {len(self._turns) / wall:5.1f} frames/s   {100 * spent / wall:5.1f} % of one core   "
            f"lag p50 {np.percentile(lag, 50):5.1f} ms  p99 {np.percentile(lag, 99):6.1f} ms   peak {memory:.0f} MB"
        )


def wait(condition: Callable[[], bool], timeout: float = 120.0) -> None:
    """Let the window work until ``condition`` holds. Raises TimeoutError."""
    deadline = time.monotonic() + timeout
    while not condition():
        if time.monotonic() > deadline:
            raise TimeoutError("the window did not get there")
        QTest.qWait(20)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=15.0, help="per figure")
    given = parser.parse_args()
    app = QApplication([])
    theme.apply(app, theme.LIGHT)
    print(f"load of the machine before: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    with tempfile.TemporaryDirectory() as folder:
        window = opened(BenchSettings(out=Path(folder), seed=1), Path(folder))
        meter = Meter(window)
        meter.begin()
        QTest.qWait(round(1e3 * given.seconds / 3))
        print(meter.line("nothing connected"))
        for name in ("aspiration", "microrobot"):
            window.instruments.choose(name)
            window.instruments.rows[name].button.click()
            wait(lambda: window.controls.start_button.isEnabled())
        for name, what in (("microrobot", "six 1 kHz channels, run"), ("aspiration", "camera with contour, run")):
            window.instruments.choose(name)
            wait(lambda: window.controls.start_button.isEnabled())
            window.controls.start_button.click()
            wait(lambda name=name: window.views[name].elapsed > 1.0)
            meter.begin()
            QTest.qWait(round(1e3 * given.seconds))
            print(meter.line(what))
            window.controls.stop_button.click()
            wait(lambda name=name: window.views[name].state == "aborted")
        window.shut()
        stops(Path(folder))


def opened(bench: BenchSettings, folder: Path) -> MainWindow:
    """A window whose worker is up."""
    store = QSettings(str(folder / "settings.ini"), QSettings.Format.IniFormat)
    window = MainWindow(bench, store)
    window.resize(*WINDOW)
    window.show()
    wait(lambda: window.prepare.preview is not None)
    return window


def stops(folder: Path) -> None:
    """How long an emergency stop takes to reach the device: by the window's button, by Ctrl-C with the window frozen.

    The device is simulated in this process and reached over TCP. Venting itself then takes what the physics takes.
    """
    with serve("cutometer", "tcp", watchdog=1.0) as server:
        station = folder / "station.yaml"
        entry = f"{{address: '{server.entry.address}', simulated: true, watchdog: 1 s, interlock: {{stale: 5 s}}}}"
        station.write_text(f"schema: station/1\ninstruments:\n  cutometer: {entry}\n")
        window = opened(BenchSettings(station=station, out=folder), folder)
        door = server.back_door
        window.instruments.rows["cutometer"].button.click()
        for what in ("by the button", "by Ctrl-C, window frozen"):
            wait(lambda: window.controls.start_button.isEnabled())
            window.controls.start_button.click()
            wait(lambda: door.truth().signals.get("line_pressure", 0.0) < -20e3)
            began = time.perf_counter()
            if what == "by the button":
                window.controls.estop_button.pressed.emit()
            else:
                os.kill(window.client.process.pid or 0, signal.SIGINT)
            while door.truth().state == "running":
                time.sleep(0.0005)
            told = time.perf_counter() - began
            door.wait_vented()
            vented = time.perf_counter() - began
            print(
                f"emergency stop {what:<25} device told after {1e3 * told:4.0f} ms, vented after {1e3 * vented:4.0f} ms"
            )
            wait(lambda: window.views["cutometer"].state == "tripped" and window.alarm.isVisible())
            window.reset()
            wait(lambda: window.views["cutometer"].state == "ready")
        window.shut()


if __name__ == "__main__":
    main()
