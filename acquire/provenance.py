"""Provenance of a recording's numbers: versions, calibrations, and what was settled by default."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from acquire.station import CALIBRATIONS, FRAME_SCALE, Calibration, Instrument, Station
from protocols import Protocol, units

PACKAGES = ("skinrig", "numpy", "scipy", "numba", "h5py", "pyserial", "pyusb")


def versions() -> dict[str, str]:
    """Versions of what a recording depends on."""
    found = {"python": platform.python_version(), "platform": platform.platform()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def calibration(entry: Instrument, protocol: Protocol) -> dict[str, dict[str, Any]]:
    """Name -> value (SI), unit, provenance, note: from the station, and what the protocol says of the setup."""
    result: dict[str, dict[str, Any]] = {}
    for name, known in entry.calibration.items():
        unit = units.KINDS[CALIBRATIONS[name]][0]
        result[name] = {
            "value": entry.calibrated(name),
            "unit": unit,
            "provenance": known.provenance,
            "note": known.note,
        }
    for name, kind in CALIBRATIONS.items():
        value = getattr(protocol.setup, name, None)
        if value is not None:
            unit = units.KINDS[kind][0]
            result[name] = {"value": value, "unit": unit, "provenance": "documented", "note": "by the protocol"}
    return result


def settled(station: Station) -> Station:
    """The station with all that recordings should tell: seeds of simulations, the assumed scale of cameras."""
    from acquire import simulation

    instruments = {}
    for name, entry in station.instruments.items():
        if entry.here and entry.simulated is not None:
            entry = entry.model_copy(update={"simulated": simulation.settled(entry.simulated)})
        if (entry.instrument or name) == "aspiration" and "frame_scale" not in entry.calibration:
            scale = Calibration(value=FRAME_SCALE, provenance="assumed", note="default")
            entry = entry.model_copy(update={"calibration": {**entry.calibration, "frame_scale": scale}})
        instruments[name] = entry
    return station.model_copy(update={"instruments": instruments})
