"""Choosing a protocol: the list, its course as a picture and in words, or its faults and their lines."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from pathlib import Path

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QColor, QFontDatabase, QTextCursor, QTextFormat
from PySide6.QtWidgets import (
    QLabel,
    QListWidget,
    QListWidgetItem,
    QPlainTextEdit,
    QPushButton,
    QSplitter,
    QTabWidget,
    QTextBrowser,
    QTextEdit,
    QVBoxLayout,
    QWidget,
)

from acquire.gui.messages import FROM_FILE, Fault, Preview, ProtocolEntry
from acquire.gui.plots import plot
from acquire.gui.theme import current
from acquire.words import clock, pleasant, unit_of

MOST_PHASES = 400  # shaded; more are thinner than a line
MOST_FAULTS = 3  # above the text; all of them are under In words
#: Groups of the list by how a protocol's name begins, in this order; one named otherwise is a measurement.
GROUPS = {"demo": "To try it out", "": "Measurements", "qualify": "Qualification on reference specimens"}
FROM_FILES = "From files"


class PreparePanel(QWidget):
    """The chosen instrument's protocols and the preview of the chosen one."""

    wanted = Signal(object)  # Path of the protocol to preview
    open_wanted = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.preview: Preview | None = None
        self.entries: tuple[ProtocolEntry, ...] = ()
        self.list = QListWidget()
        self.list.setWordWrap(True)
        self.list.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.list.currentItemChanged.connect(self._choose)
        self.open = QPushButton("Open a file …")
        self.open.clicked.connect(self.open_wanted)
        self.title = QLabel("No protocol chosen")
        self.title.setProperty("role", "title")
        self.title.setWordWrap(True)
        self.fault = QLabel("")
        self.fault.setProperty("role", "error")
        self.fault.setWordWrap(True)
        self.fault.hide()
        self.plot = plot("time", "s", "set-point")
        self.legend = self.plot.addLegend(offset=(-8, 8))
        self.words, self.text = QTextBrowser(), _page()
        pages = QTabWidget()
        pages.addTab(self.words, "In words")
        pages.addTab(self.text, "Text")
        self.pages = pages
        left, right = QWidget(), QWidget()
        column = QVBoxLayout(left)
        column.setContentsMargins(0, 0, 0, 0)
        column.addWidget(self.list)
        column.addWidget(self.open)
        column = QVBoxLayout(right)
        column.setContentsMargins(0, 0, 0, 0)
        column.addWidget(self.title)
        column.addWidget(self.fault)
        column.addWidget(self.plot, 3)
        column.addWidget(pages, 2)
        splitter = QSplitter(Qt.Orientation.Horizontal)
        splitter.addWidget(left)
        splitter.addWidget(right)
        splitter.setStretchFactor(1, 1)
        splitter.setSizes([270, 820])
        splitter.setChildrenCollapsible(False)
        QVBoxLayout(self).addWidget(splitter)

    def show_entries(self, entries: Sequence[ProtocolEntry], kind: str, chosen: str = "") -> None:
        """List the protocols for a kind of instrument; ``chosen`` (a path) is selected if it is among them."""
        self.entries = tuple(entry for entry in entries if entry.instrument in (kind, ""))
        self.list.blockSignals(True)
        self.list.clear()
        for heading in (*GROUPS.values(), FROM_FILES):
            members = [entry for entry in self.entries if _group(entry) == heading]
            if members:
                self.list.addItem(_heading(heading))
            for entry in members:
                item = QListWidgetItem(entry.name if entry.title in ("", FROM_FILE) else entry.title)
                item.setToolTip(f"{entry.name}\n{entry.path}")
                item.setData(Qt.ItemDataRole.UserRole, str(entry.path))
                self.list.addItem(item)
        self.list.blockSignals(False)
        paths = [str(entry.path) for entry in self.entries]
        demos = [str(entry.path) for entry in self.entries if entry.name.startswith("demo")]
        self._select(chosen if chosen in paths else next(iter((*demos, *paths)), ""))
        if not self.entries:
            self.preview = None

    @property
    def chosen(self) -> str:
        """The path of the chosen protocol; '' for none."""
        item = self.list.currentItem()
        return str(item.data(Qt.ItemDataRole.UserRole)) if item is not None else ""

    def choose(self, name: str) -> None:
        """Select a protocol by its name or path. Raises ValueError for one that is not listed."""
        for entry in self.entries:
            if name in (entry.name, str(entry.path)):
                self._select(str(entry.path))
                return
        raise ValueError(f"no protocol {name!r} in the list")

    def _select(self, path: str) -> None:
        """Make the item of a path the current one; none for ''."""
        rows = [k for k in range(self.list.count()) if self.list.item(k).data(Qt.ItemDataRole.UserRole) == path]
        self.list.setCurrentRow(rows[0] if rows and path else -1)
        self.list.scrollToItem(self.list.currentItem())

    def show_preview(self, preview: Preview) -> None:
        """Draw a compiled protocol with its phases and limits."""
        self.preview = preview
        self.title.setText(f"{preview.name} – {clock(preview.duration)}")
        self.fault.hide()
        self.words.setHtml(_table(preview.headline, preview.rows))
        self.text.setPlainText(preview.text)
        self.text.setExtraSelections([])
        self.pages.setCurrentIndex(0)
        self._draw(preview)

    def show_faults(self, path: Path, message: str, faults: Sequence[Fault]) -> None:
        """Show the faults of a protocol beside its text, with the lines marked."""
        self.preview = None
        self.plot.hide()
        self.title.setText(f"{path.stem} – cannot be run")
        lines = [
            f"line {f.line}: {f.field + ': ' if f.field else ''}{f.message}" if f.line else f.message for f in faults
        ]
        told = lines or [message]
        more = [f"… and {len(told) - MOST_FAULTS} more, under In words"] if len(told) > MOST_FAULTS else []
        self.fault.setText("\n".join([*told[:MOST_FAULTS], *more]))
        self.fault.show()
        self.words.setPlainText("\n".join([str(path), "", *(told if more else ())]))
        try:
            self.text.setPlainText(path.read_text(encoding="utf-8"))
        except (OSError, UnicodeDecodeError) as error:
            self.text.setPlainText(f"{path.name} cannot be read: {getattr(error, 'strerror', None) or error}")
        self._mark([fault.line for fault in faults if fault.line])
        self.pages.setCurrentIndex(1)

    def _choose(self, item: QListWidgetItem | None) -> None:
        self.preview = None
        if item is not None:
            self.wanted.emit(Path(self.chosen))

    def _draw(self, preview: Preview) -> None:
        theme = current()
        self.plot.show()
        self.plot.clear()
        if len(preview.phases) <= MOST_PHASES:
            for begin, end, phase in preview.phases:
                if end > begin:
                    colour = QColor(theme.phases.get(phase, theme.base))
                    self.plot.addItem(pg.LinearRegionItem((begin, end), movable=False, brush=colour, pen=colour))
        unit = unit_of(next(iter(preview.values)))
        factor, shown = pleasant(unit)
        for number, (name, value) in enumerate(preview.values.items()):
            pen = pg.mkPen(theme.curves[number % len(theme.curves)], width=1)
            self.plot.plot(preview.time, factor * value, pen=pen, name=name)
        reached = factor * max((float(np.abs(v).max()) for v in preview.values.values()), default=1.0)
        drawn = set()
        for name in preview.values:
            for bound in preview.limits.get(name, ()):
                if np.isfinite(bound) and factor * abs(bound) <= 2 * reached:
                    drawn.add(factor * bound)
        for bound in drawn:
            self.plot.addItem(pg.InfiniteLine(bound, angle=0, pen=pg.mkPen(theme.limit, style=Qt.PenStyle.DashLine)))
        self.plot.getAxis("left").title("pressure" if unit == "Pa" else "tip", shown)
        self.plot.setXRange(0, max(preview.duration, 1e-3), padding=0.01)
        self.plot.enableAutoRange(axis="y")

    def _mark(self, lines: list[int]) -> None:
        """Colour the lines of a text and bring the first one into view."""
        marks = []
        for line in lines:
            block = self.text.document().findBlockByNumber(line - 1)
            if not block.isValid():
                continue
            mark = QTextEdit.ExtraSelection()
            mark.format.setBackground(QColor("#d32f2f"))
            mark.format.setForeground(QColor("white"))
            mark.format.setProperty(QTextFormat.Property.FullWidthSelection, True)
            mark.cursor = QTextCursor(block)
            marks.append(mark)
        self.text.setExtraSelections(marks)
        if marks:
            self.text.setTextCursor(marks[0].cursor)
            self.text.centerCursor()


def _group(entry: ProtocolEntry) -> str:
    """The heading that an entry stands under."""
    if entry.title == FROM_FILE:
        return FROM_FILES
    return next((name for begin, name in GROUPS.items() if begin and entry.name.startswith(begin)), GROUPS[""])


def _heading(text: str) -> QListWidgetItem:
    """A line of the list that cannot be chosen."""
    item = QListWidgetItem(text)
    item.setFlags(Qt.ItemFlag.NoItemFlags)
    font = item.font()
    font.setBold(True)
    item.setFont(font)
    return item


def _table(headline: str, rows: Sequence[tuple[str, str]]) -> str:
    """A protocol in words as a table that wraps."""
    cells = [f"<tr><td><b>{escape(name.replace('_', ' '))}</b></td><td>{escape(text)}</td></tr>" for name, text in rows]
    return f"<p>{escape(headline)}</p><table cellspacing='4'>{''.join(cells)}</table>"


def _page() -> QPlainTextEdit:
    page = QPlainTextEdit()
    page.setReadOnly(True)
    font = QFontDatabase.systemFont(QFontDatabase.SystemFont.FixedFont)
    font.setPointSize(10)
    page.setFont(font)
    page.setLineWrapMode(QPlainTextEdit.LineWrapMode.NoWrap)
    return page
