"""Pictures of every panel of the window, from real runs on simulated instruments: ``make screenshots``."""

from __future__ import annotations

import argparse
import os
import shutil
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

from PySide6.QtCore import QSettings, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

from acquire.gui import theme
from acquire.gui.messages import BenchSettings
from acquire.gui.window import MainWindow

SIZE = (1440, 900)
SPEED = 10.0
TRIES = 4  # to connect, on a busy machine
FAULTY = """\
schema: protocol/1
name: too-deep
title: A protocol with two faults
instrument: cutometer
steps:
  - {type: wait, duration: 1 s}
  - {type: hold, suction: 900 mbar, duration: 8 s}
  - {type: wait, duration: 5}
  - {type: cycle, suction: 300 mbar, rate: 60 mbar}
"""
LEAKING = """\
schema: station/1
name: bench with a leak
instruments:
  cutometer:
    simulated: {tissue: forearm, effects: ["leak:shortfall=8 percent"], seed: 7}
    watchdog: 1 s
    interlock: {stale: 5 s}
"""


class Photographer:
    """Works a window as a person would, and takes pictures of it."""

    def __init__(
        self, folder: Path, runs: Path, store: QSettings, station: Path | None = None, speed: float = SPEED
    ) -> None:
        self.folder = folder
        self.window = MainWindow(BenchSettings(station=station, out=runs, speed=speed, seed=7), store)
        self.window.resize(*SIZE)
        self.window.show()
        self.wait(lambda: self.window.prepare.preview is not None)
        self.window.subject.subject.setText("P07")
        self.window.subject.site.setCurrentText("forearm")
        self.window.subject.operator.setText("AK")

    def wait(self, condition: Callable[[], bool], timeout: float = 90.0) -> None:
        """Let the window work until ``condition`` holds. Raises TimeoutError."""
        deadline = time.monotonic() + timeout
        while not condition():
            if time.monotonic() > deadline:
                rows = [
                    f"{row.info.name} {row.state} {row.error.text()}" for row in self.window.instruments.rows.values()
                ]
                raise TimeoutError(f"the window did not get there: {'; '.join(rows)}; {self.window.missing}")
            QTest.qWait(10)

    def shoot(self, name: str) -> None:
        """Take the picture ``name``."""
        QTest.qWait(80)
        path = self.folder / f"{name}.png"
        self.window.grab().save(str(path))
        print(path)

    def ready(self, name: str) -> None:
        """Choose and connect an instrument."""
        window = self.window
        window.instruments.choose(name)
        row = window.instruments.rows[name]
        for _ in range(TRIES):
            if row.state in ("off", "idle"):
                row.button.click()
            self.wait(lambda: window.controls.start_button.isEnabled() or row.button.text() == "Retry")
            if window.controls.start_button.isEnabled():
                return
        raise TimeoutError(f"{name}: {row.error.text()}")

    def run(self, name: str, until: float) -> None:
        """Start the chosen protocol and wait until ``until`` of it is done."""
        window = self.window
        window.recordings.result.result = None
        window.controls.start_button.click()
        self.wait(lambda: window.views[name].duration > 0 and window.views[name].state == "running")
        self.wait(lambda: window.views[name].elapsed > until * window.views[name].duration)

    def finish(self) -> None:
        """Wait for the result."""
        self.wait(lambda: self.window.recordings.result.result is not None)

    def close(self) -> None:
        """Close the window."""
        self.window.shut()
        self.window.close()


def light(folder: Path, runs: Path, store: QSettings) -> None:
    """Every panel in light colours."""
    at = Photographer(folder, runs, store)
    window = at.window
    at.ready("aspiration")
    at.ready("microrobot")
    at.ready("cutometer")
    at.shoot("protocol")
    faulty = runs / "too-deep.yaml"
    faulty.write_text(FAULTY)
    entry = replace(window._entries[0], name="too-deep", title="from a file", instrument="cutometer", path=faulty)
    window.prepare.show_entries((*window._entries, entry), "cutometer", str(faulty))
    at.wait(lambda: window.prepare.fault.isVisible())
    at.shoot("protocol-fault")
    window.prepare.choose("demo-cutometer")
    at.wait(lambda: window.controls.start_button.isEnabled())
    for _ in range(2):
        at.run("cutometer", 0.6)
        if not window.subject.repeat.value() > 1:
            at.shoot("measure-cutometer")
        at.finish()
    at.shoot("result")
    window.recordings.result.pages.setCurrentIndex(1)
    at.shoot("result-compared")
    at.ready("microrobot")
    at.run("microrobot", 0.66)
    at.shoot("measure-microrobot")
    at.finish()
    at.shoot("result-microrobot")
    at.ready("aspiration")
    at.run("aspiration", 0.3)
    at.shoot("measure-aspiration")
    QTest.keyClick(window, Qt.Key.Key_Escape)
    at.wait(lambda: window.views["aspiration"].state == "tripped")
    at.finish()
    at.shoot("emergency-stop")
    window.alarm.button.click()
    at.wait(lambda: not any(view.state == "tripped" for view in window.views.values()))
    window.recordings.refresh()
    at.wait(lambda: window.recordings.browser.table.rowCount() >= 4)
    window.tabs.setCurrentWidget(window.recordings.browser)
    window.recordings.browser.table.selectRow(window.recordings.browser.table.rowCount() - 1)
    at.shoot("recordings")
    at.close()


def tools(folder: Path, runs: Path, store: QSettings) -> None:
    """A diagnosis and a fit, of an instrument whose line leaks."""
    station = runs / "leaking.yaml"
    station.write_text(LEAKING)
    at = Photographer(folder, runs, store, station)
    window = at.window
    at.ready("cutometer")
    for _ in range(2):
        at.run("cutometer", 0.9)
        at.finish()
    window.recordings.refresh()
    at.wait(lambda: window.recordings.browser.table.rowCount() == 2 and not window.recordings.analyst.busy)
    window.tabs.setCurrentWidget(window.recordings.browser)
    window.recordings.browser.table.selectAll()
    window.recordings.browser.diagnose.click()
    window.recordings.diagnosis.start.click()
    at.wait(lambda: not window.recordings.diagnosis.running, timeout=600)
    at.shoot("diagnosis")
    window.tabs.setCurrentWidget(window.recordings.browser)
    window.recordings.browser.fit.click()
    window.recordings.fit.field.setText("suction_yeoh_qlv")
    window.recordings.fit.start.click()
    at.wait(lambda: not window.recordings.fit.running, timeout=900)
    window.recordings.fit.next.click()
    at.shoot("fit")
    window.tabs.setCurrentWidget(window.qualify)
    window.qualify.start.click()
    for _ in range(6):
        at.wait(lambda: window.qualify.waiting, timeout=120)
        window.qualify.go_on.click()
    at.wait(lambda: not window.qualify.running, timeout=600)
    at.shoot("qualify")
    at.close()


def live(folder: Path, runs: Path, store: QSettings) -> None:
    """A fit while a minute's hold goes on, in real time."""
    at = Photographer(folder, runs, store, speed=1.0)
    window, page = at.window, at.window.live_fit
    at.ready("cutometer")
    window.prepare.choose("cutometer-instant-300")
    at.wait(lambda: window.prepare.preview is not None and window.prepare.preview.name == "cutometer-instant-300")
    window.tabs.setCurrentWidget(page)
    at.wait(page.start.isEnabled)
    page.start.click()
    at.wait(lambda: page.bar.value() == page.bar.maximum() == 1, timeout=300)
    at.run("cutometer", 0.0)
    window.tabs.setCurrentWidget(page)
    at.wait(lambda: window.views["cutometer"].elapsed > 45.0)
    at.shoot("live-fit")
    at.close()


def dark(folder: Path, runs: Path, store: QSettings) -> None:
    """A run in dark colours, and the offer after a crash."""
    app = QApplication.instance()
    assert isinstance(app, QApplication)
    theme.apply(app, theme.DARK)
    at = Photographer(folder, runs, store)
    at.ready("microrobot")
    at.run("microrobot", 0.5)
    journal = next(runs.glob("*.journal"))
    shutil.copy(journal, runs / "left-by-a-crash.journal")  # what a power cut at this moment would leave
    at.shoot("measure-dark")
    at.finish()
    at.close()
    old = time.time() - 3600
    os.utime(runs / "left-by-a-crash.journal", (old, old))
    at = Photographer(folder, runs, store)
    at.wait(lambda: at.window.recordings.offer.isVisible())
    at.window.tabs.setCurrentWidget(at.window.recordings.browser)
    at.shoot("recovery-dark")
    at.close()


SETS: dict[str, Callable[[Path, Path, QSettings], None]] = {"light": light, "tools": tools, "live": live, "dark": dark}


def main() -> None:
    """Take them all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("docs/screenshots"))
    parser.add_argument("--only", choices=SETS, action="append", help="some of them; repeat for several")
    given = parser.parse_args()
    given.output.mkdir(parents=True, exist_ok=True)
    app = QApplication([])
    theme.apply(app, theme.LIGHT)
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_DATA_HOME"] = folder  # this machine's own qualifications are not in the pictures
        for name in given.only or SETS:
            runs = Path(folder) / name
            runs.mkdir()
            store = QSettings(str(Path(folder) / f"{name}.ini"), QSettings.Format.IniFormat)
            SETS[name](given.output, runs, store)


if __name__ == "__main__":
    main()
