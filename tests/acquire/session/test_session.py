"""Sessions: several instruments, several runs, reference specimens, a person's stop."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from acquire.engine import RunEngine, State
from acquire.recording import open_recording
from acquire.session import Request, Session
from acquire.simulation import Mounted, chain
from acquire.station import Simulation, load_station, simulated_station

BRIEF = """\
schema: protocol/1
name: brief
instrument: cutometer
steps:
  - {type: hold, suction: 200 mbar, duration: 1 s}
  - {type: wait, duration: 1 s}
"""
MakeSession = Callable[..., Session]


@pytest.fixture
def brief(tmp_path: Path) -> Path:
    path = tmp_path / "brief.yaml"
    path.write_text(BRIEF)
    return path


def test_the_fixture_of_a_lab(skinrig_session: MakeSession, brief: Path) -> None:
    session = skinrig_session(speed=50.0, tissue="cheek")
    first, second = session.run(brief), session.run(brief, Request(repeat=2))
    assert first.status is second.status is State.COMPLETED
    assert first.recording != second.recording
    assert second.recording is not None
    assert open_recording(second.recording).info.repeat == 2


def test_the_fixture_of_a_bare_instrument(skinrig_instrument: Callable[..., object]) -> None:
    server = skinrig_instrument("cutometer", "tcp", speed=20.0)
    rig = server.open_rig()  # type: ignore[attr-defined]
    assert rig.device.connect().model
    rig.device.close()


def test_three_instruments_run_at_once(tmp_path: Path) -> None:
    names = {"cutometer": "demo-cutometer", "aspiration": "demo-aspiration", "microrobot": "demo-microrobot"}
    with Session(simulated_station(seed=0), speed=20, out=tmp_path, frame_size=(160, 120)) as session:
        engines: dict[str, RunEngine] = {}
        for kind, protocol in names.items():
            engine, plan = session.prepare(protocol)
            engine.arm(plan)
            engines[kind] = engine
        for engine in engines.values():
            engine.start()
        for kind, engine in engines.items():
            outcome = engine.wait(60)
            assert (kind, outcome.status, outcome.lost) == (kind, State.COMPLETED, 0)
            assert outcome.recording is not None
            assert open_recording(outcome.recording).info.instrument == kind


def test_the_emergency_stop_stops_all(tmp_path: Path) -> None:
    with Session(simulated_station(seed=0), speed=5, out=tmp_path, frame_size=(160, 120)) as session:
        running = []
        for protocol in ("demo-cutometer", "demo-microrobot"):
            engine, plan = session.prepare(protocol)
            engine.arm(plan)
            engine.start()
            running.append(engine)
        time.sleep(0.3)
        session.stop("red button")
        for engine in running:
            assert engine.wait(10).reason == "estop: red button"
        for kind in ("cutometer", "microrobot"):
            session.back_door(kind).wait_vented()


def test_reference_specimens(tmp_path: Path, brief: Path) -> None:
    with Session(simulated_station(seed=0), speed=50, out=tmp_path) as session:
        rigid = session.run(brief, Request(specimen="rigid block"))
        skin = session.run(brief)
        assert rigid.recording is not None
        assert skin.recording is not None
        heights = [open_recording(r).streams["apex_height"].value.max() for r in (rigid.recording, skin.recording)]
        assert heights[0] < 2e-5 < 1e-4 < heights[1]
        assert open_recording(rigid.recording).info.specimen == "rigid block"
        with pytest.raises(ValueError, match="open air"):
            session.run(brief, Request(specimen="open air"))
        air = session.run("demo-microrobot", Request(specimen="open air"))
        assert air.recording is not None
        assert np.abs(open_recording(air.recording).streams["force_x"].value).max() < 0.1


def test_another_opening_is_another_probe(tmp_path: Path, brief: Path) -> None:
    wide = tmp_path / "wide.yaml"
    wide.write_text(BRIEF.replace("steps:", "setup: {opening: 6 mm}\nsteps:"))
    with Session(simulated_station(seed=0), speed=50, out=tmp_path) as session:
        paths = [session.run(p).recording for p in (brief, wide)]
        narrow, broad = (open_recording(p).streams["apex_height"].value.max() for p in paths if p is not None)
        assert broad > 2 * narrow


def test_an_effect_shows_in_the_recording(tmp_path: Path, brief: Path) -> None:
    def rise(*effects: str) -> float:
        with Session(simulated_station(effects=effects, seed=0), speed=50, out=tmp_path) as session:
            outcome = session.run(brief)
        assert outcome.recording is not None
        pressure = open_recording(outcome.recording).streams["pressure"]
        commanded = open_recording(outcome.recording).setpoints["pressure"]
        step = commanded.time[np.argmax(commanded.value < -1)]
        return float(pressure.time[np.argmax(pressure.value < -10e3)] - step)

    assert rise("regulator_lag:tau=0.3s") > rise() + 0.1


def test_the_same_seed_gives_the_same_skin(tmp_path: Path, brief: Path) -> None:
    def height(seed: int) -> float:
        with Session(simulated_station(seed=seed), speed=50, out=tmp_path) as session:
            outcome = session.run(brief)
        assert outcome.recording is not None
        return float(np.median(np.sort(open_recording(outcome.recording).streams["apex_height"].value)[-60:]))

    assert height(3) == pytest.approx(height(3), abs=1.1e-5)


def test_noise_does_not_come_again_with_another_specimen() -> None:
    """It was the same in the recordings of all references, so that a sound instrument had a line in its noise."""
    seen = set()
    for specimen, times in (("skin", 0), ("open air", 0), ("open air", 1), ("rigid post", 1), ("skin", 2)):
        mounted = Mounted(specimen=specimen, times=times)
        made = chain("microrobot", Simulation(seed=3), mounted)
        seen |= {op.seed for op in made.operators if getattr(op, "sigma", 0.0)}
    assert len(seen) == 5 * 2  # of transducers and axes
    again = [chain("microrobot", Simulation(seed=3), Mounted(specimen="open air")) for _ in range(2)]
    assert again[0].operators == again[1].operators
    with Session(simulated_station(seed=3)) as session:
        names = [session._bench("cutometer", Mounted(specimen=s)).set_up.times for s in ("rigid block", "skin")]
    assert names == [0, 1]


def test_listeners_hear_of_every_change(tmp_path: Path, brief: Path) -> None:
    heard: list[tuple[str, State, str]] = []
    station = simulated_station(seed=0)
    with Session(station, speed=50, out=tmp_path, listener=lambda *change: heard.append(change)) as session:
        session.run(brief)
    assert [state for _, state, _ in heard] == ["connecting", "ready", "armed", "running", "completed"]


def test_a_session_says_what_it_cannot_do(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="speed must be positive"):
        Session(speed=0)
    address = "schema: station/1\ninstruments:\n  cutometer: {address: 'socket://127.0.0.1:9', simulated: true}\n"
    with Session(load_station(address), out=tmp_path) as session:
        session._bench("cutometer")
        with pytest.raises(ValueError, match="not simulated here"):
            session.back_door("cutometer")


@pytest.mark.parametrize("kind", ["cutometer", "aspiration", "microrobot"])
def test_a_cable_that_is_put_back_between_runs_needs_nobody(tmp_path: Path, kind: str) -> None:
    with Session(simulated_station(seed=1), speed=10, out=tmp_path, frame_size=(160, 120)) as session:
        engine, door = session.open(kind), session.back_door(kind)
        door.unplug()
        until(lambda: engine.away != "")
        door.plug()
        until(lambda: engine.state is State.READY)
        assert engine.trip is None


def until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 20
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)
