"""The other panels: faults, recordings, recovery, tools, settings, a worker that dies."""

from __future__ import annotations

import os
import re
import signal
from pathlib import Path

import pytest
from PySide6.QtCore import QSettings
from pytestqt.qtbot import QtBot

from acquire import pseudonym
from acquire.gui import reading, settings
from acquire.gui.messages import ProtocolEntry
from acquire.gui.panels.tool import ToolPanel
from acquire.gui.pictures import pictures
from acquire.recording import JournalWriter, RunInfo, open_recording
from acquire.words import clock, span
from tests.acquire.gui.conftest import PATIENCE, MakeWindow

FAULTY = """\
schema: protocol/1
name: faulty
instrument: cutometer
steps:
  - {type: wait, duration: 1 s}
  - {type: wait, duration: 5}
"""


@pytest.fixture
def crashed(tmp_path: Path) -> Path:
    """A journal that a crash left."""
    (tmp_path / "runs").mkdir()
    path = tmp_path / "runs" / "left.journal"
    writer = JournalWriter(path, RunInfo("left", "cutometer", "2026-01-01T00:00:00", subject="P9"), ())
    os.close(writer.descriptor)  # as a kill does
    return path


def test_faults_and_recovery_and_a_dead_worker(
    qtbot: QtBot, make_window: MakeWindow, crashed: Path, tmp_path: Path
) -> None:
    window = make_window()
    # A protocol with a fault is shown with its line, and cannot be started.
    faulty = tmp_path / "faulty.yaml"
    faulty.write_text(FAULTY)
    window.prepare.show_entries((ProtocolEntry("faulty", "", "", faulty),), "cutometer", str(faulty))
    qtbot.waitUntil(lambda: window.prepare.fault.isVisible(), timeout=PATIENCE)
    assert "line 6" in window.prepare.fault.text()
    assert [mark.cursor.blockNumber() for mark in window.prepare.text.extraSelections()] == [5]
    assert not window.ready
    # The remains of a crash are offered, and become a recording.
    qtbot.waitUntil(lambda: window.recordings.offer.isVisible(), timeout=PATIENCE)
    window.recordings.offer.button.click()
    qtbot.waitUntil(lambda: any(row.status == "recovered" for row in window.recordings.browser.rows), timeout=PATIENCE)
    assert not crashed.exists()
    assert open_recording(crashed.with_suffix(".h5")).info.subject == "P9"
    assert not window.recordings.offer.isVisible()
    # The browser finds it and hands it on.
    window.recordings.browser.filter.setText("p9 recovered")
    assert not window.recordings.browser.table.isRowHidden(0)
    window.recordings.browser.filter.setText("nobody")
    assert window.recordings.browser.table.isRowHidden(0)
    window.recordings.browser.filter.clear()
    window.recordings.browser.table.selectRow(0)
    window.recordings.browser.diagnose.click()
    assert window.tabs.currentWidget() is window.recordings.diagnosis
    assert "left" in window.recordings.diagnosis.chosen.text()
    # A worker that dies is told, and another one started.
    pid = window.client.process.pid
    assert pid is not None
    os.kill(pid, signal.SIGKILL)
    qtbot.waitUntil(lambda: window.alarm.isVisible(), timeout=PATIENCE)
    assert "worker" in window.alarm.text.text()
    window.alarm.button.click()
    qtbot.waitUntil(lambda: window.client.alive and window.prepare.preview is not None, timeout=PATIENCE)
    assert window.client.process.pid != pid


def test_a_tool_runs_apart_and_shows_its_picture(qtbot: QtBot, tmp_path: Path) -> None:
    pixel = "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg=="
    panel = ToolPanel("Check", "", "", lambda runs, option, folder: ["check", "demo-cutometer"])
    qtbot.addWidget(panel)
    panel.choose([tmp_path / "a.h5"])
    panel.run()
    assert panel.running
    assert panel._folder is not None
    panel._folder.mkdir(parents=True)
    (panel._folder / "page.html").write_text(f'<img src="data:image/png;base64,{pixel}">')
    qtbot.waitUntil(lambda: not panel.running, timeout=PATIENCE)
    assert "cutometer" in panel.said.toPlainText()
    assert panel.picture.shown
    assert panel.status.text() == "done"


def test_a_tool_that_fails_or_is_cancelled_says_so(qtbot: QtBot, tmp_path: Path) -> None:
    panel = ToolPanel("Check", "", "", lambda runs, option, folder: ["check", "no-such-protocol"])
    qtbot.addWidget(panel)
    panel.choose([tmp_path / "a.h5"])
    panel.run()
    qtbot.waitUntil(lambda: not panel.running, timeout=PATIENCE)
    assert "status 2" in panel.status.text()
    panel.run()
    panel.cancel.click()
    qtbot.waitUntil(lambda: not panel.running, timeout=PATIENCE)
    assert panel.start.isEnabled()


def test_settings_come_back(store: QSettings, tmp_path: Path) -> None:
    gone = tmp_path / "gone.yaml"
    kept = settings.Remembered("dark", "there", str(gone), "AK", "microrobot", {"cutometer": "x.yaml"})
    settings.save(store, kept)
    again = settings.load(QSettings(store.fileName(), QSettings.Format.IniFormat))
    assert (again.theme, again.out, again.operator, again.instrument) == ("dark", "there", "AK", "microrobot")
    assert again.protocols == {"cutometer": "x.yaml"}
    assert again.station == str(gone)  # refused when it is opened, and no other bench in its place


def test_a_listing_leaves_out_the_run_that_goes_on(crashed: Path) -> None:
    assert [row.status for row in reading.listing(crashed.parent)] == ["not finished"]
    with JournalWriter(crashed.with_stem("going-on"), RunInfo("on", "cutometer", "2026-01-01T00:00:00"), ()):
        assert [row.path for row in reading.listing(crashed.parent)] == [crashed]
    assert reading.listing(crashed.parent / "nowhere") == ()


def test_words() -> None:
    assert re.fullmatch(r"P[2-9A-Z]{4}", pseudonym.check(pseudonym.fresh()))
    assert (clock(95.0), clock(4000.0), clock(float("nan"))) == ("1:35", "1:06:40", "–")
    assert (span(90.0), span(7200.0), span(86400.0 * 40)) == ("90 s", "2 h", "40 d")


def test_pictures_of_a_page() -> None:
    assert pictures("<p>nothing</p>") == []
    page = (
        "<p>src=\"data:image/png;base64,AAAA\" is only text</p><!-- <img src='data:image/png;base64,AAAA'> -->"
        "<img src='data:image/png;base64,aGVp'><img alt=a>1 SRC="
        '<IMG alt="a > b" SRC="data:image/svg+xml;base64,PHN2Zy8+"/><img src="other.png">'
        '<img src="data:image/png;base64,not base64">'
    )
    assert pictures(page) == [b"hei", b"<svg/>"]


def test_the_qualification_waits_for_each_specimen(
    qtbot: QtBot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each step is told, the tool hears that it is mounted, and the end is said."""
    from PySide6.QtCore import QObject, Signal

    from acquire.gui.messages import BenchSettings
    from acquire.gui.panels import qualify

    class Scripted(QObject):
        said, ended = Signal(str), Signal(int)

        def __init__(self, arguments: list[str], parent: QObject | None = None) -> None:
            super().__init__(parent)
            self.arguments, self.heard = arguments, ""

        def answer(self, text: str) -> None:
            self.heard += text

        def close(self) -> None: ...

    monkeypatch.setattr(qualify, "Tool", Scripted)
    panel = qualify.QualifyPanel(BenchSettings(out=tmp_path, speed=50))
    qtbot.addWidget(panel)
    panel.instrument.setCurrentText("microrobot")
    assert not panel.waiting
    panel.start.click()
    tool = panel._tool
    assert isinstance(tool, Scripted)
    assert tool.arguments[:3] == ["qualify", "microrobot", "--sim"]
    tool.said.emit("step 2 of 5, spring: Join the probe's tip to the reference spring.")
    assert panel.waiting
    assert "<b>2 spring</b>" in panel.steps.text()
    assert "Join" in panel.instruction.text()
    panel.go_on.click()
    assert tool.heard == "\n"
    assert not panel.waiting
    tool.ended.emit(6)
    assert panel.instruction.text() == "Not passed."
    assert not panel.running
