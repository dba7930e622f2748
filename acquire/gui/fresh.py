"""How old a value on the screen is: a stale one must look stale."""

from __future__ import annotations

import math
import time

from acquire.words import span

LEGIBLE = 0.2  # s between two changes of a number: five per second can be read
STALE = 1.0  # s without a new value after which the last one is shown as past


class Reading:
    """The newest value of one channel (SI; NaN: it could not be measured) and when it came."""

    def __init__(self) -> None:
        self.value = math.nan
        self._at = -math.inf

    def take(self, value: float) -> None:
        """A new value."""
        self.value, self._at = value, time.monotonic()

    @property
    def known(self) -> bool:
        """Whether there is a number, be it old."""
        return math.isfinite(self.value)

    @property
    def age(self) -> str:
        """``3 s ago`` where the value is past, '' where it is not or never was."""
        old = time.monotonic() - self._at
        return f"{span(round(old))} ago" if STALE < old < math.inf else ""
