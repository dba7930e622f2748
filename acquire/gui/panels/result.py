"""After a run: its quality, its results, and a comparison with earlier ones."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from PySide6.QtCore import Qt
from PySide6.QtGui import QPalette, QPixmap, QResizeEvent
from PySide6.QtWidgets import (
    QAbstractItemView,
    QGroupBox,
    QHBoxLayout,
    QHeaderView,
    QLabel,
    QScrollArea,
    QTableWidget,
    QTableWidgetItem,
    QTabWidget,
    QVBoxLayout,
    QWidget,
)

from acquire.analysis.curves import DEFINITIONS
from acquire.gui.panels.elided import Elided
from acquire.gui.reading import Result
from acquire.gui.theme import LEVELS
from acquire.words import share, shown

TOGETHER = 560  # px of height from which quality and parameters stand below the picture
LEGIBLE = 0.75  # of its size: a picture is not made smaller to fit, but scrolled


class PictureView(QScrollArea):
    """A picture as large as there is room for."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._label = QLabel()
        self._label.setAlignment(Qt.AlignmentFlag.AlignTop | Qt.AlignmentFlag.AlignHCenter)
        self._pixmap = QPixmap()
        self.setWidget(self._label)
        self.viewport().setBackgroundRole(QPalette.ColorRole.Base)
        self._label.setAutoFillBackground(False)
        self.setWidgetResizable(True)

    def show_png(self, data: bytes) -> None:
        """Show a PNG; nothing for no bytes."""
        self._pixmap = QPixmap()
        if data:
            self._pixmap.loadFromData(data)
        self._fit()

    @property
    def shown(self) -> bool:
        """Whether there is a picture."""
        return not self._pixmap.isNull()

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Qt's hook: another size."""
        super().resizeEvent(event)
        self._fit()

    def _fit(self) -> None:
        # Pictures are on white paper in either theme, and so is the room that they leave.
        self._label.setStyleSheet("" if self._pixmap.isNull() else "background: white")
        if self._pixmap.isNull():
            self._label.clear()
            return
        room, whole = self.viewport().size(), self._pixmap.size()
        wide = min(room.width() / whole.width(), 1.0)
        scale = max(min(wide, room.height() / whole.height()), min(wide, LEGIBLE))
        smooth = Qt.TransformationMode.SmoothTransformation
        self._label.setPixmap(self._pixmap.scaledToWidth(round(scale * whole.width()), smooth))


class ResultPanel(QWidget):
    """Quality flags, parameters and pictures of one recording."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.title = QLabel("No recording yet")
        self.title.setProperty("role", "title")
        self.title.setWordWrap(True)
        self.subtitle = Elided("After a run its result appears here; older ones are under Recordings.")
        self.subtitle.setProperty("role", "faint")
        self.left_out = QLabel("")
        self.left_out.setProperty("role", "error")
        self.left_out.setWordWrap(True)
        self.left_out.hide()
        quality, flags, scroll = QGroupBox("Quality"), QWidget(), QScrollArea()
        scroll.setFrameShape(QScrollArea.Shape.NoFrame)
        scroll.setWidgetResizable(True)
        scroll.setWidget(flags)
        for behind in (scroll.viewport(), flags):
            behind.setAutoFillBackground(False)
        QVBoxLayout(quality).addWidget(scroll)
        self._quality = QVBoxLayout(flags)
        self._quality.setContentsMargins(0, 0, 0, 0)
        self._quality.setAlignment(Qt.AlignmentFlag.AlignTop)
        self.flags: list[QLabel] = []
        parameters = QGroupBox("Parameters")
        self.table = QTableWidget(0, 3)
        self.table.setHorizontalHeaderLabels(["", "value", "meaning"])
        self.table.verticalHeader().hide()
        self.table.setEditTriggers(QAbstractItemView.EditTrigger.NoEditTriggers)
        self.table.setAlternatingRowColors(True)
        self.table.setShowGrid(False)
        self.table.horizontalHeader().setSectionResizeMode(2, QHeaderView.ResizeMode.Stretch)
        QVBoxLayout(parameters).addWidget(self.table)
        self.picture, self.compared = PictureView(), PictureView()
        self.pages = QTabWidget()
        self.pages.addTab(self.picture, "This run")
        self.pages.addTab(self.compared, "With earlier runs")
        self.details = QWidget()
        row = QHBoxLayout(self.details)
        row.setContentsMargins(0, 0, 0, 0)
        row.addWidget(quality, 2)
        row.addWidget(parameters, 3)
        self._column = column = QVBoxLayout(self)
        column.addWidget(self.title)
        column.addWidget(self.subtitle)
        column.addWidget(self.left_out)
        column.addWidget(self.pages, 3)
        column.addWidget(self.details, 2)
        column.addStretch(0)
        self.result: Result | None = None
        self.pages.hide()
        self.details.hide()

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Qt's hook: where there is no height for both, quality and parameters are a page beside the picture's."""
        super().resizeEvent(event)
        apart = self.pages.indexOf(self.details) >= 0
        if self.height() < TOGETHER and not apart:
            self._column.removeWidget(self.details)
            self.pages.addTab(self.details, "Quality and parameters")
        elif self.height() >= TOGETHER and apart:
            self.pages.removeTab(self.pages.indexOf(self.details))
            self._column.insertWidget(self._column.indexOf(self.pages) + 1, self.details, 2)
            self.details.setVisible(self.result is not None)

    def show_waiting(self, text: str) -> None:
        """A run has just ended and is being read."""
        self.title.setText(text)

    def show_result(self, result: Result) -> None:
        """Everything about a recording."""
        self.result = result
        self.pages.show()
        if self.pages.indexOf(self.details) < 0:
            self.details.show()
        summary = result.summary
        who = " · ".join(str(summary[key]) for key in ("device", "subject", "site") if summary[key])
        self.title.setText(f"{summary['protocol'] or summary['id']} – {summary['status']}")
        begun = summary["start_time"][:19].replace("T", " ")
        self.subtitle.setText(
            f"{who} · repeat {summary['repeat']} · {summary['specimen']} · {begun} · {result.path.name}"
        )
        self.left_out.setText(f"Does not count with others – {summary['left_out']}" if summary["left_out"] else "")
        self.left_out.setVisible(bool(summary["left_out"]))
        self._show_flags(summary["quality"])
        self._show_parameters(summary)
        self.picture.show_png(result.picture)
        self.compared.show_png(result.compared)
        self.pages.setTabText(1, f"With earlier runs ({len(result.others)})")
        self.pages.setTabEnabled(1, bool(result.others))
        self.pages.setCurrentIndex(0)

    def _show_flags(self, flags: list[Mapping[str, Any]]) -> None:
        for label in self.flags:
            self._quality.removeWidget(label)
            label.deleteLater()
        self.flags = []
        for flag in flags:
            colour = LEVELS[flag["level"]]
            label = QLabel(
                f'<span style="color:{colour}; font-size:15pt">●</span> &nbsp;<b>{flag["name"]}</b>: {flag["text"]}'
            )
            label.setWordWrap(True)
            label.setAccessibleName(f"{flag['name']}: {flag['level']}")
            self._quality.addWidget(label)
            self.flags.append(label)

    def _show_parameters(self, summary: Mapping[str, Any]) -> None:
        rows = [
            (name, shown(value, DEFINITIONS[name].unit), DEFINITIONS[name].text)
            for name, value in summary["parameters"].items()
        ]
        for entry in summary["directions"]:
            direction = ", ".join(f"{x:+.2f}" for x in entry["direction"])
            loss = share(entry["energy_loss"])
            meaning = f"at {shown(entry['displacement'], 'm')}, {loss} of the energy lost"
            rows.append((f"({direction})", shown(entry["force"], "N"), meaning))
        self.table.setRowCount(len(rows))
        for number, cells in enumerate(rows):
            for column, text in enumerate(cells):
                item = QTableWidgetItem(text)
                item.setToolTip(text)
                self.table.setItem(number, column, item)
        self.table.resizeColumnToContents(0)
        self.table.resizeColumnToContents(1)
