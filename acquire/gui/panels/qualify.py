"""Qualification from the window: the steps of ``acquire qualify``, one after the other, and its result."""

from __future__ import annotations

import re
import time
from pathlib import Path

from PySide6.QtCore import QUrl
from PySide6.QtGui import QDesktopServices
from PySide6.QtWidgets import (
    QComboBox,
    QHBoxLayout,
    QLabel,
    QPlainTextEdit,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

from acquire.gui.jobs import Tool
from acquire.gui.messages import BenchSettings
from acquire.gui.panels.result import PictureView
from acquire.gui.pictures import pictures
from gap.qualify.steps import STANDARD

_STEP = re.compile(r"step (\d+) of (\d+), ([^:]+): (.*)")
FOLDER = "qualification"  # beside the recordings


class QualifyPanel(QWidget):
    """Walks a person through the standard references. ``bench`` is the window's bench.

    The work is done by the command line's tool in a process of its own: finished recordings stay in the folder, and the
    same instrument goes on there.
    """

    def __init__(self, bench: BenchSettings, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.bench = bench
        self._tool: Tool | None = None
        heading = QLabel("Is the instrument sound?")
        heading.setProperty("role", "title")
        words = QLabel(
            "Measures reference specimens and judges the instrument by them, in about five minutes. A real instrument "
            "must be disconnected here first. Recordings are kept: the same instrument goes on where it stopped."
        )
        words.setProperty("role", "faint")
        words.setWordWrap(True)
        self.instrument = QComboBox()
        self.instrument.addItems(list(STANDARD))
        self.start, self.go_on, self.stop = (QPushButton(t) for t in ("Start", "It is mounted: go on", "Stop"))
        self.page = QPushButton("Open the page")
        self.steps = QLabel("")
        self.steps.setWordWrap(True)
        self.instruction = QLabel("")
        self.instruction.setProperty("role", "title")
        self.instruction.setWordWrap(True)
        self.said = QPlainTextEdit()
        self.said.setReadOnly(True)
        self.said.setMaximumHeight(140)
        self.said.setMinimumHeight(48)
        self.said.setPlaceholderText("Messages stand here while it works, its page below.")
        self.picture = PictureView()
        row = QHBoxLayout()
        row.addWidget(self.instrument, 1)
        for button in (self.start, self.go_on, self.stop, self.page):
            row.addWidget(button)
        column = QVBoxLayout(self)
        column.addWidget(heading)
        column.addWidget(words)
        column.addLayout(row)
        column.addWidget(self.steps)
        column.addWidget(self.instruction)
        column.addWidget(self.said)
        column.addWidget(self.picture, 1)
        self.instrument.currentTextChanged.connect(self._list)
        self.start.clicked.connect(self.run)
        self.go_on.clicked.connect(self._mounted)
        self.stop.clicked.connect(self._cancel)
        self.page.clicked.connect(lambda: QDesktopServices.openUrl(QUrl.fromLocalFile(str(self._page))))
        self._list(self.instrument.currentText())

    @property
    def running(self) -> bool:
        """Whether a qualification is under way."""
        return self._tool is not None

    @property
    def waiting(self) -> bool:
        """Whether it waits for a person to mount something."""
        return self.go_on.isEnabled()

    @property
    def folder(self) -> Path:
        """Where it is kept: a folder for each instrument and day."""
        return self.bench.out / FOLDER / f"{self.instrument.currentText()}-{time.strftime('%Y%m%d')}"

    @property
    def _page(self) -> Path:
        return self.folder / "qualification.html"

    def run(self) -> None:
        """Begin, or go on."""
        bench, kind = self.bench, self.instrument.currentText()
        simulated = ["--sim", "--speed", f"{bench.speed:g}"]
        where = ["--station", str(bench.station)] if bench.station is not None else simulated
        self.said.clear()
        self.picture.show_png(b"")
        self._tool = Tool(["qualify", kind, *where, "--jobs", "1", "-o", str(self.folder)], self)
        self._tool.said.connect(self._hear)
        self._tool.ended.connect(self._ended)
        self._enable()

    def close_tool(self) -> None:
        """End the running step; an instrument makes itself safe when nobody beats for it."""
        if self._tool is not None:
            self._tool.close()
            self._tool = None

    def _list(self, kind: str) -> None:
        self._show_steps(0)
        self.instruction.setText("")
        self._enable()

    def _show_steps(self, current: int) -> None:
        steps = enumerate(STANDARD[self.instrument.currentText()], start=1)
        texts = [f"<b>{n} {s.name}</b>" if n == current else f"{n} {s.name}" for n, s in steps]
        self.steps.setText(" · ".join(texts))

    def _hear(self, line: str) -> None:
        found = _STEP.fullmatch(line)
        if found is None:
            if "mounted; q to stop" not in line:
                self.said.appendPlainText(line)
            return
        self._show_steps(int(found[1]))
        self.instruction.setText(found[4])
        self._enable(waiting=True)

    def _mounted(self) -> None:
        if self._tool is not None:
            self._tool.answer("\n")
            self._enable()

    def _cancel(self) -> None:
        if self._tool is not None:
            self._tool.terminate()

    def _ended(self, code: int) -> None:
        self._tool = None
        said = {0: "Passed.", 6: "Not passed.", 5: "Stopped; the recordings are kept."}
        self.instruction.setText(said.get(code, f"Ended with status {code}."))
        found = pictures(self._page.read_text(encoding="utf-8")) if code in (0, 6) and self._page.is_file() else []
        self.picture.show_png(found[0] if found else b"")
        self._enable()

    def _enable(self, *, waiting: bool = False) -> None:
        self.start.setEnabled(not self.running)
        self.instrument.setEnabled(not self.running)
        self.go_on.setEnabled(waiting)
        self.stop.setEnabled(self.running)
        self.page.setEnabled(not self.running and self._page.is_file())
