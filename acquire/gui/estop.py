"""The emergency stop's way in: works whatever has the focus, and while a modal dialog is open."""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

from PySide6.QtCore import QEvent, QObject, Qt, Signal
from PySide6.QtGui import QKeyEvent
from PySide6.QtWidgets import QApplication, QDialog, QGridLayout, QPushButton

TEXT = "E-STOP"


class EmergencyStop(QObject):
    """An event filter on the whole application.

    Esc stops whenever ``live()`` says that something may act on a person, before any dialog sees the key. A modal
    dialog blocks the window's own button, so each one gets a button of its own when it is shown.
    """

    fired = Signal()

    def __init__(self, app: QApplication, live: Callable[[], bool]) -> None:
        super().__init__(app)
        self._app = app
        self._live = live
        app.installEventFilter(self)

    def remove(self) -> None:
        """Leave the application alone."""
        self._app.removeEventFilter(self)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Qt's hook: True for an event that nobody else is to see."""
        kind = event.type()
        if kind in (QEvent.Type.KeyPress, QEvent.Type.ShortcutOverride):
            if cast(QKeyEvent, event).key() == Qt.Key.Key_Escape and self._live():
                self.fired.emit()
                event.accept()
                return True
        elif kind == QEvent.Type.Show and isinstance(watched, QDialog) and watched.isModal():
            self._add_button(watched)
        return False

    def _add_button(self, dialog: QDialog) -> None:
        layout = dialog.layout()
        if layout is None or dialog.findChild(QPushButton, "estop") is not None:
            return
        button = button_for(self.fired.emit)
        if isinstance(layout, QGridLayout):
            layout.addWidget(button, layout.rowCount(), 0, 1, layout.columnCount())
        else:
            layout.addWidget(button)


def button_for(action: Callable[[], None]) -> QPushButton:
    """The big red button. It never takes the keyboard's focus, so that no space bar presses it by accident."""
    button = QPushButton(TEXT)
    button.setObjectName("estop")
    button.setProperty("role", "estop")
    button.setFocusPolicy(Qt.FocusPolicy.NoFocus)
    button.setAutoDefault(False)
    button.setToolTip("Vent everything now (Esc). Stays latched until it is reset.")
    button.setAccessibleName("Emergency stop")
    button.pressed.connect(action)  # at the press already, not at the release
    return button
