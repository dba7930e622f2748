"""A record to trust: what the window shows, counts and hands on is what is in the files. Worked by mouse and keys."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QTableWidget
from pytestqt.qtbot import QtBot

from acquire.gui.window import MainWindow
from acquire.recording import Recording, RunInfo, Series, write_recording
from acquire.session import Request
from tests.acquire.gui.conftest import PATIENCE, MakeWindow, connected, press, state


def filed(folder: Path, name: str, day: int, **more: object) -> Path:
    """A finished recording of P07 on the forearm that began on ``day`` of a January."""
    facts = {"protocol_name": "demo-cutometer", "subject": "P07", "site": "forearm", **more}
    info = RunInfo(name, "cutometer", f"2026-01-{day:02}T10:00:00", **facts)  # type: ignore[arg-type]
    time = np.linspace(0, 1, 50)
    return write_recording(Recording(info, {"pressure": Series(-3e4 * time, time, "Pa")}), folder / f"{name}.h5")


def click_row(qtbot: QtBot, table: QTableWidget, text: str, keys: Qt.KeyboardModifier | None = None) -> None:
    """Click the row one of whose cells says ``text`` in its tool tip."""
    cells = [table.item(row, 0) for row in range(table.rowCount())]
    cell = next(cell for cell in cells if cell is not None and text in cell.toolTip())
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
    # What a filter hides is not handed on.
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
        assert window.subject.fault.isVisible()
        assert "letters, digits" in window.subject.fault.text()
        with pytest.raises(ValueError, match="is no pseudonym"):
            Request(subject=text)  # what the command line asks
    window.subject.subject.selectAll()
    qtbot.keyClicks(window.subject.subject, "P07-b.2")
    assert window.ready
    assert not window.subject.fault.isVisible()
