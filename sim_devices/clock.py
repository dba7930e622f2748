"""The time in which a simulated instrument lives: real, scaled, or moved by hand.

Simulated time never jumps: an instrument that falls behind (its computation is slow, or the host does not
read) calls `Clock.slip`, and its clock goes on from where the instrument is.
"""

from __future__ import annotations

import abc
import threading
import time


class Clock(abc.ABC):
    """Simulated seconds since the instrument was switched on."""

    @property
    @abc.abstractmethod
    def speed(self) -> float:
        """Simulated seconds per second of wall time."""

    @abc.abstractmethod
    def hurry(self, needed: bool) -> None:
        """Whether time is to run as fast as it may, or no faster than real because nobody waits for it."""

    @abc.abstractmethod
    def now(self) -> float:
        """Simulated time in s."""

    @abc.abstractmethod
    def wall_until(self, moment: float) -> float:
        """Wall time in s until ``moment`` (simulated s), 0 when it has passed; one may sleep so long."""

    @abc.abstractmethod
    def slip(self, moment: float) -> None:
        """Let it be ``moment`` (simulated s, not later than now) again: the instrument could not keep up."""


#: Beyond, the time of a sample is shorter than any computer's turn, and at last no number.
MAX_SPEED = 1e5


class ScaledClock(Clock):
    """Wall time times ``speed`` (1 is real time); at most times ``idle`` while told not to hurry."""

    def __init__(self, speed: float = 1.0, idle: float = 1.0) -> None:
        if not 0 < speed <= MAX_SPEED:
            raise ValueError(f"the speed of simulated time is positive and at most {MAX_SPEED:g}, not {speed:g}")
        self._fastest, self._idle, self._speed = speed, min(speed, idle), speed
        self._origin = time.monotonic()

    @property
    def speed(self) -> float:
        return self._speed

    def hurry(self, needed: bool) -> None:
        speed = self._fastest if needed else self._idle
        if speed != self._speed:
            now = self.now()
            self._speed = speed
            self.slip(now)

    def now(self) -> float:
        return (time.monotonic() - self._origin) * self._speed

    def wall_until(self, moment: float) -> float:
        return max(0.0, self._origin + moment / self._speed - time.monotonic())

    def slip(self, moment: float) -> None:
        self._origin = time.monotonic() - moment / self._speed


class ManualClock(Clock):
    """Stands still until `advance` is called: for tests that must not depend on the machine's load."""

    _LOOK_AGAIN = 0.001

    def __init__(self) -> None:
        self._now = 0.0
        self._lock = threading.Lock()

    @property
    def speed(self) -> float:
        return 1.0

    def hurry(self, needed: bool) -> None:
        """Nothing: it moves when it is moved."""

    def now(self) -> float:
        with self._lock:
            return self._now

    def advance(self, seconds: float) -> None:
        """Let ``seconds`` pass."""
        with self._lock:
            self._now += seconds

    def wall_until(self, moment: float) -> float:
        return 0.0 if self.now() >= moment else self._LOOK_AGAIN

    def slip(self, moment: float) -> None:
        """Nothing: time that was advanced by hand is caught up with, however long it takes."""
