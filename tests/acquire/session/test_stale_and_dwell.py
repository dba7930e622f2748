"""A device that says the same for ever, or sucks for too long, is vented: asserted at the device."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from acquire.engine import State
from acquire.recording import open_recording
from acquire.session import Session
from acquire.station import Station, load_station
from protocols import ProtocolError, load
from tests.acquire.session.test_safety import ACTING, eventually

STALE = 0.5
STATION = """\
schema: station/1
instruments:
  cutometer: &
  aspiration: &
  microrobot: &
""".replace("&", f"{{simulated: {{seed: 1}}, watchdog: 1 s, interlock: {{stale: {STALE} s}}}}")


def station(limits: str = "") -> Station:
    return load_station(STATION.replace("watchdog:", f"limits: {limits}, watchdog:") if limits else STATION)


@pytest.fixture
def session(tmp_path: Path) -> Iterator[Session]:
    with Session(station(), speed=5.0, out=tmp_path, frame_size=(160, 120)) as session:
        yield session


@pytest.mark.parametrize("what", ["packet", "time", "sequence"])
@pytest.mark.parametrize("kind", list(ACTING))
def test_a_device_that_repeats_itself_is_vented(session: Session, kind: str, what: str) -> None:
    name, acts = ACTING[kind]
    engine, plan = session.prepare(name)
    engine.arm(plan)
    engine.start()
    door = session.back_door(kind)
    eventually(lambda: acts(door))
    began = time.monotonic()
    door.stale(what)
    truth = door.wait_vented()
    assert time.monotonic() - began < STALE + 1.0  # the firmware went on hearing beats: it was the host that noticed
    assert truth.state == "safe"
    outcome = engine.wait(10)
    assert outcome.trip is not None
    assert outcome.trip.code == "stale"
    assert "no new sample" in outcome.trip.message
    assert outcome.recording is not None
    assert open_recording(outcome.recording).info.status == "tripped"


@pytest.mark.parametrize("kind", list(ACTING))
def test_a_device_that_loses_its_queue_is_vented(session: Session, kind: str) -> None:
    name, acts = ACTING[kind]
    engine, plan = session.prepare(name)
    engine.arm(plan)
    engine.start()
    door = session.back_door(kind)
    eventually(lambda: acts(door))
    door.starve()
    eventually(lambda: engine.state is State.TRIPPED, 30.0)
    door.wait_vented()
    assert engine.wait(10).trip is not None


SUCTION = (
    "schema: protocol/1\nname: long\ninstrument: cutometer\nsteps:\n- {type: hold, suction: 200 mbar, duration: 30 s}\n"
)
ROBOT = (
    "schema: protocol/1\nname: long\ninstrument: microrobot\nsteps:\n"
    "- {type: hold, position: {x: 1 mm}, speed: 10 mm/s, duration: 30 s}\n"
)


@pytest.mark.parametrize(
    ("kind", "text", "limits"),
    [
        ("cutometer", SUCTION, "{pressure: {dwell: 20 s}}"),
        ("aspiration", SUCTION.replace("cutometer", "aspiration"), "{pressure: {dwell: 20 s}}"),
        ("microrobot", ROBOT, "{probe: {dwell: 20 s}}"),
    ],
)
def test_time_away_from_rest_is_limited_when_compiling(kind: str, text: str, limits: str) -> None:
    protocol = load(text)
    with Session(station()) as free:
        free.compile(kind, protocol)  # hardware alone allows it
    with Session(station(limits)) as bounded, pytest.raises(ProtocolError) as caught:
        bounded.compile(kind, protocol)
    (problem,) = caught.value.problems
    assert problem.line == 5
    assert "longer than the 20 s allowed (hardware ∩ station" in problem.message


def test_the_host_and_the_device_limit_it_while_running(tmp_path: Path) -> None:
    """A plan that nobody compiled: the host's own check, and the limit that the device was armed with."""
    import dataclasses

    from protocols.limits import Limits, Range

    with Session(station(), speed=5.0, out=tmp_path) as session:
        engine, plan = session.prepare(load(SUCTION))
        engine.arm(plan)
        device = session.back_door("cutometer").truth()
        assert device.limits["pressure"] == (-50e3, 0.0)
        engine.abort()
        engine.wait(10)
        tight = plan.limits.intersect(Limits({"pressure": Range(dwell=20.0)}))
        with pytest.raises(ValueError, match="away from rest"):
            engine.arm(dataclasses.replace(plan, limits=tight, path=tmp_path / "tight.h5"))
