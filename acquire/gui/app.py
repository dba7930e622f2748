"""Starting the window."""

from __future__ import annotations

import signal
import sys
from dataclasses import replace
from pathlib import Path

from PySide6.QtCore import QSettings
from PySide6.QtWidgets import QApplication

from acquire.gui import settings, theme
from acquire.gui.messages import BenchSettings
from acquire.gui.window import MainWindow


def run(bench: BenchSettings, *, dark: bool | None = None, store: QSettings | None = None) -> int:
    """Open the window and return when it is closed. ``dark`` None means as remembered."""
    app = QApplication.instance() or QApplication(sys.argv[:1])
    assert isinstance(app, QApplication)
    app.setApplicationName("skinrig")
    store = store or QSettings(settings.ORGANISATION, settings.APPLICATION)
    kept = settings.load(store)
    if dark is not None:
        kept.theme = "dark" if dark else "light"
        store.setValue("theme", kept.theme)
    theme.apply(app, theme.THEMES.get(kept.theme, theme.LIGHT))
    if bench.station is None and kept.station:
        bench = replace(bench, station=Path(kept.station))
    window = MainWindow(bench, store)
    window.show()
    # Ctrl-C is an emergency stop, made by the worker, which gets it too; at rest it closes the window.
    signal.signal(signal.SIGINT, lambda *_: None if window.live else app.quit())
    status = app.exec()
    window.shut()
    return status
