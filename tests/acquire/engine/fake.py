"""A device in memory, for the engine's own logic: it executes segments on a scaled clock and can be made to misbehave.

The byte-level simulated instruments have their own tests; this one has no link, no bytes and no physics.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping, Sequence

import numpy as np

from drivers.device import Device, Identity, LinkLost, Refused, Status
from drivers.signals import Block, Channel, Frame
from protocols.setpoints import Segment


class FakeDevice(Device):
    """One channel ``pressure`` that follows its set-point at once, sampled at ``rate`` Hz of device time."""

    def __init__(self, speed: float = 20.0, rate: float = 100.0, capacity: int = 4, watchdog: float = 1e9) -> None:
        self.name = "fake"
        self.speed, self.rate, self.capacity, self.watchdog = speed, rate, capacity, watchdog
        self.calls: list[str] = []
        self.threads: set[int] = set()
        self.state, self.value, self.time = "idle", 0.0, 0.0
        self.queue: list[Segment] = []
        self.executed, self.began, self.fault = 0, float("nan"), ""
        self.unplugged = self.silent = self.gap = self.open = False
        self.raise_on: dict[str, Exception] = {}
        self.override: float | None = None
        self._seq, self._wall, self._beaten = 0, time.monotonic(), time.monotonic()

    @property
    def vented(self) -> bool:
        return self.value == 0.0 and self.state in ("safe", "idle", "armed", "held") and not self.queue

    channels = (Channel("pressure", "Pa", "sensor"),)
    quantities = ("pressure",)

    @property
    def status(self) -> Status:
        return Status(self.time, self.state, self.executed, len(self.queue), self.fault, self.began)

    @property
    def queue_capacity(self) -> int:
        return self.capacity

    def _call(self, name: str) -> None:
        self.threads.add(threading.get_ident())
        self.calls.append(name)
        if self.unplugged:
            raise LinkLost("fake: unplugged")
        if name in self.raise_on:
            raise self.raise_on[name]

    def connect(self) -> Identity:
        self._call("connect")
        self.open = True
        return Identity("fake", "0", "1")

    def start_stream(self) -> None:
        self._call("start_stream")
        self._wall = time.monotonic()

    def arm(self, limits: Mapping[str, tuple[float, float]]) -> None:
        self._call("arm")
        self.state, self.limits = "armed", dict(limits)
        self._beaten = time.monotonic()

    def enqueue(self, segments: Sequence[Segment]) -> None:
        self._call("enqueue")
        if self.state not in ("armed", "running", "held"):
            raise Refused(f"fake: cannot enqueue while {self.state}")
        if len(self.queue) + len(segments) > self.capacity:
            raise Refused("fake: queue full")
        self.queue += segments

    def start(self) -> None:
        self._call("start")
        if self.state not in ("armed", "held"):
            raise Refused(f"fake: cannot start while {self.state}")
        self.state, self.executed, self.began = "running", 0, self.time

    def hold(self) -> None:
        self._call("hold")
        self.queue, self.value, self.state, self.began = [], 0.0, "held", self.time

    def skip(self) -> None:
        self._call("skip")
        if self.queue:
            self.queue.pop(0)
            self.executed, self.began = self.executed + 1, self.time

    def beat(self) -> None:
        self._call("beat")
        self._beaten = time.monotonic()

    def make_safe(self) -> None:
        if not self.open:
            return
        self.queue, self.value, self.state = [], 0.0, "safe"
        self._call("make_safe")

    def close(self) -> None:
        self.calls.append("close")
        self.open = False

    def read(self, timeout: float) -> Sequence[Block | Frame]:
        self.threads.add(threading.get_ident())
        if self.unplugged:
            self.queue, self.value, self.state = [], 0.0, "safe"  # what a device's own watchdog does
            raise LinkLost("fake: unplugged")
        if "read" in self.raise_on:
            raise self.raise_on["read"]
        time.sleep(min(timeout, 0.002))
        if time.monotonic() - self._beaten > self.watchdog and self.state in ("armed", "running", "held"):
            self.queue, self.value, self.state, self.fault = [], 0.0, "safe", "watchdog"
        if self.silent:
            return []
        now = time.monotonic()
        n = int((now - self._wall) * self.speed * self.rate)
        if n == 0:
            return []
        self._wall = now
        times = self.time + np.arange(1, n + 1) / self.rate
        values = np.array([self._advance(t) for t in times])
        if self.override is not None and self.state == "running":
            values[:] = self.override
        seq = np.arange(self._seq, self._seq + n) + (100 if self.gap else 0)
        self._seq = int(seq[-1]) + 1
        self.gap = False
        return [Block({"pressure": values}, seq, times, np.full(n, now))]

    def _advance(self, moment: float) -> float:
        self.time = moment
        while self.state == "running" and self.queue:
            segment = self.queue[0]
            if moment < self.began + segment.duration:
                part = (moment - self.began) / segment.duration
                a, b = segment.start["pressure"], segment.end["pressure"]
                self.value = a + part * (b - a)
                break
            self.queue.pop(0)
            self.executed, self.began, self.value = (
                self.executed + 1,
                self.began + segment.duration,
                segment.end["pressure"],
            )
        return self.value
