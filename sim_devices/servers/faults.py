"""What can go wrong on a link or in a sensor, switched on through the back door."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from drivers.signals import FloatArray


@dataclass
class Faults:
    """Faults pending on one instrument; all off at first.

    ``garbage`` random bytes go out before the next message; the next ``corrupt`` messages have one byte changed, the
    next ``repeat`` are sent twice; ``short`` bytes are the most sent at once (0: no limit); until ``stall_until``
    (wall, monotonic s) no byte goes either way; ``nan`` maps raw channels to how many of their next samples are no
    number (math.inf: all).
    """

    garbage: int = 0
    corrupt: int = 0
    repeat: int = 0
    short: int = 0
    stall_until: float = -math.inf
    nan: dict[str, float] = field(default_factory=dict)
    random: Any = field(default_factory=lambda: np.random.default_rng(0))

    def stalled(self, wall: float) -> bool:
        """Whether the link is mute at ``wall`` (monotonic s)."""
        return wall < self.stall_until

    def transmit(self, data: bytes) -> bytes:
        """What goes onto the wire instead of one message's ``data``."""
        if self.corrupt:
            self.corrupt -= 1
            spot = int(self.random.integers(len(data)))
            data = data[:spot] + bytes((data[spot] ^ 0x55,)) + data[spot + 1 :]
        if self.repeat:
            self.repeat -= 1
            data = data + data
        if self.garbage:
            data = self.random.bytes(self.garbage) + data
            self.garbage = 0
        return data

    def spoil(self, values: FloatArray, raw: tuple[str, ...]) -> None:
        """Make samples (n, raw channels) not numbers, in place."""
        for column, name in enumerate(raw):
            left = self.nan.get(name, 0)
            if left > 0:
                count = int(min(left, len(values)))
                values[:count, column] = np.nan
                self.nan[name] = left - count
