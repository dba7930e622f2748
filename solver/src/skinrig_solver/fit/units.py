"""Numbers with units at the edge of a fit: ``12 kPa`` in a spec becomes 12000.0, and 12000.0 is shown as ``12 kPa``."""

from __future__ import annotations

import re

UNITS: dict[str, dict[str, float]] = {
    "": {"": 1.0, "%": 1e-2},
    "Pa": {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "GPa": 1e9, "mbar": 1e2, "bar": 1e5},
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6},
    "s": {"s": 1.0, "ms": 1e-3, "min": 60.0},
    "N": {"N": 1.0, "mN": 1e-3},
    "Hz": {"Hz": 1.0, "kHz": 1e3, "1/s": 1.0},
}
_SHOWN = {"Pa": ("MPa", "kPa", "Pa"), "m": ("mm", "µm"), "s": ("s", "ms"), "N": ("N", "mN")}
_QUANTITY = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\S*)\s*")


def read(value: object, unit: str, where: str) -> float:
    """A number in SI of the given SI ``unit``, from a number (SI) or a text such as '12 kPa'.

    Raises ValueError naming ``where`` if it is neither or of another unit. An SI unit outside the table stands only
    for itself.
    """
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ValueError(f"{where}: {value!r} is not a number{f' in {unit}' if unit else ''}")
    if not isinstance(value, str):
        return float(value)
    match = _QUANTITY.fullmatch(value)
    known = UNITS.get(unit, {unit: 1.0, "": 1.0})
    if match is None or match[2] not in known:
        raise ValueError(
            f"{where}: {value!r} is not a number in {' or '.join(u for u in known if u) or 'plain figures'}"
        )
    return float(match[1]) * known[match[2]]


def readable(value: float, unit: str) -> tuple[str, float]:
    """The most readable multiple of an SI unit for a value, and how many SI units it is."""
    for name in _SHOWN.get(unit, ()):
        if abs(value) >= 0.1 * UNITS[unit][name]:
            return name, UNITS[unit][name]
    return unit, 1.0


def show(value: float, unit: str, digits: int = 4) -> str:
    """``value`` [SI unit] with its most readable multiple of the unit."""
    name, factor = readable(value, unit)
    return f"{value / factor:.{digits}g} {name}".rstrip()
