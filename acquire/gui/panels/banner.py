"""A line across the window that asks for an answer without blocking anything."""

from __future__ import annotations

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QFrame, QHBoxLayout, QLabel, QPushButton, QWidget


class Banner(QFrame):
    """Hidden until it has something to say. ``role`` is ``alarm`` (stays until accepted) or ``offer``."""

    accepted = Signal()

    def __init__(self, role: str, accept: str, dismiss: str = "", parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setProperty("role", role)
        self._accept = accept
        self.text = QLabel("")
        self.text.setWordWrap(True)
        self.button = QPushButton(accept)
        self.button.clicked.connect(self.accepted)
        row = QHBoxLayout(self)
        row.addWidget(self.text, 1)
        row.addWidget(self.button)
        if dismiss:
            later = QPushButton(dismiss)
            later.clicked.connect(self.hide)
            row.addWidget(later)
        self.hide()

    def say(self, text: str, accept: str = "") -> None:
        """Show a text; ``accept`` replaces the usual action of accepting it."""
        self.text.setText(text)
        self.button.setText(accept or self._accept)
        self.show()
