"""Whether this computer stood still while it was responsible for a person: suspended, or stopped and continued.

Everything is timed by the monotonic clock, so that setting the wall clock changes nothing. Linux's monotonic clock
stands still while the computer is suspended and its boot-time clock does not: the difference tells. A process that
was stopped (or starved) sees its own turns far apart. Either way the instrument has vented by its watchdog meanwhile;
here the run learns why.
"""

from __future__ import annotations

import time

SUSPENDED = 0.1  # s that the boot-time clock gains on the monotonic one; else they differ by microseconds


def boot_time() -> float:
    """Seconds since the computer was started, time asleep included where the system counts it."""
    clock = getattr(time, "CLOCK_BOOTTIME", None)
    return time.monotonic() if clock is None else time.clock_gettime(clock)


class HostClock:
    """Asked at every turn of a loop; ``patience`` is the longest time in s between two turns."""

    def __init__(self, patience: float) -> None:
        self._patience = patience
        self._turn = time.monotonic()
        self._asleep = boot_time() - self._turn

    def fault(self) -> str:
        """The clock's jump since the last call, in words; '' if there was none."""
        now = time.monotonic()
        asleep = boot_time() - now
        slept, pause = asleep - self._asleep, now - self._turn
        self._turn, self._asleep = now, asleep
        if slept > SUSPENDED:
            return f"the computer was suspended for {slept:.1f} s"
        return f"this program stood still for {pause:.1f} s" if pause > self._patience else ""
