"""Diagnosis and fit from the window: the command line's tool in its own process, its sentences, its pictures."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path

from PySide6.QtCore import Qt, QUrl
from PySide6.QtGui import QDesktopServices
from PySide6.QtWidgets import (
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QPlainTextEdit,
    QProgressBar,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

from acquire.gui.jobs import Tool
from acquire.gui.panels.elided import Elided
from acquire.gui.panels.result import PictureView
from acquire.gui.pictures import pictures

REPORTS = "reports"  # folder beside the recordings


class ToolPanel(QWidget):
    """Runs one tool on recordings.

    ``arguments(runs, option, folder)`` is the command line after ``acquire``; ``option`` is the text of the
    panel's one field. The tool leaves an HTML page with its pictures in ``folder``, beside the recordings.
    """

    def __init__(
        self,
        title: str,
        explanation: str,
        field: str,
        arguments: Callable[[Sequence[Path], str, Path], list[str]],
        default: str = "",
        parent: QWidget | None = None,
    ) -> None:
        super().__init__(parent)
        self._arguments = arguments
        self._runs: tuple[Path, ...] = ()
        self._tool: Tool | None = None
        self._folder: Path | None = None
        self._began = 0.0
        self._pictures: list[bytes] = []
        self._number = 0
        heading = QLabel(title)
        heading.setProperty("role", "title")
        words = QLabel(explanation)
        words.setProperty("role", "faint")
        words.setWordWrap(True)
        self.chosen = Elided("No recordings chosen: choose them under Recordings.")
        self.field = QLineEdit(default)
        self.field.setPlaceholderText(field)
        self.start = QPushButton("Start")
        self.cancel = QPushButton("Cancel")
        self.page = QPushButton("Open the page")
        self.start.clicked.connect(self.run)
        self.cancel.clicked.connect(self._cancel)
        self.page.clicked.connect(self._open_page)
        self.bar = QProgressBar()
        self.bar.setRange(0, 1)
        self.status = QLabel("")
        self.said = QPlainTextEdit()
        self.said.setReadOnly(True)
        self.said.setMaximumHeight(170)
        self.said.setMinimumHeight(48)
        self.said.setPlaceholderText("Messages stand here while it works, its pictures below.")
        self.picture = PictureView()
        self.previous, self.next = QPushButton("◀"), QPushButton("▶")
        self.previous.clicked.connect(lambda: self._turn(-1))
        self.next.clicked.connect(lambda: self._turn(+1))
        row = QHBoxLayout()
        row.addWidget(self.field, 1)
        for button in (self.start, self.cancel, self.page):
            row.addWidget(button)
        progress = QHBoxLayout()
        progress.addWidget(self.bar, 1)
        progress.addWidget(self.status)
        progress.addWidget(self.previous)
        progress.addWidget(self.next)
        column = QVBoxLayout(self)
        column.addWidget(heading)
        column.addWidget(words)
        column.addWidget(self.chosen)
        column.addLayout(row)
        column.addLayout(progress)
        column.addWidget(self.said)
        column.addWidget(self.picture, 1)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self._enable()

    @property
    def running(self) -> bool:
        """Whether the tool runs."""
        return self._tool is not None

    def choose(self, runs: Sequence[Path]) -> None:
        """The recordings to work on."""
        self._runs = tuple(runs)
        self.chosen.whole = "\n".join(path.stem for path in self._runs)
        names = ", ".join(path.stem for path in self._runs[:3])
        more = f" and {len(self._runs) - 3} more" if len(self._runs) > 3 else ""
        self.chosen.setText(f"{len(self._runs)} recording{'s' * (len(self._runs) != 1)}: {names}{more}")
        self._enable()

    def run(self) -> None:
        """Start the tool."""
        self.close_tool()
        arguments = self._arguments(self._runs, self.field.text().strip(), Path())
        self._folder = self._runs[0].parent / REPORTS / f"{arguments[0]}-{time.strftime('%Y%m%d-%H%M%S')}"
        self._tool = Tool(self._arguments(self._runs, self.field.text().strip(), self._folder), self)
        self._tool.said.connect(self.said.appendPlainText)
        self._tool.ended.connect(self._ended)
        self._began = time.monotonic()
        self._pictures = []
        self.picture.show_png(b"")
        self.said.clear()
        self.bar.setRange(0, 0)  # nobody knows how long: it moves
        self._enable()

    def tick(self) -> None:
        """The window's timer: tell how long it has taken."""
        if self._tool is not None:
            text = f"{time.monotonic() - self._began:.0f} s"
            if text != self.status.text():
                self.status.setText(text)

    def close_tool(self) -> None:
        """End the tool."""
        if self._tool is not None:
            self._tool.close()
            self._tool = None

    def _cancel(self) -> None:
        if self._tool is not None:
            self._tool.cancel()

    def _ended(self, code: int) -> None:
        self._tool = None
        self.bar.setRange(0, 1)
        self.bar.setValue(int(code == 0))
        self.status.setText("done" if code == 0 else f"ended with status {code}")
        page = self._page()
        self._pictures = pictures(page.read_text(encoding="utf-8")) if page is not None else []
        self._number = 0
        self._turn(0)
        self._enable()

    def _turn(self, step: int) -> None:
        if self._pictures:
            self._number = (self._number + step) % len(self._pictures)
            self.picture.show_png(self._pictures[self._number])

    def _page(self) -> Path | None:
        return next(iter(sorted(self._folder.glob("*.html"))), None) if self._folder is not None else None

    def _open_page(self) -> None:
        if (page := self._page()) is not None:
            QDesktopServices.openUrl(QUrl.fromLocalFile(str(page)))

    def _enable(self) -> None:
        self.start.setEnabled(bool(self._runs) and not self.running)
        self.cancel.setEnabled(self.running)
        self.page.setEnabled(not self.running and self._page() is not None)
        for button in (self.previous, self.next):
            button.setEnabled(len(self._pictures) > 1)


def diagnosis(runs: Sequence[Path], option: str, folder: Path) -> list[str]:
    """The command line of ``acquire gap diagnose``."""
    more = ["--model", option] if option else []
    return ["gap", "diagnose", *map(str, runs), *more, "-o", str(folder)]


def fit(runs: Sequence[Path], option: str, folder: Path) -> list[str]:
    """The command line of ``acquire fit``."""
    more = ["--model", option] if option else []
    return ["fit", *map(str, runs), *more, "-o", str(folder)]
