"""Shared by the engine's tests: limits, protocols, a supervisor that needs no process, waiting."""

from __future__ import annotations

import time
from collections.abc import Callable

from acquire.engine import RunEngine, RunPlan, State
from protocols.limits import Limits, Range
from protocols.setpoints import Segment, Setpoints, Until
from tests.acquire.engine.fake import FakeDevice

LIMITS = Limits({"pressure": Range(-50_000.0, 0.0)}, "test")


class Heart:
    """A supervisor that permits a beat at every tick."""

    def __init__(self) -> None:
        self.ticks, self.alive = 0, True

    def permissions(self) -> int:
        return self.ticks

    def tick(self, name: str = "engine") -> None:
        self.ticks += 1


def ramp(duration: float, a: float, b: float, until: Until | None = None) -> Segment:
    return Segment(duration, {"pressure": a}, {"pressure": b}, until=until)


SHORT = Setpoints((ramp(1, 0, -30e3), ramp(2, -30e3, -30e3), ramp(1, -30e3, 0), ramp(1, 0, 0)))
LONG = Setpoints((ramp(1, 0, -30e3), ramp(10_000, -30e3, -30e3)))


def eventually(condition: Callable[[], bool], timeout: float = 5.0) -> None:
    """Wait until ``condition`` holds."""
    deadline = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < deadline, "it did not happen"
        time.sleep(0.002)


def running(engine: RunEngine, plan: RunPlan) -> None:
    """Bring the engine into a run that sucks."""
    engine.connect()
    engine.arm(plan)
    engine.start()
    device = engine.rig.device
    assert isinstance(device, FakeDevice)
    eventually(lambda: device.value <= -30e3)
    assert engine.state is State.RUNNING
