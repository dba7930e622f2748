"""The window's pages for finished recordings, and the reader of their files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from PySide6.QtCore import QObject, Signal
from PySide6.QtWidgets import QWidget

from acquire.gui import dialogs, reading
from acquire.gui.jobs import Analyst
from acquire.gui.messages import Finished, Measurement
from acquire.gui.panels import tool
from acquire.gui.panels.banner import Banner
from acquire.gui.panels.browser import BrowserPanel
from acquire.gui.panels.result import ResultPanel


class Recordings(QObject):
    """The recordings of one folder; the window places the panels and calls `tick`."""

    read = Signal()  # the folder was read anew
    said = Signal(str)  # something went wrong, in plain words
    page_wanted = Signal(QWidget)  # a page that a person asked for
    result_ready = Signal(QWidget)  # a result is there: worth showing unless something more urgent goes on

    def __init__(self, folder: Path, operator: Callable[[], str], parent: QObject | None = None) -> None:
        """``operator()`` is who works here now."""
        super().__init__(parent)
        self.folder = folder
        self.operator = operator
        self.analyst = Analyst()
        self.offer = Banner("offer", "Recover", "Later")
        self.browser, self.result = BrowserPanel(), ResultPanel()
        self.diagnosis = tool.ToolPanel(
            "Why do simulation and measurement differ?",
            "Diagnoses recordings of one session together: where the gap arises, which effect makes it, how far it "
            "shrinks. It runs in a process of its own and may take minutes.",
            "forward model of another rig: file.py:Name",
            tool.diagnosis,
        )
        self.fit = tool.ToolPanel(
            "Fit a material model",
            "Identifies a model's parameters from the recordings together, by the solver plugin, with their errors. "
            "The model is one of 'acquire fit --list'.",
            "model",
            tool.fit,
        )
        self._abandoned: Sequence[Path] = ()
        self._finished: list[tuple[Measurement, int]] = []  # since the window was opened on this folder
        self.listed = False  # whether the folder has been read, so that repeats can be counted
        self.offer.accepted.connect(lambda: self.recover(self._abandoned))
        self.browser.refresh_wanted.connect(self.refresh)
        self.browser.open_wanted.connect(self.show_recording)
        self.browser.recover_wanted.connect(self.recover)
        self.browser.review_wanted.connect(self.review)
        self.browser.diagnose_wanted.connect(partial(self._hand_on, self.diagnosis))
        self.browser.fit_wanted.connect(partial(self._hand_on, self.fit))

    def open_folder(self, folder: Path) -> None:
        """Another folder."""
        self.folder, self.listed = folder, False
        self._finished.clear()
        self.refresh()

    def refresh(self) -> None:
        """Read the list of recordings anew."""
        self.analyst.ask(reading.listing, self.folder, then=self._show_rows, fault=self._unlisted)

    def finish(self, finished: Finished) -> None:
        """A run ended: the list is read anew, its result shown. Its repeat counts at once."""
        if finished.status == "completed":
            self._finished.append((finished.what, finished.repeat))
        self.refresh()
        if finished.recording is not None:
            self.show_recording(finished.recording)
        else:
            self.said.emit(f"No recording: {finished.reason}")

    def next_repeat(self, what: Measurement) -> int:
        """The repeat after the greatest one that was finished of ``what`` in this folder; stopped runs do not count."""
        done = [row.repeat for row in self.browser.rows if row.status == "completed" and row.what == what]
        return max([*done, *(repeat for measured, repeat in self._finished if measured == what)], default=0) + 1

    def show_recording(self, path: Path) -> None:
        """Read a recording and show its result."""
        self.result.show_waiting("Reading the recording …")
        self.analyst.ask(reading.result, path, then=self._show_result, fault=self.said.emit)

    def recover(self, journals: Sequence[Path]) -> None:
        """Make recordings of the journals a crash left."""
        self.offer.hide()
        for journal in journals:
            self.analyst.ask(reading.recovered, journal, then=lambda path: self.refresh(), fault=self.said.emit)

    def review(self, runs: Sequence[Path], include: bool) -> None:
        """Let runs count, or leave them out, for a reason that is asked for."""
        title = "Let it count" if include else "Leave it out"
        reason = dialogs.ask_line(self.browser, title, "Why? It is kept beside the recording, which is not changed.")
        if reason:
            asked = (list(runs), include, reason, self.operator())
            self.analyst.ask(reading.reviewed, *asked, then=lambda _: self.refresh(), fault=self.said.emit)

    def tick(self) -> None:
        """One turn of the window's timer."""
        self.analyst.poll()
        self.diagnosis.tick()
        self.fit.tick()

    def close(self) -> None:
        """End every process. Idempotent."""
        self.diagnosis.close_tool()
        self.fit.close_tool()
        self.analyst.close()

    def _unlisted(self, fault: str) -> None:
        self.listed = True  # nothing to count: repeats are a person's to set
        self.said.emit(fault)
        self.read.emit()

    def _show_rows(self, rows: tuple[reading.Row, ...]) -> None:
        self.browser.show_rows(self.folder, rows)
        self.listed = True
        self.read.emit()
        abandoned = [row.path for row in rows if row.path.suffix == ".journal"]
        if abandoned and set(abandoned) != set(self._abandoned):
            runs = "a run was" if len(abandoned) == 1 else f"{len(abandoned)} runs were"
            self.offer.say(f"The last time {runs} not finished (a crash, a power cut). The data are there.")
        self._abandoned = abandoned

    def _show_result(self, result: reading.Result) -> None:
        self.result.show_result(result)
        self.result_ready.emit(self.result)

    def _hand_on(self, panel: tool.ToolPanel, runs: Sequence[Path]) -> None:
        panel.choose(runs)
        self.page_wanted.emit(panel)
