"""Run-time trips: measured values, their freshness, and whether they follow the set-points.

Software is not the safety device (docs/safety.md): the instrument's own limits, relief valve and watchdog are. This
thread stops the run earlier and says why.
"""

from __future__ import annotations

import collections
import shutil
import threading
import time
from collections.abc import Callable
from pathlib import Path

from acquire.engine.checks import LIMITS, Check, Dwells, Targets, Watch
from acquire.engine.freshness import Freshness
from acquire.engine.host_clock import HostClock
from acquire.engine.plausibility import PLAUSIBILITY, Pictures
from acquire.engine.rules import Rules, Trip
from drivers.device import Status
from drivers.signals import Block, FloatArray, Frame
from protocols.limits import Limits

#: Set-points at device times (n,) s as far as they are known, given the device's status with the samples of then.
Commanded = Callable[[FloatArray, Status | None], Targets]


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
        self._checks: tuple[Check, ...] = ()
        self._pictures = Pictures()
        self._commanded: Commanded | None = None
        self._freshness = Freshness((), rules, 0.0)
        self._clock = HostClock(rules.stale)
        self._folder: Path | None = None
        self._watching = False
        self._closing = False

    # Called by others -------------------------------------------------------------------------------------------------

    def watch(
        self,
        limits: Limits,
        links: tuple[str, ...],
        commanded: Commanded | None = None,
        folder: Path | None = None,
        gappy: frozenset[str] = frozenset(),
        yields: bool = True,
        compared: bool = True,
    ) -> None:
        """Begin to watch ``limits`` per channel, freshness of ``links``, ``commanded`` set-points, space at ``folder``.

        The first link is the driven device's. For ``gappy``, ``yields`` and ``compared`` see `Watch`.
        """
        watch = Watch(limits, self.rules, gappy, yields, compared)
        self._pictures = Pictures()
        self._commanded = commanded
        self._checks = tuple(check(watch) for check in (*LIMITS, *(PLAUSIBILITY if self.rules.plausible else ())))
        self._freshness = Freshness(links, self.rules, time.monotonic())
        self._clock = HostClock(self.rules.stale)
        self._folder = folder
        self._blocks.clear()
        self._watching = True

    def rest(self) -> None:
        """Stop watching (a latched trip stays)."""
        self._watching = False

    def receive(self, link: str, item: Block | Frame, status: Status | None) -> None:
        """Data to look at; old samples are no sign of life."""
        if self._watching and (new := self._freshness.take(link, item, time.monotonic())) is not None:
            self._blocks.append((link, new, status))
            self._wake.set()

    @property
    def dwell(self) -> dict[str, tuple[float, float]]:
        """For how long each quantity with such a limit is away from rest, and may be, in s; empty between runs."""
        found = next((check for check in self._checks if isinstance(check, Dwells)), None)
        return dict(found.now) if found is not None and self._watching else {}

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
                if self._watching and (fault := self._clock.fault()):
                    self.fire(Trip("host", fault))
                while self._blocks and self._watching:
                    link, item, status = self._blocks.popleft()
                    if isinstance(item, Frame):
                        self._check_picture(item)
                    elif len(item):
                        self._check(item, status)
                    self._check_status(link, status)
                if self._watching:
                    self._check_freshness()
                    if time.monotonic() - looked > 1.0:
                        looked = time.monotonic()
                        self._check_disk()
            except Exception as error:  # an interlock that cannot look must not let the run go on
                self.fire(Trip("interlock", f"the interlock failed: {error!r}"))
                self._watching = False

    def _check(self, block: Block, status: Status | None) -> None:
        targets = self._commanded(block.time, status) if self._commanded is not None else {}
        for check in self._checks:
            if trip := check.look(block, targets):
                self.fire(trip)
                return

    def _check_picture(self, frame: Frame) -> None:
        if self.rules.plausible and (trip := self._pictures.look(frame)):
            self.fire(trip)

    def _check_status(self, link: str, status: Status | None) -> None:
        if status is not None and (status.state == "fault" or status.fault):
            self.fire(Trip("device", f"{link} reports {status.fault or 'a fault'}", status.time))

    def _check_freshness(self) -> None:
        if trip := self._freshness.fault(time.monotonic()):
            self.fire(trip)

    def _check_disk(self) -> None:
        if self._folder is not None and (fault := self.short_of_space(self._folder)):
            self.fire(Trip("disk", fault))

    def short_of_space(self, folder: Path) -> str:
        """The fault of the free space at an existing ``folder``; '' when there is enough."""
        free = shutil.disk_usage(folder).free
        enough = free >= self.rules.disk
        return "" if enough else f"{free / 1e6:.0f} MB free at {folder}, {self.rules.disk / 1e6:.0f} MB needed"
