"""Whom and where: a pseudonym (never a name), the site, which repeat."""

from __future__ import annotations

import secrets
from typing import Any

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QComboBox, QFormLayout, QGroupBox, QHBoxLayout, QLineEdit, QPushButton, QSpinBox, QWidget

SITES = ("forehead", "cheek", "jaw", "parotid", "forearm", "upper arm", "neck", "fingertip")
SPECIMENS = ("skin", "rigid block", "open air")


def pseudonym() -> str:
    """A random one: letters and digits that are not mistaken for each other."""
    return "P" + "".join(secrets.choice("23456789ABCDEFGHJKMNPQRSTVWXYZ") for _ in range(4))


class SubjectPanel(QGroupBox):
    """What a run is filed under."""

    changed = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__("Subject", parent)
        self.subject = QLineEdit(pseudonym())
        self.subject.setMaxLength(20)
        self.subject.setToolTip("A pseudonym. Do not write a person's name here: it goes into every recording.")
        self.another = QPushButton("New")
        self.another.setToolTip("Another random pseudonym")
        self.site = QComboBox()
        self.site.setEditable(True)
        self.site.addItems(SITES)
        self.repeat = QSpinBox()
        self.repeat.setRange(1, 999)
        self.specimen = QComboBox()
        self.specimen.addItems(SPECIMENS)
        self.operator = QLineEdit()
        self.operator.setPlaceholderText("who measures")
        self.notes = QLineEdit()
        self.notes.setPlaceholderText("anything worth keeping")
        self.another.clicked.connect(self._renew)
        self.subject.editingFinished.connect(self._restart)
        self.site.currentTextChanged.connect(self._restart)
        row = QHBoxLayout()
        row.addWidget(self.subject, 1)
        row.addWidget(self.another)
        form = QFormLayout(self)
        form.addRow("Pseudonym", row)
        form.addRow("Site", self.site)
        form.addRow("Repeat", self.repeat)
        form.addRow("Specimen", self.specimen)
        form.addRow("Operator", self.operator)
        form.addRow("Notes", self.notes)
        self._protocol = ""
        self._repeats: dict[tuple[str, str, str], int] = {}
        self._last = self._key()

    def who(self) -> dict[str, Any]:
        """The arguments of `acquire.session.Request`."""
        return {
            "subject": self.subject.text().strip(),
            "site": self.site.currentText().strip(),
            "repeat": self.repeat.value(),
            "specimen": self.specimen.currentText(),
            "operator": self.operator.text().strip(),
            "notes": self.notes.text().strip(),
        }

    def count_repeat(self) -> None:
        """A run was completed: the next one is the next repeat."""
        self._repeats[self._key()] = self.repeat.value() + 1
        self.repeat.setValue(self.repeat.value() + 1)

    def concern(self, protocol: str) -> None:
        """Another protocol is chosen: its repeats count for themselves."""
        if protocol != self._protocol:
            self._protocol = protocol
            self._last = self._key()
            self.repeat.setValue(self._repeats.get(self._key(), 1))

    def _key(self) -> tuple[str, str, str]:
        return self.subject.text().strip(), self.site.currentText().strip(), self._protocol

    def _renew(self) -> None:
        self.subject.setText(pseudonym())
        self._restart()

    def _restart(self) -> None:
        """Repeats count for themselves at another subject or site."""
        if self._key() != self._last:
            self._last = self._key()
            self.repeat.setValue(self._repeats.get(self._key(), 1))
            self.changed.emit()
