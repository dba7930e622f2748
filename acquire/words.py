"""Numbers as people read them: the one home of units, durations and shares on the screen, in pages and in a terminal.

Everything takes SI and gives an en dash where there is no number: no infinity, no NaN, no exponent where a plain number
will do.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

NONE = "–"
#: Units that people read a quantity in, and the factor from SI.
PLEASANT: Mapping[str, tuple[float, str]] = {"Pa": (0.01, "mbar"), "m": (1e3, "mm"), "m*s": (1e3, "mm·s")}
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_MULTIPLES = {
    "Pa": (("GPa", 1e9), ("MPa", 1e6), ("kPa", 1e3), ("Pa", 1.0)),
    "m": (("m", 1.0), ("mm", 1e-3), ("µm", 1e-6)),
    "s": (("s", 1.0), ("ms", 1e-3)),
    "N": (("N", 1.0), ("mN", 1e-3)),
}
YEAR = 365 * 86400.0  # s
GREATEST_SHARE = 10.0  # a share beyond it says no more than that it is large


def pleasant(unit: str) -> tuple[float, str]:
    """Factor and name of the unit that a value in ``unit`` (SI) is shown in."""
    return PLEASANT.get(unit, (1.0, "" if unit == "1" else unit))


def unit_of(channel: str) -> str:
    """The SI unit of a commanded quantity or channel of ours by its name; '' for others."""
    from protocols.units import KINDS, kind_of

    try:
        return KINDS[kind_of(channel)][0]
    except ValueError:
        return ""


def shown(value: float | None, unit: str) -> str:
    """A value in SI ``unit`` to three digits with its pleasant unit."""
    if value is None or not math.isfinite(value):
        return NONE
    factor, name = pleasant(unit)
    return f"{number(value * factor)} {name}".rstrip()


def reading(channel: str, value: float, per: str = "") -> str:
    """A value (SI) of a commanded quantity or channel to four digits, in the unit that people read; ``per``: ``/s``."""
    unit = unit_of(channel)
    factor, name = pleasant(unit)
    return f"{number(value * factor, 4)} {name}{per}" if unit else f"{number(value, 4)}{per} (SI)"


def multiple(value: float, unit: str) -> str:
    """A value in SI ``unit`` to five digits in its most readable multiple: ``20 kPa``, ``2 mm``, ``10⁻⁸ Hz``."""
    if value == 0.0:
        return f"0 {unit}".rstrip()
    for name, factor in _MULTIPLES.get(unit, ()):
        if factor <= abs(value) < 99999.5 * factor:
            return f"{value / factor:.5g} {name}"
    if 1e-3 <= abs(value) < 99999.5:
        return f"{value:.5g} {unit}".rstrip()
    power = math.floor(math.log10(abs(value)))
    digits = f"{value / 10.0**power:.5g}"
    if digits in ("10", "-10"):
        digits, power = digits[:-1], power + 1
    ten = f"10{str(power).translate(_RAISED)}"
    mantissa = {"1": "", "-1": "-"}.get(digits, f"{digits}·")
    return f"{mantissa}{ten} {unit}".rstrip()


def number(value: float, digits: int = 3) -> str:
    """``value`` to ``digits`` significant digits; large ones whole instead of with an exponent."""
    if not math.isfinite(value):
        return NONE
    return f"{value:.0f}" if 10.0**digits <= abs(value) < 1e9 else f"{value:.{digits}g}"


def clock(seconds: float) -> str:
    """``95 s`` as ``1:35``; hours where needed."""
    if not math.isfinite(seconds):
        return NONE
    whole = max(0, math.ceil(seconds - 1e-6))
    hours, rest = divmod(whole, 3600)
    return f"{hours}:{rest // 60:02}:{rest % 60:02}" if hours else f"{rest // 60}:{rest % 60:02}"


def span(seconds: float) -> str:
    """A time in its largest fitting unit: ``0.25 s``, ``12 min``, ``6.3 h``, ``40 d``, ``more than a year``."""
    if math.isnan(seconds):
        return NONE
    if seconds > YEAR:
        return "more than a year"
    for factor, unit in ((86400.0, "d"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 2 * factor:
            return f"{number(seconds / factor)} {unit}"
    return f"{number(seconds)} s"


def share(part: float | None) -> str:
    """A part of the whole in per cent to two digits: ``2.5 %``, ``40 %``, ``below 0.1 %``."""
    if part is None or not math.isfinite(part):
        return NONE
    if abs(part) > GREATEST_SHARE:
        return f"more than {100 * GREATEST_SHARE:.0f} %"
    if 0 < abs(part) < 0.001:
        return "below 0.1 %"
    return f"{number(100 * part, 2)} %"
