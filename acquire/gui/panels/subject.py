"""Whom and where: a pseudonym (never a name), the site, which repeat."""

from __future__ import annotations

from typing import Any

from PySide6.QtCore import Signal
from PySide6.QtWidgets import (
    QComboBox,
    QFormLayout,
    QGroupBox,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QPushButton,
    QSpinBox,
    QWidget,
)

from acquire import pseudonym
from acquire.gui.messages import Measurement
from protocols.specimens import SKIN, SPECIMENS, Stated, assignments, stated

SITES = ("forehead", "cheek", "jaw", "parotid", "forearm", "upper arm", "neck", "fingertip")
PSEUDONYM = "A pseudonym. Do not write a person's name here: it goes into every recording."


class SubjectPanel(QGroupBox):
    """Subject, site and labels of a run."""

    changed = Signal()  # another subject or site, also while it is being typed
    settled = Signal()  # another subject, whose limits are to be asked for

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__("Subject", parent)
        self.subject = QLineEdit(pseudonym.fresh())
        self._explain(self.subject.text())
        self.another = QPushButton("New")
        self.another.setToolTip("Another random pseudonym")
        self.fault = QLabel("")
        self.fault.setProperty("role", "error")
        self.fault.setWordWrap(True)
        self.fault.hide()
        self.site = QComboBox()
        self.site.setEditable(True)
        self.site.addItems(SITES)
        self.repeat = QSpinBox()
        self.repeat.setRange(1, 9999)
        self.repeat.setToolTip("Counted from the finished runs in the folder; a number set by hand holds for one run.")
        self.specimen = QComboBox()
        self.specimen.addItems((SKIN, *SPECIMENS))
        for box in (self.site, self.specimen):  # a narrow column: the list that opens is as wide as it needs to be
            box.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
            box.setMinimumContentsLength(8)
        self.properties = QLineEdit()
        self.properties.setToolTip("Known properties of the specimen, each with its uncertainty, separated by ';'")
        self.operator = QLineEdit()
        self.operator.setPlaceholderText("who measures")
        self.notes = QLineEdit()
        self.notes.setPlaceholderText("anything worth keeping")
        self.another.clicked.connect(self._renew)
        self.subject.editingFinished.connect(self.settled)
        self.subject.textChanged.connect(self._check)
        self.site.currentTextChanged.connect(self.changed)
        self.repeat.valueChanged.connect(self._set_by_hand)
        row = QHBoxLayout()
        row.addWidget(self.subject, 1)
        row.addWidget(self.another)
        form = QFormLayout(self)
        form.addRow("Pseudonym", row)
        form.addRow(self.fault)
        form.addRow("Site", self.site)
        form.addRow("Repeat", self.repeat)
        form.addRow("Specimen", self.specimen)
        form.addRow("Known of it", self.properties)
        form.addRow("Operator", self.operator)
        form.addRow("Notes", self.notes)
        self._form = form
        self.specimen.currentTextChanged.connect(self._mounted)
        self.properties.textChanged.connect(lambda _: self._check(self.subject.text()))
        self._mounted(SKIN)
        self._what = Measurement("", "", "")  # that the repeat was counted of
        self._by_hand: Measurement | None = None  # of which a person set the repeat

    @property
    def sound(self) -> bool:
        """Whether a run can be filed under the text written here."""
        return self.fault.isHidden()

    def what(self, protocol: str) -> Measurement:
        """The measurement that a run of ``protocol`` would be."""
        return Measurement(self.subject.text().strip(), self.site.currentText().strip(), protocol)

    def who(self) -> dict[str, Any]:
        """The arguments of `acquire.session.Request`."""
        return {
            "subject": self.subject.text().strip(),
            "site": self.site.currentText().strip(),
            "repeat": self.repeat.value(),
            "specimen": self.specimen.currentText(),
            "specimen_properties": self.known(),
            "operator": self.operator.text().strip(),
            "notes": self.notes.text().strip(),
        }

    def known(self) -> dict[str, Stated]:
        """The stated numbers of the specimen. Raises ValueError that names the key."""
        texts = [text for text in self.properties.text().split(";") if text.strip()]
        return stated(self.specimen.currentText(), assignments(texts))

    def count(self, what: Measurement, repeat: int, *, anew: bool = False) -> None:
        """The next repeat of ``what``; one set by hand stays, unless ``anew`` (a run of it has ended)."""
        if self._by_hand == what and not anew:
            return
        self._by_hand = None
        self._what = what
        self.repeat.blockSignals(True)
        self.repeat.setValue(repeat)
        self.repeat.blockSignals(False)

    def _set_by_hand(self) -> None:
        self._by_hand = self._what

    def _mounted(self, specimen: str) -> None:
        """Another specimen: the line for its numbers is there where it has any."""
        of = SPECIMENS[specimen].properties if specimen in SPECIMENS else ()
        self.properties.setText("")
        self.properties.setPlaceholderText("; ".join(f"{item.key}={item.example}" for item in of))
        self._form.setRowVisible(self.properties, bool(of))
        self._check(self.subject.text())

    def _renew(self) -> None:
        self.subject.setText(pseudonym.fresh())
        self.settled.emit()

    def _explain(self, text: str) -> None:
        """The pseudonym's tool tip: a long one is not seen whole in its field."""
        self.subject.setToolTip(f"{text}\n{PSEUDONYM}" if text else PSEUDONYM)

    def _check(self, text: str) -> None:
        self._explain(self.subject.text())
        try:
            pseudonym.check(text.strip())
            self.known()
            self.fault.hide()
        except ValueError as error:
            self.fault.setText(str(error))
            self.fault.show()
        self.changed.emit()
