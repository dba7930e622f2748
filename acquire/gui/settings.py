"""Settings that the window keeps from one day to the next."""

from __future__ import annotations

from dataclasses import dataclass, field

from PySide6.QtCore import QByteArray, QSettings

ORGANISATION, APPLICATION = "skinrig", "window"


@dataclass
class Remembered:
    """The window's settings; nothing of a subject is among them."""

    theme: str = "light"
    out: str = "runs"
    station: str = ""
    operator: str = ""
    instrument: str = ""
    protocols: dict[str, str] = field(default_factory=dict)  # kind of instrument -> path
    geometry: QByteArray = field(default_factory=QByteArray)


def load(store: QSettings) -> Remembered:
    """The kept settings; defaults for those that were not kept.

    A station file that is gone stays: the simulated bench must not open in its place.
    """
    kept = Remembered()
    for name in ("theme", "out", "station", "operator", "instrument"):
        setattr(kept, name, str(store.value(name, getattr(kept, name))))
    store.beginGroup("protocols")
    kept.protocols = {kind: str(store.value(kind)) for kind in store.childKeys()}
    store.endGroup()
    geometry = store.value("geometry")
    if isinstance(geometry, QByteArray):
        kept.geometry = geometry
    return kept


def save(store: QSettings, kept: Remembered) -> None:
    """Remember."""
    for name in ("theme", "out", "station", "operator", "instrument", "geometry"):
        store.setValue(name, getattr(kept, name))
    for kind, path in kept.protocols.items():
        store.setValue(f"protocols/{kind}", path)
    store.sync()
