"""A record to trust: the window shows, counts and hands on the files' contents. Worked by mouse and keys."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import Qt, QTimer
from PySide6.QtWidgets import QApplication, QInputDialog, QLineEdit, QTableWidget
from pytestqt.qtbot import QtBot

from acquire.gui.window import MainWindow
from acquire.recording import Event, Recording, RunInfo, Series, open_recording, write_recording
from acquire.session import Request
from tests.acquire.gui.conftest import PATIENCE, MakeWindow, connected, press, state


def filed(folder: Path, name: str, day: int, *, events: tuple[Event, ...] = (), **more: object) -> Path:
    """A finished recording of P07 on the forearm that began on ``day`` of a January."""
    facts = {"protocol_name": "demo-cutometer", "subject": "P07", "site": "forearm", **more}
    info = RunInfo(name, "cutometer", f"2026-01-{day:02}T10:00:00", **facts)  # type: ignore[arg-type]
    time = np.linspace(0, 1, 50)
    return write_recording(
        Recording(info, {"pressure": Series(-3e4 * time, time, "Pa")}, events=events), folder / f"{name}.h5"
    )


def click_row(qtbot: QtBot, table: QTableWidget, text: str, keys: Qt.KeyboardModifier | None = None) -> None:
    """Click the row of the recording ``text``."""
    cells = [table.item(row, 0) for row in range(table.rowCount())]
    cell = next(cell for cell in cells if cell is not None and f"{text}.h5" in cell.toolTip())
    where = table.visualItemRect(cell).center()
    modifier = keys or Qt.KeyboardModifier.NoModifier
    qtbot.mouseClick(table.viewport(), Qt.MouseButton.LeftButton, modifier, where)


def listed(qtbot: QtBot, window: MainWindow, count: int) -> QTableWidget:
    table = window.recordings.browser.table
    qtbot.waitUntil(lambda: table.rowCount() == count, timeout=PATIENCE)
    window.tabs.setCurrentWidget(window.recordings.browser)
    return table


def test_the_chosen_files_stay_chosen_when_the_list_moves(qtbot: QtBot, make_window: MakeWindow, runs: Path) -> None:
    for day, name in enumerate(("one", "two", "three"), 1):
        filed(runs, name, day)
    window = make_window()
    table = listed(qtbot, window, 3)
    click_row(qtbot, table, "one")
    click_row(qtbot, table, "two", Qt.KeyboardModifier.ControlModifier)
    filed(runs, "four", 4)  # another run ends: it comes first in the list
    (runs / "two.h5").rename(runs / "elsewhere.h5")
    press(qtbot, window.recordings.browser.refresh)
    listed(qtbot, window, 4)
    for button, panel in (
        (window.recordings.browser.diagnose, window.recordings.diagnosis),
        (window.recordings.browser.fit, window.recordings.fit),
    ):
        window.tabs.setCurrentWidget(window.recordings.browser)
        press(qtbot, button)
        assert panel.chosen.text() == "1 recording: one"
        assert [path.name for path in panel._runs] == ["one.h5"]
    # Hidden by a filter, a run is not handed on.
    window.tabs.setCurrentWidget(window.recordings.browser)
    qtbot.keyClicks(window.recordings.browser.filter, "four")
    assert window.recordings.browser.chosen == []
    assert not window.recordings.browser.diagnose.isEnabled()


def test_repeats_are_counted_from_the_folder(qtbot: QtBot, make_window: MakeWindow, runs: Path) -> None:
    filed(runs, "one", 1, repeat=1)
    filed(runs, "two", 2, repeat=2)
    filed(runs, "stopped", 3, repeat=3, status="aborted")
    filed(runs, "other", 4, repeat=7, subject="P08")
    filed(runs, "cheek", 5, repeat=5, site="cheek")
    filed(runs, "slow", 6, repeat=9, protocol_name="cutometer-ramp")
    window = make_window()
    listed(qtbot, window, 6)
    subject = window.subject
    subject.subject.selectAll()
    qtbot.keyClicks(subject.subject, "P07")
    subject.site.setCurrentText("forearm")
    assert subject.repeat.value() == 3
    subject.site.setCurrentText("cheek")
    assert subject.repeat.value() == 6
    subject.site.setCurrentText("forearm")
    # A number set by hand holds, also while the list is read anew, until something else is measured.
    subject.repeat.setFocus()
    qtbot.keyClick(subject.repeat, Qt.Key.Key_Up)
    press(qtbot, window.recordings.browser.refresh)
    qtbot.waitUntil(lambda: not window.recordings.analyst.busy, timeout=PATIENCE)
    assert subject.repeat.value() == 4
    subject.subject.selectAll()
    qtbot.keyClicks(subject.subject, "P08")
    assert subject.repeat.value() == 8


def test_the_finished_run_counts_not_the_selected_row(qtbot: QtBot, make_window: MakeWindow) -> None:
    window = make_window()
    connected(qtbot, window, "cutometer")
    window.subject.subject.selectAll()
    qtbot.keyClicks(window.subject.subject, "P07")
    press(qtbot, window.controls.start_button)
    qtbot.waitUntil(lambda: state(window, "cutometer") == "running", timeout=PATIENCE)
    press(qtbot, window.instruments.rows["microrobot"])
    qtbot.waitUntil(lambda: state(window, "cutometer") == "completed", timeout=PATIENCE)
    listed(qtbot, window, 1)
    assert window.subject.repeat.value() == 1
    press(qtbot, window.instruments.rows["cutometer"])
    qtbot.waitUntil(lambda: window.subject.repeat.value() == 2, timeout=PATIENCE)
    window.shut()
    # Also on another day.
    window = make_window()
    listed(qtbot, window, 1)
    press(qtbot, window.instruments.rows["cutometer"])
    window.subject.subject.selectAll()
    qtbot.keyClicks(window.subject.subject, "P07")
    qtbot.waitUntil(lambda: window.subject.repeat.value() == 2, timeout=PATIENCE)


def test_a_pseudonym_is_no_path_and_no_name(qtbot: QtBot, make_window: MakeWindow) -> None:
    window = make_window()
    qtbot.waitUntil(lambda: window.recordings.listed, timeout=PATIENCE)
    for text in ("../../etc", "a/b", "C:\\temp", ".hidden", "Jane Doe", "P" * 41):
        window.subject.subject.selectAll()
        qtbot.keyClicks(window.subject.subject, text)
        assert not window.ready, text
        assert window.missing == "write a pseudonym"
        assert window.subject.fault.isVisible()
        assert "letters, digits" in window.subject.fault.text()
        with pytest.raises(ValueError, match="is no pseudonym"):
            Request(subject=text)  # what the command line asks
    window.subject.subject.selectAll()
    qtbot.keyClicks(window.subject.subject, "P07-b.2")
    assert window.ready
    assert not window.subject.fault.isVisible()


def test_stopped_tripped_and_paused_runs_do_not_count_until_a_person_says_so(
    qtbot: QtBot, make_window: MakeWindow, runs: Path
) -> None:
    paused = Event(0.5, "info", "pause", "vented and held")
    for day, (name, more, events) in enumerate(
        (
            ("good", {}, ()),
            ("stopped", {"status": "aborted"}, ()),
            ("tripped", {"status": "tripped", "trip_reason": "limit: too far"}, ()),
            ("paused", {}, (paused,)),
        ),
        1,
    ):
        filed(runs, name, day, events=events, **more)
    before = {path.name: path.read_bytes() for path in runs.iterdir()}
    window = make_window()
    table = listed(qtbot, window, 4)
    browser = window.recordings.browser
    assert counts(table) == {"good": "yes", "stopped": "no", "tripped": "no", "paused": "no"}
    # A person leaves a run out: the reason is asked for, and kept beside the recording.
    click_row(qtbot, table, "good")
    answer(qtbot, "the device slipped")
    press(qtbot, browser.leave_out)
    qtbot.waitUntil(lambda: counts(table)["good"] == "no", timeout=PATIENCE)
    # Or lets one count.
    click_row(qtbot, table, "paused")
    answer(qtbot, "paused before the first suction")
    press(qtbot, browser.count)
    qtbot.waitUntil(lambda: counts(table)["paused"] == "yes", timeout=PATIENCE)
    # Without a reason nothing is decided.
    click_row(qtbot, table, "tripped")
    answer(qtbot, "")
    press(qtbot, browser.count)
    assert not window.recordings.analyst.busy
    assert {path.name: path.read_bytes() for path in runs.glob("*.h5")} == before
    from acquire.recording import left_out  # here, so that the other tests can be tried on revisions without it

    assert left_out(open_recording(runs / "good.h5")) == "left out: the device slipped"
    # The list says which are shown.
    click_row(qtbot, table, "tripped")
    press(qtbot, browser.look)
    qtbot.waitUntil(lambda: window.recordings.result.result is not None, timeout=PATIENCE)
    window.tabs.setCurrentWidget(window.recordings.result)
    assert "limit: too far" in window.recordings.result.left_out.text()
    assert window.recordings.result.left_out.isVisible()


def counts(table: QTableWidget) -> dict[str, str]:
    """File's stem -> ``yes`` or ``no`` in the column that says whether it counts."""
    found = {}
    for row in range(table.rowCount()):
        cell = table.item(row, table.columnCount() - 1)
        assert cell is not None
        found[Path(cell.toolTip().splitlines()[0]).stem] = cell.text().partition(":")[0]
    return found


def answer(qtbot: QtBot, text: str) -> None:
    """Type ``text`` into the dialog that is about to open, and accept it."""

    def type_it() -> None:
        box = QApplication.activeModalWidget()
        assert isinstance(box, QInputDialog)
        line = box.findChild(QLineEdit)
        qtbot.keyClicks(line, text)
        qtbot.keyClick(line, Qt.Key.Key_Return)

    QTimer.singleShot(100, type_it)
