"""Run-time trips: what is measured, how fresh it is, and whether it follows what was commanded.

Software is not the safety device (docs/safety.md): the instrument's own limits, relief valve and watchdog are. This
thread stops the run earlier and says why.
"""

from __future__ import annotations

import collections
import math
import shutil
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from drivers.device import Status
from drivers.signals import Block, FloatArray, Frame
from protocols.limits import PROBE, Limits

AXES = ("probe_x", "probe_y", "probe_z")


@dataclass(frozen=True)
class Tracking:
    """Largest deviation of a measured quantity from its set-point: ``error`` (SI) for longer than ``duration`` s."""

    error: float
    duration: float


@dataclass(frozen=True)
class Rules:
    """How strict the interlock is.

    A measured value trips outside its limits widened by ``margin`` times their span (the set-points themselves may
    lie on the limit, and a regulator overshoots a little); its rate of change over ``rate_window`` s trips above the
    limit widened by ``rate_margin``. ``stale`` is the longest silence of a link in s of wall time, ``disk`` the least
    free space in bytes. All defaults are assumed.
    """

    margin: float = 0.1
    rate_margin: float = 0.5
    rate_window: float = 0.1
    stale: float = 1.0
    disk: int = 200_000_000
    tracking: Mapping[str, Tracking] = field(
        default_factory=lambda: {
            "pressure": Tracking(10_000.0, 3.0),
            **{axis: Tracking(1e-3, 1.0) for axis in AXES},
        }
    )


@dataclass(frozen=True)
class Trip:
    """Why a run was stopped by the interlock. ``time`` is device time in s where it is known, else NaN."""

    code: str  # value, rate, nan, stale, tracking, link, device, disk, recorder, supervisor, estop
    message: str
    time: float = math.nan


class Interlock(threading.Thread):
    """Watches one run. The first trip latches; ``on_trip`` is called at once, in the thread that found it."""

    def __init__(self, rules: Rules, on_trip: Callable[[Trip], None]) -> None:
        super().__init__(name="interlock", daemon=True)
        self.rules = rules
        self.trip: Trip | None = None
        self._on_trip = on_trip
        self._lock = threading.Lock()
        self._blocks: collections.deque[tuple[str, Block | Frame, Status | None]] = collections.deque()
        self._wake = threading.Event()
        self._heard: dict[str, float] = {}
        self._limits = Limits()
        self._commanded: Callable[[FloatArray], Mapping[str, FloatArray]] | None = None
        self._folder: Path | None = None
        self._gappy: frozenset[str] = frozenset()
        self._watching = False
        self._closing = False
        self._tails: dict[str, tuple[FloatArray, FloatArray]] = {}
        self._off_since: dict[str, float] = {}

    # Called by others -------------------------------------------------------------------------------------------------

    def watch(
        self,
        limits: Limits,
        links: tuple[str, ...],
        commanded: Callable[[FloatArray], Mapping[str, FloatArray]] | None = None,
        folder: Path | None = None,
        gappy: frozenset[str] = frozenset(),
    ) -> None:
        """Begin to watch ``limits`` per channel, freshness of ``links``, ``commanded(time)``, space at ``folder``.

        The ``gappy`` channels may be NaN: a camera does not find a contour in every picture.
        """
        now = time.monotonic()
        self._limits, self._commanded, self._folder, self._gappy = limits, commanded, folder, gappy
        self._heard = dict.fromkeys(links, now)
        self._tails.clear()
        self._off_since.clear()
        self._blocks.clear()
        self._watching = True

    def rest(self) -> None:
        """Stop watching (a latched trip stays)."""
        self._watching = False

    def receive(self, link: str, item: Block | Frame, status: Status | None) -> None:
        """Data to look at."""
        if self._watching:
            self._heard[link] = time.monotonic()
            self._blocks.append((link, item, status))
            self._wake.set()

    @property
    def backlog(self) -> int:
        """How many blocks wait to be looked at."""
        return len(self._blocks)

    def fire(self, trip: Trip) -> None:
        """Trip now. Only the first one counts."""
        with self._lock:
            if self.trip is not None:
                return
            self.trip = trip
        self._on_trip(trip)

    def reset(self) -> None:
        """Forget the latched trip: a person looked."""
        with self._lock:
            self.trip = None

    def close(self) -> None:
        """End the thread."""
        self._closing = True
        self._wake.set()

    # In this thread ---------------------------------------------------------------------------------------------------

    def run(self) -> None:
        """Look at everything that arrives, and at the clock."""
        looked = 0.0
        while not self._closing:
            self._wake.wait(0.02)
            self._wake.clear()
            try:
                while self._blocks and self._watching:
                    link, item, status = self._blocks.popleft()
                    if isinstance(item, Block) and len(item):
                        self._check(item)
                    self._check_status(link, status)
                if self._watching:
                    self._check_freshness()
                    if time.monotonic() - looked > 1.0:
                        looked = time.monotonic()
                        self._check_disk()
            except Exception as error:  # an interlock that cannot look must not let the run go on
                self.fire(Trip("interlock", f"the interlock failed: {error!r}"))
                self._watching = False

    def _check(self, block: Block) -> None:
        for name, values in block.values.items():
            bad = ~np.isfinite(values)
            if bad.any() and name not in self._gappy:
                self.fire(Trip("nan", f"{name} is not a number", float(block.time[bad.argmax()])))
                return
            self._check_value(name, values, block.time)
            self._check_rate(name, values, block.time)
        if all(axis in block.values for axis in AXES):
            way = np.sqrt(sum(block.values[axis] ** 2 for axis in AXES))
            self._check_value(PROBE, way, block.time)
        self._check_tracking(block)

    def _check_value(self, name: str, values: FloatArray, when: FloatArray) -> None:
        limit = self._limits[name]
        # A bound at infinity has no span to widen; the other one then stands as it is.
        slack = self.rules.margin * (limit.high - limit.low) if limit.bounded else 0.0
        low, high = limit.low - slack, limit.high + slack
        outside = (values < low) | (values > high)  # False for NaN
        if outside.any():
            first = outside.argmax()
            message = f"{name} is {values[first]:.6g}, outside {limit.low:.6g} … {limit.high:.6g} (SI)"
            self.fire(Trip("value", message, float(when[first])))

    def _check_rate(self, name: str, values: FloatArray, when: FloatArray) -> None:
        limit = self._limits[name].rate
        if not math.isfinite(limit):
            return
        if name in self._tails:
            old_time, old_values = self._tails[name]
            when, values = np.concatenate([old_time, when]), np.concatenate([old_values, values])
        before = np.searchsorted(when, when - self.rules.rate_window, side="right") - 1
        sound = before >= 0
        if sound.any():
            rate = np.abs(values[sound] - values[before[sound]]) / (when[sound] - when[before[sound]])
            if rate.max() > limit * (1 + self.rules.rate_margin):
                message = f"{name} changes by {rate.max():.6g} per s, more than {limit:.6g} (SI)"
                self.fire(Trip("rate", message, float(when[sound][rate.argmax()])))
        keep = when > when[-1] - 2 * self.rules.rate_window
        self._tails[name] = (when[keep], values[keep])

    def _check_tracking(self, block: Block) -> None:
        rules = {q: r for q, r in self.rules.tracking.items() if q in block.values}
        if not rules or self._commanded is None:
            return
        commanded = self._commanded(block.time)
        for quantity, rule in rules.items():
            if quantity not in commanded:
                continue
            # NaN where the set-point is not known: not off, so that the count begins anew.
            off = np.abs(block.values[quantity] - commanded[quantity]) > rule.error
            near = np.flatnonzero(~off)
            if len(near) and near[-1] == len(off) - 1:
                self._off_since.pop(quantity, None)
                continue
            if len(near) or quantity not in self._off_since:
                self._off_since[quantity] = float(block.time[near[-1] + 1 if len(near) else 0])
            since = self._off_since[quantity]
            if block.time[-1] - since > rule.duration:
                error = float(block.values[quantity][-1] - commanded[quantity][-1])
                message = f"{quantity} is off its set-point by {error:.6g} (SI) since {rule.duration:g} s"
                self.fire(Trip("tracking", message, float(block.time[-1])))

    def _check_status(self, link: str, status: Status | None) -> None:
        if status is not None and (status.state == "fault" or status.fault):
            self.fire(Trip("device", f"{link} reports {status.fault or 'a fault'}", status.time))

    def _check_freshness(self) -> None:
        now = time.monotonic()
        for link, heard in self._heard.items():
            if now - heard > self.rules.stale:
                self.fire(Trip("stale", f"{link} delivered nothing for {now - heard:.2f} s"))

    def _check_disk(self) -> None:
        if self._folder is not None and (fault := self.short_of_space(self._folder)):
            self.fire(Trip("disk", fault))

    def short_of_space(self, folder: Path) -> str:
        """What is wrong with the free space at an existing ``folder``; '' when there is enough."""
        free = shutil.disk_usage(folder).free
        enough = free >= self.rules.disk
        return "" if enough else f"{free / 1e6:.0f} MB free at {folder}, {self.rules.disk / 1e6:.0f} MB needed"
