"""A stop in every phase: void requests say why, what had begun ends with an outcome, the device ends vented."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from acquire.engine import Aborted, RunEngine, RunPlan, State, Tripped, host_clock
from acquire.recording import open_recording
from acquire.session import Session
from drivers.device import Faulted
from tests.acquire.engine.fake import FakeDevice
from tests.acquire.engine.helpers import LONG, eventually, running

Plan = Callable[..., RunPlan]
PHASES = ["connecting", "arming", "armed", "running", "pausing", "paused"]


@pytest.fixture
def session(engine: RunEngine, tmp_path: Path) -> Session:
    session = Session(out=tmp_path)
    session._benches["fake"] = type("Bench", (), {"engine": engine})()  # type: ignore[assignment]
    return session


def stopped_in(
    phase: str, session: Session, engine: RunEngine, device: FakeDevice, plan: RunPlan, stop: Callable[[], object]
) -> object:
    """The outcome, or the exception, of a whole run that is stopped in ``phase``."""
    call = {"connecting": "connect", "arming": "arm", "armed": "arm", "running": "start", "pausing": "hold"}
    inside, go_on = threading.Event(), threading.Event()
    result: list[object] = []
    original = getattr(device, call.get(phase, "hold"))

    def slow(*args: object) -> object:
        answer = original(*args)
        inside.set()
        if phase in ("connecting", "arming", "pausing"):
            go_on.wait(5)
        return answer

    setattr(device, call.get(phase, "hold"), slow)

    def work() -> None:
        try:
            engine.connect()
            result.append(session.carry_out(engine, plan))
        except Exception as error:
            result.append(error)

    pause: list[BaseException] = []

    def hold() -> None:
        try:
            engine.pause()
        except Exception as error:
            pause.append(error)

    thread, pauser = threading.Thread(target=work), threading.Thread(target=hold)
    thread.start()
    if phase in ("pausing", "paused"):
        eventually(lambda: device.value <= -30e3)
        pauser.start()
        if phase == "paused":
            pauser.join()
    assert inside.wait(5)
    stop()
    go_on.set()
    thread.join(10)
    if pauser.ident:
        pauser.join(5)
    assert not thread.is_alive()
    eventually(lambda: device.vented)
    return result[0]


@pytest.mark.parametrize("phase", PHASES)
def test_an_abort(phase: str, session: Session, engine: RunEngine, device: FakeDevice, plan: Plan) -> None:
    result = stopped_in(phase, session, engine, device, plan(LONG), lambda: session.abort("enough"))
    if phase == "connecting":
        assert isinstance(result, Aborted)
        assert str(result) == "enough"
        eventually(lambda: engine.state in (State.IDLE, State.READY))
        return
    assert (result.status, result.reason) == (State.ABORTED, "enough")  # type: ignore[attr-defined]
    assert open_recording(result.recording).info.status == "aborted"  # type: ignore[attr-defined]


@pytest.mark.parametrize("phase", PHASES)
def test_a_trip(phase: str, session: Session, engine: RunEngine, device: FakeDevice, plan: Plan) -> None:
    result = stopped_in(phase, session, engine, device, plan(LONG), lambda: session.stop("red button"))
    if phase == "connecting":
        assert isinstance(result, Tripped)
        assert "red button" in str(result)
    else:
        assert (result.status, result.reason) == (State.TRIPPED, "estop: red button")  # type: ignore[attr-defined]
        assert open_recording(result.recording).info.status == "tripped"  # type: ignore[attr-defined]
    eventually(lambda: engine.state is State.TRIPPED)


def test_an_abort_between_two_phases_is_not_forgotten(
    session: Session, engine: RunEngine, device: FakeDevice, plan: Plan
) -> None:
    engine.connect()
    session.abort("enough")  # ready: no run that could end
    with pytest.raises(Aborted, match="enough"):
        session.carry_out(engine, plan(LONG))
    assert "arm" not in device.calls
    running(engine_again(engine), plan(LONG))  # and it is forgotten afterwards


def engine_again(engine: RunEngine) -> RunEngine:
    engine.disconnect()
    return engine


@pytest.mark.parametrize("fault", ["no heartbeat for 0.25 s", "the queue is empty for 0.25 s, away from rest"])
def test_what_a_crashed_host_left_is_made_safe_and_told(engine: RunEngine, device: FakeDevice, fault: str) -> None:
    device.state, device.fault = "fault", fault
    engine.connect()
    assert (device.state, engine.state) == ("safe", State.READY)
    assert fault in engine.found


def test_a_fault_of_the_device_s_own_needs_a_person(engine: RunEngine, device: FakeDevice) -> None:
    device.state, device.fault = "fault", "pressure -60000 is outside"
    for _ in range(2):  # trying again is no acknowledgement
        with pytest.raises(Faulted, match="pressure -60000 is outside"):
            engine.connect()
        assert device.state == "fault"
        engine.reset()
    engine.connect(acknowledged=True)
    assert device.state == "safe"


def test_a_computer_that_was_suspended_trips(
    engine: RunEngine, device: FakeDevice, plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    running(engine, plan(LONG))
    awake = host_clock.boot_time
    monkeypatch.setattr(host_clock, "boot_time", lambda: awake() + 30.0)
    outcome = engine.wait(10)
    assert outcome.trip is not None
    assert (outcome.trip.code, outcome.trip.message) == ("host", "the computer was suspended for 30.0 s")
    assert device.vented


def test_a_wall_clock_that_is_set_changes_nothing(
    engine: RunEngine, plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    running(engine, plan(LONG))
    now = time.time
    monkeypatch.setattr(time, "time", lambda: now() - 86400.0)
    time.sleep(0.3)
    assert engine.state is State.RUNNING
    engine.abort()
    outcome = engine.wait(10)
    assert outcome.recording is not None
    info = open_recording(outcome.recording).info
    assert info.end_time > info.start_time
