"""Values that a channel can hold at all: beyond them its unit is wrong, or its sensor."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from acquire.recording.model import FloatArray
from drivers.signals import REFERENCE

POSSIBLE: Mapping[str, tuple[float, float, str]] = {
    "pressure": (-110e3, 110e3, "no pump reaches below vacuum"),
    "apex_height": (-20e-3, 20e-3, "skin does not rise higher than an opening is wide (2 to 8 mm)"),
}
"""Bounds (SI) of a channel of the built-in instruments, with room for offsets, and the reason."""


def impossible(channel: str, value: FloatArray, *, ours: bool = True) -> tuple[int, str]:
    """Index of the farthest of ``value`` (n,) SI that the ``channel`` cannot hold, and the reason; '' if there is none.

    Of an instrument that is not ``ours`` only suction below vacuum is impossible.
    """
    name = channel.removesuffix(REFERENCE)
    low, high, reason = POSSIBLE.get(name, (-np.inf, np.inf, ""))
    if not ours:
        low, high = (low if name == "pressure" else -np.inf), np.inf
    wrong = np.flatnonzero((value < low) | (value > high))  # False for NaN
    if not len(wrong):
        return 0, ""
    return int(wrong[np.argmax(np.abs(value[wrong]))]), reason
