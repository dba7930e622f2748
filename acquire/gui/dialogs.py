"""Questions in boxes of their own: Qt's, as a system's would not let the emergency stop's key and button in."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from PySide6.QtWidgets import QFileDialog, QInputDialog, QMessageBox, QWidget

_OWN = QFileDialog.Option.DontUseNativeDialog


def ask_file(parent: QWidget, title: str, kinds: str) -> str:
    """A file to open; '' for none."""
    return QFileDialog.getOpenFileName(parent, title, "", kinds, options=_OWN)[0]


def ask_folder(parent: QWidget, title: str, there: Path) -> str:
    """A folder; '' for none."""
    return QFileDialog.getExistingDirectory(parent, title, str(there), _OWN)


def ask_line(parent: QWidget, title: str, question: str) -> str:
    """One line of text; '' where a person thinks better of it."""
    text, agreed = QInputDialog.getText(parent, title, question)
    return text.strip() if agreed else ""


def refuse(parent: QWidget, title: str, why: str) -> None:
    """Say that something was not done, and why. Does not wait: everything else goes on."""
    box = QMessageBox(QMessageBox.Icon.Critical, title, why, QMessageBox.StandardButton.Ok, parent)
    box.open()


def may_close(parent: QWidget) -> bool:
    """Whether a run that goes on may be ended by closing the window."""
    question = QMessageBox(parent)
    question.setWindowTitle("A run is going on")
    question.setText("Stop the run, vent, and close the window?")
    question.setStandardButtons(QMessageBox.StandardButton.Close | QMessageBox.StandardButton.Cancel)
    return question.exec() == int(QMessageBox.StandardButton.Close)


def may_start_beside(parent: QWidget, label: str, running: Sequence[str]) -> bool:
    """Whether another instrument may be started while others run: nobody does so by a slip."""
    question = QMessageBox(parent)
    question.setWindowTitle("Another instrument is running")
    question.setText(f"{', '.join(running)} is running. Start {label} as well?")
    start = question.addButton("Start as well", QMessageBox.ButtonRole.AcceptRole)
    question.setDefaultButton(question.addButton(QMessageBox.StandardButton.Cancel))
    question.exec()
    return question.clickedButton() is start
