"""Holes that an outside campaign found in revision 193e721, each by what it does to a person or a recording.

Only what that revision had too is used here, so that each test fails there by behaviour: `python -m
benchmarks.faults.holes` shows it. Holes 10 to 16 are the window's, and are tried there (docs/safety.md lists them).
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest

from acquire.cli.app import run
from acquire.engine import Rules, RunEngine, RunPlan, State
from acquire.recording import RunInfo, open_recording
from acquire.session import Session
from acquire.station import load_station, simulated_station
from drivers.device import Rig
from drivers.signals import Block, Frame
from sim_devices.servers import serve
from tests.acquire.engine.fake import FakeDevice
from tests.acquire.engine.helpers import LIMITS, LONG, Heart, eventually, running

pytestmark = pytest.mark.real_time
BRIEF = """schema: protocol/1
name: brief
instrument: cutometer
steps: [{type: hold, suction: 200 mbar, duration: 3 s}, {type: wait, duration: 1 s}]
"""


class Repeating(FakeDevice):
    """From some moment on it says its last block again and again."""

    stale = False
    last: Sequence[Block | Frame] = ()

    def read(self, timeout: float) -> Sequence[Block | Frame]:
        if self.stale and self.last:
            time.sleep(0.005)
            return self.last
        self.last = super().read(timeout) or self.last
        return self.last


class Noisy(FakeDevice):
    """Its readings have noise, until they are ``frozen``; the one at ``spike`` s is far away."""

    frozen = False
    spike = float("inf")
    random = np.random.default_rng(1)

    def read(self, timeout: float) -> Sequence[Block | Frame]:
        return [self._noisy(block) for block in super().read(timeout) if isinstance(block, Block)]

    def _noisy(self, block: Block) -> Block:
        value = block.values["pressure"] + (0.0 if self.frozen else 30.0) * self.random.standard_normal(len(block))
        if self.spike < block.time[-1]:
            value[np.searchsorted(block.time, self.spike)] = -60e3
            self.spike = float("inf")
        return Block({"pressure": value}, block.seq, block.time, block.time_host)


@pytest.fixture
def engines() -> Iterator[list[RunEngine]]:
    made: list[RunEngine] = []
    yield made
    for engine in made:
        engine.close()


def sucking(engines: list[RunEngine], device: FakeDevice, folder: Path) -> RunEngine:
    engine = RunEngine(Rig("fake", device), rules=Rules(), heartbeat=Heart())
    engines.append(engine)
    info = RunInfo(id="run", instrument="fake", start_time="2024-01-01T00:00:00+00:00")
    running(engine, RunPlan(LONG, LIMITS, info, folder / "run.h5"))
    return engine


def test_hole_01_a_link_that_says_the_same_for_ever(engines: list[RunEngine], tmp_path: Path) -> None:
    device = Repeating()
    engine = sucking(engines, device, tmp_path)
    device.stale = True
    eventually(lambda: engine.state is State.TRIPPED, 5.0)
    eventually(lambda: device.vented)


def test_hole_02_a_running_run_is_recovered(tmp_path: Path) -> None:
    protocol = tmp_path / "brief.yaml"
    protocol.write_text(BRIEF)
    with Session(simulated_station(seed=1), speed=2.0, out=tmp_path) as session:
        engine, plan = session.prepare(protocol)
        engine.arm(plan)
        engine.start()
        eventually(lambda: engine.progress.elapsed > 1.0)
        journal = plan.path.with_suffix(".journal")
        assert run(["recover", str(journal)]) != 0
        outcome = engine.wait(20)
    assert outcome.status is State.COMPLETED
    assert outcome.recording is not None
    recorded = open_recording(outcome.recording).streams["pressure"].time
    assert recorded[-1] - recorded[0] > 3.9


@pytest.mark.parametrize("words", [["--operator", "k\udce9"], ["--repeat", str(2**63)], ["--repeat", str(2**63 - 1)]])
def test_hole_03_what_cannot_be_recorded_is_run(
    words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It is refused in words, or the recording is there and says it."""
    protocol = tmp_path / "brief.yaml"
    protocol.write_text(BRIEF)
    status = run(["run", str(protocol), "--sim", "-o", str(tmp_path / "run.h5"), "--speed", "20", *words])
    said = capsys.readouterr().err
    if status == 0:
        assert open_recording(tmp_path / "run.h5").info.repeat == int(words[1])
    else:
        assert (status, words[0].strip("-") in said) == (2, True)
        assert not list(tmp_path.glob("run.*"))


def test_hole_03_a_run_whose_journal_is_gone_has_not_completed(tmp_path: Path) -> None:
    protocol = tmp_path / "brief.yaml"
    protocol.write_text(BRIEF)
    with Session(simulated_station(seed=1), out=tmp_path) as session:
        engine, plan = session.prepare(protocol)
        engine.arm(plan)
        engine.start()
        plan.path.with_suffix(".journal").unlink()
        outcome = engine.wait(20)
    kept = outcome.recording is not None and open_recording(outcome.recording).streams["pressure"].value.min() < -10e3
    assert outcome.status is not State.COMPLETED or kept


@pytest.mark.parametrize("rule", ["watchdog: 1000000 s", "interlock: {stale: 1000000 s}"])
def test_hole_04_a_station_without_a_watchdog(rule: str) -> None:
    with pytest.raises(ValueError, match=rule.rpartition("{")[2].partition(":")[0]):
        load_station(f"schema: station/1\ninstruments:\n  cutometer: {{simulated: true, {rule}}}\n")


@pytest.mark.parametrize("address", ["/dev/ttyUSB0", "COM3"])
def test_hole_05_a_real_port_that_is_called_simulated(
    address: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    station = tmp_path / "station.yaml"
    station.write_text(f"schema: station/1\ninstruments:\n  cutometer: {{address: '{address}', simulated: true}}\n")
    assert run(["run", "demo-cutometer", "--station", str(station), "-o", str(tmp_path)]) in (2, 3)
    assert "i_have_verified_the_codec" in capsys.readouterr().err


@pytest.mark.parametrize("stop", ["abort", "stop"])
def test_hole_06_a_stop_between_arm_and_start(stop: str, tmp_path: Path) -> None:
    protocol = tmp_path / "brief.yaml"
    protocol.write_text(BRIEF)

    def heard(name: str, state: State, event: str) -> None:
        if state is State.ARMED:
            getattr(session.engine(name), stop)("enough")

    with Session(simulated_station(seed=1), speed=5.0, out=tmp_path, listener=heard) as session:
        outcome = session.run(protocol)
    assert outcome.status is (State.ABORTED if stop == "abort" else State.TRIPPED)
    assert outcome.recording is not None


def test_hole_07_blocks_that_come_twice(tmp_path: Path) -> None:
    protocol = tmp_path / "brief.yaml"
    protocol.write_text(BRIEF)
    with Session(simulated_station(seed=1), speed=2.0, out=tmp_path) as session:
        engine, plan = session.prepare(protocol)
        engine.arm(plan)
        engine.start()
        eventually(lambda: engine.progress.elapsed > 0.5)
        session.back_door("cutometer").repeat(20)
        outcome = engine.wait(20)
    assert outcome.recording is not None
    pressure = open_recording(outcome.recording).streams["pressure"]
    assert pressure.seq is not None
    assert np.all(np.diff(pressure.time) > 0)
    assert np.all(np.diff(pressure.seq) == 1)
    assert outcome.lost == 0


def test_hole_08_the_next_run_after_a_crash(tmp_path: Path) -> None:
    protocol = tmp_path / "brief.yaml"
    protocol.write_text(BRIEF)
    with serve("cutometer", "tcp", speed=5.0) as server:
        entry = f"{{address: '{server.entry.address}', simulated: true, watchdog: 1 s, interlock: {{stale: 5 s}}}}"
        station = load_station(f"schema: station/1\ninstruments:\n  cutometer: {entry}\n")
        with server._sim.lock:
            server._sim.firmware.trip("no heartbeat for 0.25 s")  # what a killed host leaves behind
        with Session(station, out=tmp_path) as session:
            assert session.run(protocol).status is State.COMPLETED


def test_hole_09_a_channel_that_is_frozen_in_a_hold(engines: list[RunEngine], tmp_path: Path) -> None:
    device = Noisy()
    engine = sucking(engines, device, tmp_path)
    began = device.time
    eventually(lambda: device.time > began + 10.0)
    assert engine.state is State.RUNNING
    device.frozen = True
    eventually(lambda: engine.state is State.TRIPPED, 3.0)


def test_hole_09_a_single_spike_trips(engines: list[RunEngine], tmp_path: Path) -> None:
    device = Noisy()
    engine = sucking(engines, device, tmp_path)
    device.spike = device.time + 2.0
    eventually(lambda: device.spike == float("inf"))
    time.sleep(0.3)
    assert engine.state is State.RUNNING
