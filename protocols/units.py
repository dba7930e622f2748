"""Quantities with units, as written by people: ``-300 mbar``, ``1.2 mm``, ``0.1 Hz``; floats in SI inside.

Pint is imported at the first use, because it takes longer than most commands need altogether.
"""

from __future__ import annotations

import functools
import math
import re
from typing import Any

#: Per kind of quantity: its SI unit and the units tried, in this order, when a value is written for people.
KINDS: dict[str, tuple[str, tuple[str, ...]]] = {
    "pressure": ("Pa", ("mbar",)),
    "pressure rate": ("Pa/s", ("mbar/s",)),
    "length": ("m", ("mm",)),
    "speed": ("m/s", ("mm/s",)),
    "time": ("s", ("s",)),
    "frequency": ("Hz", ("Hz",)),
    "force": ("N", ("N",)),
    "force rate": ("N/s", ("N/s",)),
    "angle": ("rad", ("deg",)),
    "voltage": ("V", ("V",)),
    "scale": ("m/px", ("mm/px",)),
}
_TEXT = re.compile(r"\s*(?P<number>[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?)\s*(?P<unit>[^\d\s].*?)?\s*", re.ASCII)
MAX_LENGTH = 60  # characters: a quantity is short, and pint's parser is not to be fed with anything else
# Pint works out whatever is written: a power of a power, or numbers of many digits, would keep it busy for years.
_ENDLESS = re.compile(r"(\*\*|\^)[^a-zA-Zµμ%°]*(\*\*|\^)|\d{4}")


@functools.lru_cache(maxsize=1)
def _registry() -> Any:
    import pint

    # Pint's own px is the typesetter's, a length; a camera's pixels are counted. Its Nm is a yarn's length by mass.
    pixels: Any = lambda text: re.sub(r"\bpx\b", "pixel", text)  # noqa: E731
    torques: Any = lambda text: re.sub(r"\b([kmuµμ]?)Nm\b", r"\1N*m", text)  # noqa: E731
    return pint.UnitRegistry(cache_folder=None, preprocessors=[pixels, torques])


@functools.lru_cache(maxsize=256)
def _affine(unit: str, kind: str) -> float:
    """Factor from ``unit`` to the SI unit of ``kind``. Raises ValueError."""
    si = KINDS[kind][0]
    try:
        _check_length(unit)
        return float(_registry().Quantity(1.0, unit).to(si).magnitude)
    except Exception as error:  # pint raises its own tree, and Python's tokenizer leaks through it
        known = " or ".join(dict.fromkeys((*KINDS[kind][1], si)))
        raise ValueError(f"{unit!r} is no unit of {kind}; write it in {known}") from error


def _check_length(unit: str) -> None:
    if len(unit) > MAX_LENGTH or _ENDLESS.search(unit):
        raise ValueError("too long to be worked out")


def parse(text: object, kind: str) -> float:
    """The value of ``text`` (such as ``-300 mbar``) in the SI unit of ``kind``, a key of `KINDS`.

    A bare number has no unit and is refused, zero and pure angles included.

    Raises ValueError: no number, no unit, a unit of another kind, not finite.
    """
    example = f"-300 {KINDS[kind][1][0]}" if kind == "pressure" else f"1.2 {KINDS[kind][1][0]}"
    if isinstance(text, bool) or not isinstance(text, (str, int, float)):
        raise ValueError(f"expected {kind}, such as '{example}'")
    if not isinstance(text, str):
        raise ValueError(f"a unit is missing: {text!r} should be {kind}, such as '{example}'")
    found = _TEXT.fullmatch(text) if len(text) <= MAX_LENGTH else None
    if found is None:
        raise ValueError(f"{text[:MAX_LENGTH]!r} does not read as {kind}, such as '{example}'")
    if found["unit"] is None:
        raise ValueError(f"a unit is missing: {text!r} should be {kind}, such as '{example}'")
    value = float(found["number"]) * _affine(found["unit"], kind)
    if not math.isfinite(value):
        raise ValueError(f"{text!r} is not finite")
    return value


def split(text: str) -> tuple[float, str]:
    """The number and the unit of ``text``, unconverted. Raises ValueError where it is no number with a unit."""
    found = _TEXT.fullmatch(text) if len(text) <= MAX_LENGTH else None
    if found is None or found["unit"] is None or not math.isfinite(float(found["number"])):
        raise ValueError(f"{text[:MAX_LENGTH]!r} is no number with a unit")
    return float(found["number"]), found["unit"]


def parse_in(text: str, unit: str) -> float:
    """The value of ``text``, a number in ``unit`` or with a unit of its own. Raises ValueError."""
    found = _TEXT.fullmatch(text) if len(text) <= MAX_LENGTH else None
    if found is None:
        raise ValueError(f"{text[:MAX_LENGTH]!r} is no number with a unit")
    value = float(found["number"])
    if found["unit"] is not None:
        own, factor, offset = to_si(found["unit"])
        si, scale, zero = to_si(unit)
        if own != si:
            raise ValueError(f"{found['unit']!r} is no unit of {unit}")
        value = (value * factor + offset - zero) / scale
    if not math.isfinite(value):
        raise ValueError(f"{text!r} is not finite")
    return value


def write(value: float, kind: str) -> str:
    """``value`` (SI) as text that `parse` reads back to the same float, in a unit that people use if that is exact."""
    si, pleasant = KINDS[kind]
    for unit in pleasant:
        for digits in (6, 12, 17):
            number = f"{value / _affine(unit, kind):.{digits}g}"
            if float(number) * _affine(unit, kind) == value:
                return f"{number} {unit}"
    return f"{value!r} {si}"


CHANNELS = {
    **dict.fromkeys(("pressure", "pressure_reference"), "pressure"),
    **dict.fromkeys(("apex_height", "probe", *(f"probe_{k}" for k in "xyz")), "length"),
    **dict.fromkeys((f"axis_position_{k}" for k in "123"), "length"),
    **dict.fromkeys((*(f"transducer_force_{k}" for k in "abc"), *(f"force_{k}" for k in "xyz")), "force"),
}
"""The kind of each channel and commanded quantity of our instruments; ``probe`` is the length of the probe's vector."""


def kind_of(channel: str) -> str:
    """The kind of quantity that a channel or commanded quantity carries. Raises ValueError for one of no instrument."""
    if channel not in CHANNELS:
        raise ValueError(f"unknown channel {channel!r}; there is {', '.join(CHANNELS)}")
    return CHANNELS[channel]


def rate_kind(kind: str) -> str:
    """The kind of the time derivative of ``kind``."""
    return {"pressure": "pressure rate", "length": "speed", "force": "force rate"}[kind]


#: SI names preferred over base units when a channel of any instrument is converted.
_NAMED = ("Pa", "N", "V", "J", "W", "m/s", "m/s^2", "N/m", "N/s", "Pa/s", "V/s")


TORQUE = "N m"
"""SI name of a torque, which has the dimension of an energy and is none."""


def _is_torque(unit: Any) -> bool:
    """Whether a unit is written as a force times a length."""
    registry = _registry()
    parts = dict(registry.Quantity(1.0, unit).unit_items())
    kinds = {registry.Unit(name).dimensionality for name in parts}
    return set(parts.values()) == {1} and kinds == {registry.Unit(name).dimensionality for name in TORQUE.split()}


@functools.lru_cache(maxsize=256)
def to_si(unit: str) -> tuple[str, float, float]:
    """SI unit, factor and offset of ``unit`` of any kind: ``si = factor * value + offset`` (``degC`` has an offset).

    ``mbar`` gives Pa, ``gf`` N, ``mN m`` N m, ``%``, ``-`` and an empty unit ``1``. Raises ValueError for a unit that
    nobody knows, and for a logarithmic one.
    """
    registry = _registry()
    try:
        _check_length(unit)
        parsed = registry.Unit("" if unit.strip() in ("", "1", "-") else unit)
        named = (name for name in _NAMED if registry.Unit(name).dimensionality == parsed.dimensionality)
        base = registry.Quantity(1.0, parsed).to_base_units().units
        si = TORQUE if _is_torque(parsed) else next(named, f"{base:~C}".replace("**", "^") or "1")
        target = registry.Unit(si if si != "1" else "")
        offset, first, second = (float(registry.Quantity(v, parsed).to(target).magnitude) for v in (0.0, 1.0, 2.0))
        factor = first - offset
        if not math.isclose(second, offset + 2.0 * factor, rel_tol=1e-9, abs_tol=1e-300):
            raise ValueError("a logarithmic unit has no factor")
    except Exception as error:  # pint raises its own tree, and Python's tokenizer leaks through it
        raise ValueError(f"{unit[:MAX_LENGTH]!r} is not a unit") from error
    if not (math.isfinite(factor) and math.isfinite(offset) and factor):
        raise ValueError(f"{unit!r} is not a unit")
    return si, factor, offset
