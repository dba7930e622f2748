"""The recordings in the folder: find, look at, recover, and hand on to diagnosis and fit."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import QItemSelectionModel, Qt, Signal
from PySide6.QtGui import QColor, QKeyEvent
from PySide6.QtWidgets import (
    QAbstractItemView,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QPushButton,
    QTableWidget,
    QTableWidgetItem,
    QVBoxLayout,
    QWidget,
)

from acquire.gui.panels.elided import Elided
from acquire.gui.reading import Row
from acquire.gui.theme import LEVELS, current

COLUMNS = ("begun", "instrument", "protocol", "subject", "site", "repeat", "status", "counts")
#: Characters of a column at most: a long pseudonym ends in an ellipsis, and its tool tip is whole.
WIDEST = {"instrument": 12, "protocol": 30, "subject": 12, "site": 12}
SHORT = 28  # characters of a reason in the table; its tool tip says all
COLOURS = {
    "completed": LEVELS["ok"], "imported": LEVELS["ok"], "recovered": LEVELS["warning"], "aborted": LEVELS["warning"],
}  # fmt: skip


class BrowserPanel(QWidget):
    """A table of recordings. Signals carry the chosen paths."""

    refresh_wanted = Signal()
    folder_wanted = Signal()
    open_wanted = Signal(object)
    recover_wanted = Signal(object)
    diagnose_wanted = Signal(object)
    fit_wanted = Signal(object)
    review_wanted = Signal(object, bool)  # paths, and whether they are to count

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.rows: tuple[Row, ...] = ()
        self.folder = Elided("")
        self.folder.setProperty("role", "faint")
        self.filter = QLineEdit()
        self.filter.setPlaceholderText("filter: subject, site, protocol, status …")
        self.filter.setClearButtonEnabled(True)
        self.filter.textChanged.connect(self._filter)
        self.table = QTableWidget(0, len(COLUMNS))
        self.table.setHorizontalHeaderLabels([name.capitalize() for name in COLUMNS])
        self.table.verticalHeader().hide()
        self.table.setShowGrid(False)
        self.table.setAlternatingRowColors(True)
        self.table.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
        self.table.setEditTriggers(QAbstractItemView.EditTrigger.NoEditTriggers)
        self.table.horizontalHeader().setStretchLastSection(True)
        self.table.horizontalHeader().setHighlightSections(False)  # bold heads would be cut
        self.table.itemSelectionChanged.connect(self._chosen)
        self.empty = QLabel("No recordings here yet: every run that ends is listed. Folder … shows another folder's.")
        self.empty.setProperty("role", "faint")
        self.empty.setWordWrap(True)
        self.look = self._button("Open", lambda: self.open_wanted.emit(self.chosen[0]))
        self.table.itemDoubleClicked.connect(self.look.click)
        self.diagnose = self._button("Diagnose", lambda: self.diagnose_wanted.emit(self.chosen))
        self.fit = self._button("Fit", lambda: self.fit_wanted.emit(self.chosen))
        self.leave_out = self._button("Leave out …", lambda: self.review_wanted.emit(self.chosen, False))
        self.leave_out.setToolTip("Of means, bands, fits and diagnoses, with a reason; the recording is not changed")
        self.count = self._button("Count …", lambda: self.review_wanted.emit(self.chosen, True))
        self.count.setToolTip("Let a run that is left out count after all, with a reason")
        self.recover = self._button("Recover", lambda: self.recover_wanted.emit(self.journals))
        self.refresh = self._button("Refresh", self.refresh_wanted.emit)
        change = self._button("Folder …", self.folder_wanted.emit)
        top = QHBoxLayout()
        top.addWidget(self.filter, 1)
        top.addWidget(change)
        top.addWidget(self.refresh)
        bottom = QHBoxLayout()
        bottom.addStretch(1)
        for button in (self.look, self.diagnose, self.fit, self.leave_out, self.count, self.recover):
            bottom.addWidget(button)
        column = QVBoxLayout(self)
        column.addLayout(top)
        column.addWidget(self.empty)
        column.addWidget(self.table, 1)
        column.addWidget(self.folder)
        column.addLayout(bottom)
        self._chosen()

    def show_rows(self, folder: Path, rows: tuple[Row, ...]) -> None:
        """Another list. The files that were chosen stay chosen, wherever they stand now."""
        chosen = {row.path for row in self._selected()}
        self.table.blockSignals(True)
        self.table.clearSelection()
        self.rows = rows
        self.folder.setText(f"{len(rows)} in {folder.resolve()}")
        self.table.setRowCount(len(rows))
        for number, row in enumerate(rows):
            for column, text in enumerate(_cells(row)):
                item = QTableWidgetItem(text)
                told = (row.problem or str(row.path), row.subject, row.left_out)
                item.setToolTip("\n".join(filter(None, told)))
                if column == COLUMNS.index("status"):
                    item.setForeground(QColor(COLOURS.get(row.status, LEVELS["bad"])))
                elif row.left_out:
                    item.setForeground(QColor(current().faint))
                self.table.setItem(number, column, item)
        one = self.table.fontMetrics().horizontalAdvance("0")
        for column, name in enumerate(COLUMNS):
            self.table.resizeColumnToContents(column)
            most = one * WIDEST.get(name, SHORT + 4)
            self.table.setColumnWidth(column, min(self.table.columnWidth(column), most))
        self.empty.setVisible(not rows)
        for number, row in enumerate(rows):
            if row.path in chosen:
                self._select(number, QItemSelectionModel.SelectionFlag.Select)
        self.table.blockSignals(False)
        self._filter(self.filter.text())

    @property
    def chosen(self) -> list[Path]:
        """The chosen recordings that can be read."""
        return [row.path for row in self._selected() if not row.problem]

    @property
    def journals(self) -> list[Path]:
        """The chosen journals that a crash left."""
        return [row.path for row in self._selected() if row.path.suffix == ".journal"]

    def _selected(self) -> list[Row]:
        numbers = sorted({index.row() for index in self.table.selectionModel().selectedRows()})
        return [self.rows[number] for number in numbers if number < len(self.rows)]

    def _chosen(self) -> None:
        self.look.setEnabled(len(self.chosen) == 1)
        self.diagnose.setEnabled(bool(self.chosen))
        self.fit.setEnabled(bool(self.chosen))
        readable = [row for row in self._selected() if not row.problem]
        self.leave_out.setEnabled(any(not row.left_out for row in readable))
        self.count.setEnabled(any(row.left_out for row in readable))
        self.recover.setEnabled(bool(self.journals))

    def _filter(self, text: str) -> None:
        words = text.lower().split()
        for number in range(self.table.rowCount()):
            cells = [self.table.item(number, column) for column in range(len(COLUMNS))]
            line = " ".join(cell.text().lower() for cell in cells if cell is not None)
            hidden = not all(word in line for word in words)
            self.table.setRowHidden(number, hidden)
            if hidden:  # a hidden row is not chosen
                self._select(number, QItemSelectionModel.SelectionFlag.Deselect)
        self._chosen()

    def _select(self, number: int, how: QItemSelectionModel.SelectionFlag) -> None:
        index = self.table.model().index(number, 0)
        self.table.selectionModel().select(index, how | QItemSelectionModel.SelectionFlag.Rows)

    def _button(self, text: str, action: object) -> QPushButton:
        button = QPushButton(text)
        button.clicked.connect(action)
        return button

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Return opens the chosen recording."""
        if event.key() in (Qt.Key.Key_Return, Qt.Key.Key_Enter) and self.look.isEnabled():
            self.look.click()
            return
        super().keyPressEvent(event)


def _cells(row: Row) -> tuple[str, ...]:
    """The cells of a line of the table, in the order of `COLUMNS`."""
    begun, repeat = row.start[:16].replace("T", " "), str(row.repeat or "")
    counts = "" if row.problem else f"no: {row.left_out}" if row.left_out else "yes"
    shortened = counts if len(counts) <= SHORT else f"{counts[:SHORT]}…"
    return begun, row.instrument, row.protocol, row.subject, row.site, repeat, row.status, shortened
