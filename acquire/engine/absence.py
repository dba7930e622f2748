"""A link that went away while no person was attached, and when to try it again."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

FIRST, LONGEST = 0.5, 30.0  # s of wall time between two tries: twice as long each time


@dataclass
class Absence:
    """``error`` is how the last try failed, at first how the link was lost."""

    error: str
    since: float = field(default_factory=time.monotonic)
    tries: int = 0
    due: float = field(default_factory=lambda: time.monotonic() + FIRST)

    def failed(self, error: str) -> None:
        """One more try was in vain."""
        self.error = error
        self.tries += 1
        self.due = time.monotonic() + min(FIRST * 2.0**self.tries, LONGEST)

    @property
    def words(self) -> str:
        """For a person."""
        gone, left = time.monotonic() - self.since, max(0.0, self.due - time.monotonic())
        return f"{self.error}; lost for {gone:.0f} s, trying again in {left:.0f} s"
