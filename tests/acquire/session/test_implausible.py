"""A sensor that fails in a run, wrong on the wire only: the host notices, and the instrument is vented."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from acquire.engine import RunEngine, State
from acquire.recording import open_recording
from acquire.session import Session
from acquire.station import load_station
from sim_devices.servers import BackDoor
from tests.acquire.session.test_safety import ACTING, eventually
from tests.acquire.session.test_stale_and_dwell import station

GAUGE = [
    ("pressure", "nan", 0.0, {"nan"}),
    ("pressure", "inf", 0.0, {"nan", "value"}),
    ("pressure", "frozen", 0.0, {"frozen"}),
    ("pressure", "stuck", 0.0, {"jump"}),
    ("pressure", "scale", 1.5, {"jump"}),
    ("pressure", "offset", -8e3, {"jump"}),
    ("pressure", "drift", 8e3, {"tracking", "value"}),
    ("pressure", "sign", 0.0, {"jump", "value"}),
]
ROBOT = [
    ("axis_position_1", "nan", 0.0, {"nan"}),
    ("axis_position_1", "inf", 0.0, {"nan"}),
    ("axis_position_1", "frozen", 0.0, {"frozen", "tracking"}),
    ("axis_position_2", "offset", 2e-3, {"jump", "value", "tracking"}),
    ("axis_position_3", "drift", 4e-3, {"tracking", "value", "nan"}),
    ("voltage_a", "frozen", 0.0, {"frozen"}),
]
CASES = [
    (kind, *case)
    for kind, cases in (("cutometer", GAUGE), ("aspiration", GAUGE), ("microrobot", ROBOT))
    for case in cases
]


@pytest.fixture
def session(tmp_path: Path) -> Iterator[Session]:
    with Session(station(), speed=5.0, out=tmp_path, frame_size=(160, 120)) as session:
        yield session


def settled(session: Session, kind: str) -> tuple[RunEngine, BackDoor]:
    """In a run, and the set-point has been reached for a while."""
    name, acts = ACTING[kind]
    engine, plan = session.prepare(name)
    engine.arm(plan)
    engine.start()
    door = session.back_door(kind)
    eventually(lambda: acts(door))
    if kind != "microrobot":  # which never rests in its demo
        began = door.truth().time
        eventually(lambda: door.truth().time > began + 4.0)
    return engine, door


@pytest.mark.parametrize(("kind", "channel", "how", "amount", "codes"), CASES)
def test_a_sensor_that_fails_is_noticed(
    session: Session, kind: str, channel: str, how: str, amount: float, codes: set[str]
) -> None:
    engine, door = settled(session, kind)
    door.distort(channel, how, amount)
    eventually(lambda: engine.state is State.TRIPPED, 10.0)
    door.wait_vented()
    outcome = engine.wait(10)
    assert outcome.trip is not None
    assert outcome.trip.code in codes, outcome.trip
    assert outcome.recording is not None


@pytest.mark.parametrize("kind", list(ACTING))
def test_one_spike_is_recorded_and_trips_nothing(session: Session, kind: str) -> None:
    engine, door = settled(session, kind)
    channel, size = ("axis_position_1", 4e-4) if kind == "microrobot" else ("pressure", -60e3)
    door.distort(channel, "spike", size, samples=1)
    began = door.truth().time
    eventually(lambda: door.truth().time > began + 2.0)
    assert engine.state is State.RUNNING
    engine.abort()
    recording = engine.wait(10).recording
    assert recording is not None
    values = open_recording(recording).streams[channel].value
    assert abs(values).max() > (4e-4 if kind == "microrobot" else 70e3)


@pytest.mark.parametrize("kind", ["cutometer", "aspiration"])
def test_a_second_gauge_doubts_the_first(tmp_path: Path, kind: str) -> None:
    both = load_station(
        f"schema: station/1\ninstruments:\n  {kind}: {{simulated: {{seed: 1}}, watchdog: 1 s, options: "
        "{pressure_reference: true}, interlock: {stale: 1 s}}\n"
    )
    with Session(both, speed=5.0, out=tmp_path, frame_size=(160, 120)) as session:
        engine, door = settled(session, kind)
        assert engine.state is State.RUNNING
        door.distort("pressure", "offset", 4e3)  # 40 mbar: too little for one gauge alone
        eventually(lambda: engine.state is State.TRIPPED, 10.0)
        door.wait_vented()
        outcome = engine.wait(10)
    assert outcome.trip is not None
    assert outcome.trip.code == "reference"
    assert outcome.recording is not None
    streams = open_recording(outcome.recording).streams
    assert {"pressure", "pressure_reference"} <= set(streams)
    assert streams["pressure_reference"].unit == "Pa"
