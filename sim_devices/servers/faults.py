"""Faults of a link, a clock or a sensor, switched on through the back door.

Sensors are distorted between converter and wire, so that the instrument's own limits do not see it: the worst case for
a host. ``docs/instruments.md`` lists the faults; `sim_devices.servers.proxy` makes those of a cable.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from drivers.device import Status
from drivers.signals import FloatArray

#: How a sensor may fail. ``amount`` is in the channel's SI unit: the value it is ``stuck`` at, the one ``offset`` and
#: ``spike`` add, the rate of ``drift`` per s; for ``scale`` a factor. ``frozen`` keeps the last sound value.
SENSOR = ("nan", "inf", "stuck", "frozen", "spike", "scale", "offset", "drift", "sign")
#: Repeated for ever while the link works: the last ``packet``, byte for byte, or only its ``time`` or ``sequence``.
STALE = ("packet", "time", "sequence")


@dataclass
class Distortion:
    """One failing sensor, for the next ``left`` samples (math.inf: until it is healed)."""

    kind: str
    amount: float = 0.0
    left: float = math.inf
    elapsed: int = 0
    last: float = math.nan

    def apply(self, values: FloatArray, rate: float) -> None:
        """Distort the samples (n,) of one channel, taken ``rate`` times per s, in place."""
        count = int(min(self.left, len(values)))
        if count:
            self.last = float(values[0]) if math.isnan(self.last) else self.last
            seconds = (self.elapsed + np.arange(1, count + 1)) / rate
            values[:count] = _DISTORT[self.kind](values[:count], self, seconds)
            self.elapsed += count
            self.left -= count


_DISTORT: dict[str, Callable[[FloatArray, Distortion, FloatArray], FloatArray | float]] = {
    "nan": lambda values, fault, seconds: math.nan,
    "inf": lambda values, fault, seconds: math.inf,
    "stuck": lambda values, fault, seconds: fault.amount,
    "frozen": lambda values, fault, seconds: fault.last,
    "spike": lambda values, fault, seconds: values + fault.amount,
    "scale": lambda values, fault, seconds: values * fault.amount,
    "offset": lambda values, fault, seconds: values + fault.amount,
    "drift": lambda values, fault, seconds: values + fault.amount * seconds,
    "sign": lambda values, fault, seconds: -values,
}


@dataclass
class Faults:
    """Faults pending on one instrument; all off at first.

    Of the next messages on the wire ``corrupt`` have one byte changed, ``truncate`` lose their second half, ``drop``
    are lost, ``repeat`` are sent twice, ``swap`` come after the one that follows them; ``garbage`` random bytes go out
    before the next one; ``short`` bytes are the most sent at once (0: no limit). Until ``stall_until`` (wall, monotonic
    s) no byte goes either way. ``stale`` is one of `STALE` or empty; ``sensors`` maps raw channels to their faults.
    """

    garbage: int = 0
    corrupt: int = 0
    truncate: int = 0
    drop: int = 0
    repeat: int = 0
    swap: int = 0
    short: int = 0
    stall_until: float = -math.inf
    stale: str = ""
    sensors: dict[str, Distortion] = field(default_factory=dict)
    random: Any = field(default_factory=lambda: np.random.default_rng(0))
    _held: bytes = b""  # a message that waits for the next one to overtake it
    _packet: bytes = b""  # the last one with samples
    _stamp: tuple[int, float] | None = None  # sequence number and device time that stand still

    def clear(self) -> None:
        """Everything is well again."""
        self.__dict__.update(Faults(random=self.random).__dict__)

    def stalled(self, wall: float) -> bool:
        """Whether the link is mute at ``wall`` (monotonic s)."""
        return wall < self.stall_until

    def transmit(self, data: bytes) -> bytes:
        """The bytes on the wire instead of one message's ``data``."""
        if self._take("drop"):
            return b""
        if self._take("corrupt"):
            spot = int(self.random.integers(len(data)))
            data = data[:spot] + bytes((data[spot] ^ 0x55,)) + data[spot + 1 :]
        if self._take("truncate"):
            data = data[: len(data) // 2]
        if self._take("repeat"):
            data = data + data
        if self.garbage:
            data = self.random.bytes(self.garbage) + data
            self.garbage = 0
        if not self._held and self._take("swap"):
            self._held = data
            return b""
        data, self._held = data + self._held, b""
        return data

    def packet(self, data: bytes) -> bytes:
        """The bytes sent instead of an encoded packet of samples or status."""
        if self.stale != "packet" or not self._packet:
            self._packet = data
        return self._packet

    def stamp(self, first: int, time: FloatArray, status: Status) -> tuple[int, FloatArray, Status]:
        """Sequence number, device times and status as the device says them."""
        if self.stale not in ("time", "sequence"):
            self._stamp = None
            return first, time, status
        if self._stamp is None:
            self._stamp = first, float(time[0])
        if self.stale == "sequence":
            return self._stamp[0], time, status
        return first, np.full_like(time, self._stamp[1]), replace(status, time=self._stamp[1])

    def spoil(self, values: FloatArray, raw: tuple[str, ...], rate: float) -> None:
        """Distort samples (n, raw channels), taken ``rate`` times per s, in place."""
        for column, name in enumerate(raw):
            if name in self.sensors:
                self.sensors[name].apply(values[:, column], rate)

    def _take(self, name: str) -> bool:
        """Whether one of the counted faults is due."""
        left: int = getattr(self, name)
        setattr(self, name, max(0, left - 1))
        return left > 0
