"""A window on the simulated bench, without a screen."""

from __future__ import annotations

import os

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from PySide6.QtCore import QSettings, Qt
from PySide6.QtWidgets import QApplication, QWidget
from pytestqt.qtbot import QtBot

from acquire.gui import theme
from acquire.gui.messages import BenchSettings
from acquire.gui.window import MainWindow

PATIENCE = 60_000  # ms; a worker starts in seconds, on a busy machine in many
MakeWindow = Callable[..., MainWindow]
TWO = """\
schema: station/1
name: two of a kind
instruments:
  left: {instrument: cutometer, simulated: {seed: 1}, watchdog: 1 s, interlock: {stale: 5 s}}
  right: {instrument: cutometer, simulated: {seed: 2}, watchdog: 1 s, interlock: {stale: 5 s}}
"""


@pytest.fixture
def store(tmp_path: Path) -> QSettings:
    return QSettings(str(tmp_path / "settings.ini"), QSettings.Format.IniFormat)


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    """The folder of the window's recordings."""
    folder = tmp_path / "runs"
    folder.mkdir()
    return folder


@pytest.fixture
def two(tmp_path: Path) -> Path:
    """A station with two instruments of a kind."""
    path = tmp_path / "two.yaml"
    path.write_text(TWO)
    return path


@pytest.fixture
def make_window(qapp: QApplication, qtbot: QtBot, tmp_path: Path, store: QSettings) -> Iterator[MakeWindow]:
    """Makes windows whose worker is up; all are closed, and so vented, at the end."""
    theme.apply(qapp, theme.LIGHT)
    windows = []

    def make(speed: float = 20.0, up: bool = True, **more: object) -> MainWindow:
        bench = BenchSettings(out=tmp_path / "runs", speed=speed, seed=1, frame_size=(160, 120), **more)  # type: ignore[arg-type]
        window = MainWindow(bench, store)
        windows.append(window)
        window.show()
        if up:
            qtbot.waitUntil(lambda: window.prepare.preview is not None, timeout=PATIENCE)
        return window

    yield make
    for window in windows:
        window.shut()
        window.close()
        window.deleteLater()
    qapp.sendPostedEvents()


def connected(qtbot: QtBot, window: MainWindow, name: str) -> None:
    """Choose an instrument and connect it by its button; its demo is then ready to start."""
    window.instruments.choose(name)
    window.instruments.rows[name].button.click()
    qtbot.waitUntil(lambda: state(window, name) == "ready", timeout=PATIENCE)
    qtbot.waitUntil(lambda: window.controls.start_button.isEnabled(), timeout=PATIENCE)


def press(qtbot: QtBot, widget: QWidget) -> None:
    """Click a widget with the left button of the mouse, once it is there and enabled."""
    qtbot.waitUntil(lambda: widget.isVisible() and widget.isEnabled(), timeout=PATIENCE)
    qtbot.mouseClick(widget, Qt.MouseButton.LeftButton)


def state(window: MainWindow, name: str) -> str:
    return window.views[name].state if name in window.views else "off"
