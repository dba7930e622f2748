"""An engine on a device in memory, and a plan for it."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from acquire.engine import Rules, RunEngine, RunPlan
from acquire.recording import RunInfo
from drivers.device import Rig
from protocols.limits import Limits
from protocols.setpoints import Setpoints
from tests.acquire.engine.fake import FakeDevice
from tests.acquire.engine.helpers import LIMITS, SHORT, Heart


@pytest.fixture
def device() -> FakeDevice:
    return FakeDevice()


@pytest.fixture
def engine(device: FakeDevice) -> Iterator[RunEngine]:
    before = set(threading.enumerate())
    engine = RunEngine(Rig("fake", device), rules=Rules(stale=2.0), heartbeat=Heart())
    yield engine
    engine.close()
    assert device.vented
    left = [t for t in set(threading.enumerate()) - before if t.is_alive()]
    assert not left, f"threads left behind: {left}"


@pytest.fixture
def plan(tmp_path: Path) -> Callable[..., RunPlan]:
    def make(setpoints: Setpoints = SHORT, limits: Limits = LIMITS, name: str = "run") -> RunPlan:
        info = RunInfo(id=name, instrument="fake", start_time="2024-01-01T00:00:00+00:00")
        return RunPlan(setpoints, limits, info, tmp_path / f"{name}.h5")

    return make
