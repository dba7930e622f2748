"""What fits where: a small laptop's screen, long pseudonyms, empty pages, lists that can be read."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QApplication
from pytestqt.qtbot import QtBot

from acquire.gui import dialogs, theme
from acquire.gui.layout import Layout
from acquire.gui.messages import FROM_FILE, BenchSettings, ChannelInfo, InstrumentInfo, ProtocolEntry
from acquire.gui.panels.browser import COLUMNS
from acquire.gui.panels.measure import MeasurePanel
from acquire.gui.panels.prepare import PreparePanel
from acquire.gui.plots import plot
from acquire.gui.reading import Result, Row
from protocols import ProtocolError, find, library
from tests.acquire.gui.conftest import MakeWindow

SMALL = (960, 540)  # what a screen of 1024 x 600 leaves
LONG = "P" * 40
SUMMARY = {
    "protocol": "demo-cutometer", "id": "x", "status": "completed", "device": "cutometer", "subject": LONG,
    "site": "forearm", "repeat": 1, "specimen": "skin", "start_time": "2026-01-01T10:00:00", "directions": [],
    "left_out": "the run was paused: its time course is not its protocol's", "parameters": {"Uf": 2e-4},
    "quality": [{"level": "warning", "name": name, "text": "a sentence as long as they are " * 2} for name in "abcd"],
}  # fmt: skip


@pytest.fixture
def layout(qapp: QApplication, qtbot: QtBot, tmp_path: Path) -> Iterator[Layout]:
    """The window without a worker, with everything in it that takes room."""
    theme.apply(qapp, theme.LIGHT)
    window = Layout(BenchSettings(out=tmp_path))
    qtbot.addWidget(window)
    robot = tuple(ChannelInfo(f"{of}_{k}", unit) for of, unit in (("probe", "m"), ("force", "N")) for k in "xyz")
    suction = (ChannelInfo("pressure", "Pa"), ChannelInfo("apex_height", "m"))
    infos = (
        InstrumentInfo("microrobot", "microrobot", "Three-axis micro-robot", True, robot, False),
        InstrumentInfo("aspiration", "aspiration", "ETH aspiration device", True, suction, True),
    )
    window.instruments.show_bench("simulated bench", infos)
    for info in infos:
        window.measure.addWidget(MeasurePanel(info))
    window.subject.subject.setText(LONG)
    runs = [tmp_path / f"20260101-100000-demo-cutometer-{k}.h5" for k in range(5)]
    window.recordings.diagnosis.choose(runs)
    window.recordings.browser.show_rows(
        tmp_path, tuple(Row(run, "2026-01-01", "cutometer", "demo", LONG, "arm", 1, "completed") for run in runs)
    )
    window.recordings.result.show_result(Result(runs[0], SUMMARY, b"", b"", ()))
    window.show()
    yield window
    window.recordings.close()


def test_every_page_fits_a_small_screen(qtbot: QtBot, layout: Layout) -> None:
    layout.resize(1600, 900)
    QApplication.processEvents()
    layout.resize(1024, 600)
    for number in range(layout.tabs.count()):
        layout.tabs.setCurrentIndex(number)
        qtbot.wait(20)
        least = layout.minimumSizeHint()
        assert least.width() <= SMALL[0], layout.tabs.tabText(number)
        assert least.height() <= SMALL[1], layout.tabs.tabText(number)
    layout.resize(*SMALL)
    qtbot.wait(20)
    assert (layout.width(), layout.height()) == SMALL
    button = layout.controls.estop_button
    corner = button.mapTo(layout, button.rect().bottomRight())
    assert layout.rect().contains(corner)


def test_a_long_pseudonym_is_elided_and_its_tool_tip_whole(qtbot: QtBot, layout: Layout) -> None:
    layout.tabs.setCurrentWidget(layout.recordings.browser)
    layout.resize(1024, 600)
    qtbot.wait(20)
    table = layout.recordings.browser.table
    subject, protocol = COLUMNS.index("subject"), COLUMNS.index("protocol")
    assert table.columnWidth(subject) < table.fontMetrics().horizontalAdvance(LONG) / 2
    assert table.columnWidth(protocol) > table.fontMetrics().horizontalAdvance("demo")
    cell = table.item(0, subject)
    assert cell is not None
    assert LONG in cell.toolTip()
    assert LONG in layout.subject.subject.toolTip()
    layout.tabs.setCurrentWidget(layout.recordings.result)
    qtbot.waitUntil(lambda: LONG in layout.recordings.result.subtitle.toolTip())
    assert layout.recordings.result.subtitle.height() < 2 * layout.fontMetrics().height()
    assert "demo-cutometer-4" in layout.recordings.diagnosis.chosen.whole


def test_quality_and_parameters_are_a_page_where_there_is_no_height(qtbot: QtBot, layout: Layout) -> None:
    panel = layout.recordings.result
    layout.tabs.setCurrentWidget(panel)
    layout.resize(1600, 900)
    qtbot.waitUntil(lambda: panel.pages.indexOf(panel.details) < 0 and panel.details.isVisible())
    layout.resize(1024, 700)
    qtbot.waitUntil(lambda: panel.pages.indexOf(panel.details) == 2)
    assert panel.pages.height() > 200
    panel.pages.setCurrentWidget(panel.details)
    assert panel.table.isVisible()


def test_a_title_that_does_not_fit_leaves_its_unit(qtbot: QtBot) -> None:
    widget = plot("time", "s", "apex height", "mm")
    qtbot.addWidget(widget)
    widget.show()
    for height, expected in ((300, "apex height (mm)"), (110, "mm"), (300, "apex height (mm)")):
        widget.resize(300, height)
        qtbot.waitUntil(lambda expected=expected: widget.getAxis("left").labelText == expected)


def test_what_the_window_says_can_be_seen(qtbot: QtBot, layout: Layout) -> None:
    layout._say("Stop the run before changing the bench.")
    qtbot.wait(20)
    assert layout.said.isVisible()
    assert layout.said.width() > 100


def test_empty_pages_say_what_to_do(qapp: QApplication, qtbot: QtBot, tmp_path: Path) -> None:
    window = Layout(BenchSettings(out=tmp_path))
    qtbot.addWidget(window)
    window.show()
    browser, result = window.recordings.browser, window.recordings.result
    browser.show_rows(tmp_path, ())
    window.tabs.setCurrentWidget(browser)
    assert browser.empty.isVisible()
    window.tabs.setCurrentWidget(result)
    assert not result.pages.isVisible()
    panel = MeasurePanel(InstrumentInfo("a", "a", "a", True, (ChannelInfo("pressure", "Pa"),), False))
    qtbot.addWidget(panel)
    panel.live.tell()
    assert "Connect" in panel.live.head.text()
    window.recordings.close()


def entries() -> tuple[ProtocolEntry, ...]:
    return tuple(ProtocolEntry(name, f"About {name}", "cutometer", path) for name, path in library().items())


def test_the_list_of_protocols_is_grouped(qtbot: QtBot) -> None:
    panel = PreparePanel()
    qtbot.addWidget(panel)
    opened = replace(entries()[0], name="mine", title=FROM_FILE, path=Path("mine.yaml"))
    panel.show_entries((*entries(), opened), "cutometer")
    items = [panel.list.item(row) for row in range(panel.list.count())]
    headings = [item.text() for item in items if not item.flags() & Qt.ItemFlag.ItemIsEnabled]
    assert headings == ["To try it out", "Measurements", "Qualification on reference specimens", "From files"]
    assert len(items) == len(entries()) + 1 + len(headings)
    assert "demo" in panel.chosen
    assert items[-1].text() == "mine"
    panel.choose("mine")
    assert panel.chosen == "mine.yaml"
    panel.choose("qualify-step-cutometer")
    assert panel.chosen.endswith("qualify-step-cutometer.yaml")


def test_a_protocol_that_is_gone_is_told_in_one_line(qtbot: QtBot, tmp_path: Path) -> None:
    panel = PreparePanel()
    qtbot.addWidget(panel)
    path = tmp_path / "some" / "gone.yaml"
    with pytest.raises(ProtocolError) as caught:
        find(path)
    panel.show_faults(path, str(caught.value), ())
    told = panel.fault.text() + panel.words.toPlainText() + panel.text.toPlainText()
    assert not [name for name in library() if name in told]
    assert len(panel.fault.text().splitlines()) == 1
    assert panel.fault.text() not in panel.words.toPlainText()  # not twice


def test_a_file_that_is_opened_twice_is_listed_once(
    qtbot: QtBot, make_window: MakeWindow, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mine = tmp_path / "mine.yaml"
    mine.write_text(find("demo-cutometer").read_text())
    monkeypatch.setattr(dialogs, "ask_file", lambda *_: str(mine))
    window = make_window()
    for _ in range(2):
        window.prepare.open.click()
    assert [entry.name for entry in window.prepare.entries].count("mine") == 1
