"""Numbers with their units as people write them, in every sentence, table and page of a diagnosis."""

from __future__ import annotations

import math

PREFIXED = {"m": (("m", 1.0, 0.5), ("mm", 1e3, 1e-3), ("µm", 1e6, 1e-7), ("nm", 1e9, 0.0)),
            "s": (("s", 1.0, 0.1), ("ms", 1e3, 0.0)),
            "Pa": (("mbar", 1e-2, 0.0),), "N": (("N", 1.0, 0.1), ("mN", 1e3, 0.0)),
            "m/Pa": (("µm/mbar", 1e8, 0.0),), "N/m": (("N/mm", 1e-3, 0.0),), "kg": (("kg", 1.0, 1.0), ("g", 1e3, 0.0)),
            "s/s": (("ms/s", 1e3, 1e-3), ("µs/s", 1e6, 0.0)), "%": (("%", 1e2, 0.0),)}  # fmt: skip
"""For an SI unit (``%``: a relative error): unit, factor, and the least magnitude (SI) for which people use it."""

UNNAMED = ("1", "choice", "velocity", "position", "rate")
"""Pure numbers, and quantities of a rig's model without a stated unit."""


def quantity(value: float, unit: str, se: float | None = None, name: str = "") -> str:
    """A number as people write it: ``0.31 ± 0.02 s``, ``98.2 µm``; nothing after a pure number.

    ``value`` and standard error ``se`` in SI; with one the value has as many decimals. Relative errors, which the
    parameter's ``name`` tells, are in per cent.
    """
    if unit == "1" and "error" in name.split("_"):
        unit = "%"
    size = max(abs(value), abs(se or 0.0))
    shown, factor, _ = next((u for u in PREFIXED.get(unit, ()) if size >= u[2]), (unit, 1.0, 0.0))
    after = "" if shown in UNNAMED else f" {shown}"
    if not se or not math.isfinite(se):
        return f"{significant(value * factor)}{after}"
    decimals = max(-math.floor(math.log10(float(f"{se * factor:.0e}"))), 0)
    return f"{value * factor:z.{decimals}f} ± {float(f'{se * factor:.0e}'):.{decimals}f}{after}"


def significant(x: float, digits: int = 3) -> str:
    """``x`` to some significant digits, without a power of ten where people write none: ``40``, ``1320``."""
    return f"{float(f'{x:.{digits}g}'):g}"
