"""The window at work: frames per second, processor time and the event loop's lag, with all instruments delivering.

The micro-robot (1 kHz, six curves drawn) runs its protocol while the aspiration device's camera delivers frames; the
window shows the one, then the other. Processor time is that of the window's process alone, as a share of one core.
"""

from __future__ import annotations

import argparse
import os
import resource
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
        store = QSettings(str(Path(folder) / "settings.ini"), QSettings.Format.IniFormat)
        window = MainWindow(BenchSettings(out=Path(folder), seed=1), store)
        window.resize(*WINDOW)
        window.show()
        wait(lambda: window.prepare.preview is not None)
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
        window.close()


if __name__ == "__main__":
    main()
