"""Numbers as laboratories state them, with unit and uncertainty: ``1.0±0.1 mm``, ``1.0(1) mm``, ``400 N/m ± 1 %``."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

from protocols import units

MOST = 20  # numbers of one statement, or properties of one specimen
_PLUS_MINUS = re.compile(r"±|\+/-|\+-")
_LAST_DIGITS = re.compile(r"\s*([-+]?\d+(?:\.(\d*))?)\((\d+)\)(.*)", re.ASCII | re.DOTALL)
"""The uncertainty of a number's last digits, in brackets behind them (GUM 7.2.2): 1.000(2) is 1.000 ± 0.002."""

Raw = tuple[tuple[float, ...], float | None, str]
"""Value, standard uncertainty or None, SI unit ('' where none was said)."""


def read_uncertain(given: object) -> Raw:
    """``given`` as text with its unit, a number or list in SI, or a mapping of ``value``, ``se`` and ``unit``.

    Raises ValueError that says what cannot be read.
    """
    if isinstance(given, Mapping):
        return _read_mapping(given)
    if isinstance(given, str):
        return _read_text(given)
    return _numbers(given), None, ""


def _read_mapping(given: Mapping[Any, Any]) -> Raw:
    given = {("se" if k in ("uncertainty", "u", "standard_uncertainty") else k): v for k, v in given.items()}
    if unknown := [str(k) for k in given if k not in ("value", "se", "unit")]:
        raise ValueError(f"{', '.join(unknown)} is not understood; there is value, se and unit")
    if isinstance(given.get("value"), str) and not given.get("unit"):
        value, se, unit = _read_text(given["value"])
        factor = 1.0
    else:
        value, se = _numbers(given.get("value")), None
        unit, factor = _si(str(given.get("unit", "")))
    if "se" in given:
        se = _uncertainty(given["se"], value, unit, factor)
    return _times(value, factor), se, unit


def _uncertainty(given: object, value: tuple[float, ...], unit: str, factor: float) -> float:
    """A standard uncertainty in SI; ``factor`` takes the unit of ``value`` to SI."""
    if isinstance(given, str):
        (se,), _, own = _read_text(given + (" " if "%" not in given else ""))
        if given.strip().endswith("%"):
            return _not_negative(se * max(abs(v) for v in value) * factor)
        if own and own != unit and not (own == "rad" and len(value) > 1):  # a direction's is an angle
            raise ValueError(f"its uncertainty is in {own}, not in {unit or '1'}")
        return _not_negative(se if own else se * factor)
    (se,) = _numbers(given)
    return _not_negative(se * factor)


def _read_text(text: str) -> Raw:
    parts = _beside_plus_minus(text)
    value, unit = _quantity(parts[0])
    if len(parts) == 1:
        si, factor = _si(unit)
        return _times(value, factor), None, si
    se, own = _stated_uncertainty(parts)
    if own == "%":
        si, factor = _si(unit)
        value = _times(value, factor)
        return value, _not_negative(se / 100.0 * max(map(abs, value))), si
    # A unit after ± is the value's, too, where that has none; but not of a direction: there it is an angle's.
    scalar = len(value) == 1
    si, factor = _si(unit or (own if scalar else ""))
    theirs, scale = _si(own or unit)
    if theirs != si and (scalar or theirs != "rad"):
        raise ValueError(f"its uncertainty is in {theirs or '1'}, not in {si or '1'}")
    return _times(value, factor), _not_negative(se * scale), si


def _beside_plus_minus(text: str) -> list[str]:
    """The value and, where it is stated, the uncertainty, as written."""
    if len(text) > 3 * units.MAX_LENGTH:
        raise ValueError("is too long")
    if concise := _LAST_DIGITS.fullmatch(text):
        value, decimals, last, unit = concise.groups()
        return [value + unit, f"{int(last)}e-{len(decimals or '')}{unit}"]
    parts = _PLUS_MINUS.split(text)
    if len(parts) > 2:
        raise ValueError(f"{text!r} has more than one ±")
    return parts


def _stated_uncertainty(parts: Sequence[str]) -> tuple[float, str]:
    """The number and the unit, as written, after the ± between ``parts``."""
    (se, *more), unit = _quantity(parts[1])
    if more:
        raise ValueError("has more than one uncertainty")
    if unit.startswith("%") and unit != "%":  # not so many per cent of a unit
        raise ValueError(f"put the unit before ±, as in '{parts[0].strip()} {unit[1:].strip()} ± {se:g} %'")
    return se, unit


def _times(value: tuple[float, ...], factor: float) -> tuple[float, ...]:
    return tuple(v * factor for v in value)


_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_QUANTITY = re.compile(rf"\s*(?P<numbers>{_NUMBER}(?:[\s,]+{_NUMBER})*)\s*(?P<unit>[^\d\s,].*?)?\s*", re.ASCII)


def _quantity(text: str) -> tuple[tuple[float, ...], str]:
    found = _QUANTITY.fullmatch(text)
    if found is None:
        raise ValueError(f"{text.strip()[: units.MAX_LENGTH]!r} does not read as a number with its unit")
    return _numbers([float(n) for n in re.findall(_NUMBER, found["numbers"])]), found["unit"] or ""


def _si(unit: str) -> tuple[str, float]:
    """SI name and factor; nothing was said where the unit is empty."""
    if not unit:
        return "", 1.0
    si, factor, offset = units.to_si(unit)
    if offset:
        raise ValueError(f"{unit!r} has an offset")
    return si, factor


def _numbers(given: object) -> tuple[float, ...]:
    items = list(given) if isinstance(given, list | tuple) else [given]
    numbers = tuple(float(v) for v in items if isinstance(v, int | float) and not isinstance(v, bool))
    if not 0 < len(numbers) == len(items) <= MOST:
        raise ValueError(f"{str(given)[: units.MAX_LENGTH]!r} is no number")
    if not all(math.isfinite(v) for v in numbers):
        raise ValueError("is not finite")
    return numbers


def _not_negative(se: float) -> float:
    if not (se >= 0.0 and math.isfinite(se)):
        raise ValueError(f"its uncertainty {se:g} is negative or not finite")
    return se
