"""Every simulated instrument on every link it has, with a host that keeps it alive and collects what it says."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
import pytest

from drivers.device import Device, Rig
from drivers.signals import Block, FloatArray, Frame
from protocols.limits import Range
from protocols.setpoints import Segment
from sim_devices.clock import ScaledClock
from sim_devices.servers import BackDoor, Server, serve

CASES = [
    ("cutometer", "pty"),
    ("cutometer", "tcp"),
    ("aspiration", "pty"),
    ("aspiration", "tcp"),
    ("microrobot", "usb"),
    ("microrobot", "tcp"),
    ("microrobot", "pty"),
]
SPEED = {"cutometer": 40.0, "aspiration": 40.0, "microrobot": 10.0}


@dataclass
class Host:
    """A plain host on one server: one thread, no engine."""

    server: Server
    rig: Rig
    limits: dict[str, Range]
    blocks: list[Block] = field(default_factory=list)
    long: float = 250.0  # s of suction that every instrument allows at a time, and longer than any test

    @property
    def device(self) -> Device:
        return self.rig.device

    @property
    def door(self) -> BackDoor:
        return self.server.back_door

    @property
    def full(self) -> float:
        """A strong but allowed value of the first quantity."""
        limit = self.limits[self.device.quantities[0]]
        return 0.6 * max((limit.low, limit.high), key=abs)

    def point(self, value: float) -> dict[str, float]:
        """Set-point with ``value`` for the first quantity and zero for the others."""
        return {q: value if k == 0 else 0.0 for k, q in enumerate(self.device.quantities)}

    def segment(self, duration: float, start: float, end: float) -> Segment:
        return Segment(duration, self.point(start), self.point(end))

    def connect(self) -> None:
        self.device.connect()
        self.device.start_stream()

    def arm(self) -> None:
        self.listen(lambda: bool(self.blocks))
        self.device.arm(self.limits)

    def suck(self) -> None:
        """Armed, and at full value for a long time."""
        self.connect()
        self.arm()
        self.device.enqueue([self.segment(0.5, 0.0, self.full), self.segment(self.long, self.full, self.full)])
        self.device.start()
        self.listen(lambda: self.device.status.executed == 1)
        assert not self.door.truth().vented

    def listen(self, until: Callable[[], bool], *, beat: bool = True, timeout: float = 8.0) -> None:
        """Read, and beat, until a condition holds."""
        deadline = time.monotonic() + timeout
        while not until():
            assert time.monotonic() < deadline, f"timed out; {self.device.status}; {self.door.truth()}"
            if beat:
                self.device.beat()
            self.blocks += [b for b in self.device.read(0.01) if isinstance(b, Block)]

    def samples(self, count: int) -> None:
        """Collect that many samples from now."""
        goal = sum(map(len, self.blocks)) + count
        self.listen(lambda: sum(map(len, self.blocks)) >= goal)

    @property
    def seq(self) -> FloatArray:
        return np.concatenate([b.seq for b in self.blocks])

    @property
    def time(self) -> FloatArray:
        return np.concatenate([b.time for b in self.blocks])

    def values(self, channel: str) -> FloatArray:
        return np.concatenate([b.values[channel] for b in self.blocks])


@pytest.fixture(autouse=True)
def no_leaks() -> Iterator[None]:
    """No thread outlives its test."""
    before = set(threading.enumerate())
    yield
    assert set(threading.enumerate()) <= before


@pytest.fixture(params=CASES, ids=["-".join(case) for case in CASES])
def host(request: pytest.FixtureRequest) -> Iterator[Host]:
    instrument, link = request.param
    clock = ScaledClock(SPEED[instrument], idle=SPEED[instrument])  # samples between runs are counted, too
    with serve(instrument, link, clock=clock, frame_size=(160, 120), watchdog=0.6) as server:
        rig = server.open_rig()
        yield Host(server, rig, dict(server.bench.instrument.limits.ranges))
        for source in (rig.device, *rig.sources):
            source.close()


def frames_of(delivered: object) -> list[Frame]:
    assert isinstance(delivered, list | tuple)
    return [item for item in delivered if isinstance(item, Frame)]
