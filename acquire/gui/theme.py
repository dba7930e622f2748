"""Light and dark, and sizes that can be read at arm's length."""

from __future__ import annotations

from dataclasses import dataclass

import pyqtgraph as pg
from PySide6.QtGui import QColor, QPalette
from PySide6.QtWidgets import QApplication

POINT_SIZE = 11


@dataclass(frozen=True)
class Theme:
    """Colours by purpose."""

    name: str
    window: str
    base: str
    raised: str
    text: str
    faint: str
    border: str
    accent: str
    limit: str
    curves: tuple[str, ...]
    phases: dict[str, str]


LIGHT = Theme(
    name="light", window="#eef1f4", base="#ffffff", raised="#f7f9fa", text="#17202a", faint="#5f6b76",
    border="#c6ced6", accent="#0b6e99", limit="#c0392b",
    curves=("#0b6e99", "#c2571a", "#2e8b57", "#7d4fa3"),
    phases={"load": "#f8cfa9", "hold": "#fbeede", "unload": "#dbe9f6", "rest": "#f2f2f2"},
)  # fmt: skip
DARK = Theme(
    name="dark", window="#161b20", base="#1e252c", raised="#252d35", text="#e8edf1", faint="#98a5b1",
    border="#3a4550", accent="#4fb3d9", limit="#ff7b6b",
    curves=("#4fb3d9", "#f0a05a", "#68c58f", "#c39ae0"),
    phases={"load": "#5a4126", "hold": "#3d3427", "unload": "#263a4d", "rest": "#262b30"},
)  # fmt: skip
THEMES = {theme.name: theme for theme in (LIGHT, DARK)}

#: Status lights: colour by state.
LIGHTS = {
    "off": "#8c98a3",
    "idle": "#8c98a3",
    "connecting": "#d9a21b",
    "ready": "#2e9e5b",
    "armed": "#d9a21b",
    "running": "#1f7fd1",
    "paused": "#d9a21b",
    "completed": "#2e9e5b",
    "aborted": "#d9a21b",
    "tripped": "#d32f2f",
    "failed": "#d32f2f",
}
LEVELS = {"ok": "#2e9e5b", "warning": "#d9a21b", "bad": "#d32f2f"}

_STYLE = """
QGroupBox {{ border: 1px solid {border}; border-radius: 6px; margin-top: 20px; padding: 6px; background: {base}; }}
QGroupBox::title {{ subcontrol-origin: margin; left: 4px; color: {faint}; font-weight: 600; }}
QLabel[role="title"] {{ font-size: 15pt; font-weight: 600; }}
QLabel[role="faint"] {{ color: {faint}; }}
QLabel[role="error"] {{ color: {limit}; }}
QLabel[role="number"] {{ font-size: 20pt; font-weight: 600; }}
QLineEdit, QComboBox {{ padding: 4px; min-height: 22px; }}
QSpinBox {{ min-height: 30px; }}
QPushButton {{ padding: 5px 10px; min-height: 24px; }}
QListWidget::item {{ padding: 5px; border-bottom: 1px solid {border}; }}
QListWidget::item:selected {{ background: {accent}; color: {base}; }}
QPushButton[role="start"] {{ background: #2e8b57; color: white; font-weight: 700; border-radius: 6px; border: none; }}
QPushButton[role="pause"] {{ background: #c98a12; color: white; font-weight: 700; border-radius: 6px; border: none; }}
QPushButton[role="halt"] {{ background: #5f6b76; color: white; font-weight: 700; border-radius: 6px; border: none; }}
QPushButton[role="start"]:disabled, QPushButton[role="pause"]:disabled, QPushButton[role="halt"]:disabled
  {{ background: {border}; color: {faint}; }}
QPushButton[role="estop"] {{ background: #d00000; color: white; font-size: 17pt; font-weight: 800; border-radius: 10px;
  border: 3px solid #ffd400; padding: 8px 22px; }}
QPushButton[role="estop"]:pressed {{ background: #900000; }}
QFrame[role="bar"] {{ background: {base}; border: 1px solid {border}; border-radius: 6px; }}
QFrame[role="row"] {{ background: {base}; border: 1px solid {border}; border-radius: 6px; }}
QFrame[role="row"]:focus {{ border: 1px dashed {text}; }}
QFrame[role="row"][chosen="true"] {{ border: 2px solid {accent}; }}
QFrame[role="row"][chosen="true"]:focus {{ border: 2px dashed {accent}; }}
QFrame[role="alarm"] {{ background: #d00000; border-radius: 6px; }}
QFrame[role="alarm"] QLabel {{ color: white; font-size: 13pt; font-weight: 700; }}
QFrame[role="offer"] {{ background: {accent}; border-radius: 6px; }}
QFrame[role="offer"] QLabel {{ color: {base}; font-weight: 600; }}
QTabWidget::pane {{ border: 1px solid {border}; background: {base}; top: -1px; }}
QTabWidget > QStackedWidget {{ background: {base}; }}
QTabBar::tab {{ padding: 8px 9px; background: {raised}; border: 1px solid {border}; border-bottom: none;
  border-top-left-radius: 4px; border-top-right-radius: 4px; margin-right: 2px; }}
QTabBar::tab:selected {{ font-weight: 600; background: {base}; }}
"""


def apply(app: QApplication, theme: Theme) -> None:
    """Dress the whole application; plots made afterwards have the colours too."""
    app.setStyle("Fusion")
    palette = QPalette()
    roles = QPalette.ColorRole
    for role, colour in {
        roles.Window: theme.window, roles.Base: theme.base, roles.AlternateBase: theme.raised,
        roles.Button: theme.raised, roles.ToolTipBase: theme.raised, roles.WindowText: theme.text,
        roles.Text: theme.text, roles.ButtonText: theme.text, roles.ToolTipText: theme.text,
        roles.PlaceholderText: theme.faint, roles.Highlight: theme.accent, roles.HighlightedText: theme.base,
        roles.Mid: theme.border, roles.Link: theme.accent,
    }.items():  # fmt: skip
        palette.setColor(role, QColor(colour))
    for role in (roles.Text, roles.ButtonText, roles.WindowText):
        palette.setColor(QPalette.ColorGroup.Disabled, role, QColor(theme.faint))
    app.setPalette(palette)
    font = app.font()
    font.setPointSize(POINT_SIZE)
    app.setFont(font)
    app.setStyleSheet(_STYLE.format(**{k: v for k, v in vars(theme).items() if isinstance(v, str)}))
    # Width-1 pens without antialiasing: anything else costs a laptop without a GPU its frame rate.
    pg.setConfigOptions(background=theme.base, foreground=theme.text, antialias=False, useOpenGL=False)


def current() -> Theme:
    """The theme the application wears."""
    base = QApplication.palette().color(QPalette.ColorRole.Base).name()
    return next((theme for theme in THEMES.values() if theme.base == base), LIGHT)
