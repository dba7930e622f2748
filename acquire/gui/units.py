"""Units on the screen: pascals and metres inside, millibars and millimetres for people."""

from __future__ import annotations

import math

from acquire.report.summary import pleasant

__all__ = ["clock", "pleasant", "span", "unit_of"]


def unit_of(channel: str) -> str:
    """The SI unit of a commanded quantity or channel of ours by its name; '' for others."""
    from protocols.units import KINDS, kind_of

    try:
        return KINDS[kind_of(channel)][0]
    except ValueError:
        return ""


def clock(seconds: float) -> str:
    """``95 s`` as ``1:35``, an en dash where there is none; hours where needed."""
    if not math.isfinite(seconds):
        return "–"
    whole = max(0, math.ceil(seconds - 1e-6))
    hours, rest = divmod(whole, 3600)
    return f"{hours}:{rest // 60:02}:{rest % 60:02}" if hours else f"{rest // 60}:{rest % 60:02}"


def span(seconds: float) -> str:
    """A long time in its largest fitting unit: ``12 min``, ``6.3 h``, ``40 d``."""
    if not math.isfinite(seconds):
        return "–"
    for factor, unit in ((86400.0, "d"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 2 * factor:
            return f"{seconds / factor:.3g} {unit}"
    return f"{seconds:.0f} s"
