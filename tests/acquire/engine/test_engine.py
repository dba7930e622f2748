"""The run engine on a device in memory: every way through a run and every way out of it."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable

import numpy as np
import pytest

from acquire.engine import RunEngine, RunPlan, State, WrongState, interlock
from acquire.recording import open_recording
from drivers.device import LinkLost, Refused
from protocols.limits import Limits, Range
from protocols.setpoints import Segment, Setpoints, Until
from tests.acquire.engine.fake import FakeDevice
from tests.acquire.engine.helpers import LIMITS, LONG, SHORT, Heart, eventually, ramp, running

Plan = Callable[..., RunPlan]


def test_a_run_from_connect_to_recording(engine: RunEngine, device: FakeDevice, plan: Plan) -> None:
    engine.connect()
    assert engine.state is State.READY
    engine.arm(plan())
    engine.start()
    outcome = engine.wait(10)
    assert (outcome.status, outcome.lost) == (State.COMPLETED, 0)
    assert device.vented
    assert outcome.recording is not None
    recording = open_recording(outcome.recording)
    assert recording.info.status == "completed"
    pressure, commanded = recording.streams["pressure"], recording.setpoints["pressure"]
    due = np.interp(pressure.time, commanded.time, commanded.value)
    assert np.abs(pressure.value - due).max() <= 30e3 * 0.011 + 1  # the fake follows at once, to one sample
    assert np.all(np.diff(pressure.seq) == 1)
    assert commanded.value.min() == -30e3
    assert not outcome.recording.with_suffix(".journal").exists()


def test_one_thread_alone_talks_to_the_device(engine: RunEngine, device: FakeDevice, plan: Plan) -> None:
    running(engine, plan(LONG))
    engine.pause()
    engine.resume()
    engine.abort()
    engine.wait(5)
    assert len(device.threads) == 1


def test_the_device_gets_beats_while_it_is_live_only(engine: RunEngine, device: FakeDevice, plan: Plan) -> None:
    engine.connect()
    time.sleep(0.1)
    assert "beat" not in device.calls
    engine.arm(plan(LONG))
    eventually(lambda: device.calls.count("beat") > 2)
    engine.abort()
    engine.wait(5)
    beats = device.calls.count("beat")
    time.sleep(0.1)
    assert device.calls.count("beat") == beats


def test_the_queue_is_fed_and_never_overfed(engine: RunEngine, device: FakeDevice, plan: Plan) -> None:
    many = Setpoints(tuple(ramp(0.3, 0, 0) for _ in range(50)))
    engine.connect()
    engine.arm(plan(many))
    engine.start()
    assert engine.wait(10).status is State.COMPLETED
    assert device.calls.count("enqueue") > 5


def test_the_trip_of_a_closed_link_names_its_source(engine: RunEngine, device: FakeDevice, plan: Plan) -> None:
    running(engine, plan(LONG))
    device.raise_on["beat"] = LinkLost("link socket://127.0.0.1:4000: the other end closed it")
    outcome = engine.wait(5)
    assert outcome.status is State.TRIPPED
    assert outcome.reason == "link: fake: link socket://127.0.0.1:4000: the other end closed it"


def test_a_device_that_refuses_more_of_a_run_trips_it(engine: RunEngine, device: FakeDevice, plan: Plan) -> None:
    running(engine, plan(Setpoints(tuple(ramp(0.3, -30e3, -30e3) for _ in range(500)))))
    device.raise_on["enqueue"] = Refused("fake refused enqueue: not armed (fault)")
    outcome = engine.wait(5)
    assert outcome.status is State.TRIPPED
    assert "refused enqueue" in outcome.reason
    assert device.vented


def test_abort_vents_at_once_and_keeps_the_recording(engine: RunEngine, device: FakeDevice, plan: Plan) -> None:
    running(engine, plan(LONG))
    engine.abort("enough")
    eventually(lambda: device.vented)
    outcome = engine.wait(5)
    assert (engine.state, outcome.reason) == (State.ABORTED, "enough")
    assert outcome.recording is not None
    recording = open_recording(outcome.recording)
    assert recording.info.status == "aborted"
    assert any(e.code == "aborted" and e.text == "enough" for e in recording.events)
    assert recording.setpoints["pressure"].value[-1] == 0.0


def test_a_run_can_follow_a_run(engine: RunEngine, plan: Plan) -> None:
    engine.connect()
    for name in ("a", "b"):
        engine.arm(plan(SHORT, name=name))
        engine.start()
        assert engine.wait(10).status is State.COMPLETED
    running_again = plan(LONG, name="c")
    engine.arm(running_again)
    engine.abort()
    assert engine.wait(5).status is State.ABORTED


def test_pause_vents_and_resume_repeats_the_segment(engine: RunEngine, device: FakeDevice, plan: Plan) -> None:
    engine.connect()
    engine.arm(plan(Setpoints((ramp(1, 0, -30e3), ramp(8, -30e3, -30e3), ramp(1, -30e3, 0)))))
    engine.start()
    eventually(lambda: engine.progress.segment == 1 and engine.progress.elapsed > 2)
    engine.pause()
    assert engine.state is State.PAUSED
    assert device.value == 0.0
    time.sleep(0.1)
    assert device.value == 0.0
    engine.resume()
    outcome = engine.wait(10)
    assert outcome.status is State.COMPLETED
    assert outcome.recording is not None
    recording = open_recording(outcome.recording)
    pressure, commanded = recording.streams["pressure"], recording.setpoints["pressure"]
    held = np.sum(pressure.value == -30e3) / 100
    assert 8.0 < held < 16.0  # the whole hold again, after a part of it
    assert {e.code for e in recording.events} >= {"pause", "resume"}
    middle = (pressure.value[1:-1] == pressure.value[:-2]) & (pressure.value[1:-1] == pressure.value[2:])
    due = np.interp(pressure.time, commanded.time, commanded.value)
    assert np.abs(pressure.value - due)[1:-1][middle].max() < 1.0


def test_until_ends_a_segment_early(engine: RunEngine, plan: Plan) -> None:
    until = Until("pressure", "<=", -10e3)
    engine.connect()
    engine.arm(plan(Setpoints((ramp(100, 0, -50e3, until), ramp(1, -50e3, 0), ramp(1, 0, 0)))))
    engine.start()
    outcome = engine.wait(10)
    assert outcome.status is State.COMPLETED
    assert outcome.recording is not None
    recording = open_recording(outcome.recording)
    assert -20e3 < recording.streams["pressure"].value.min() <= -10e3
    assert recording.setpoints["pressure"].value.min() == pytest.approx(
        recording.streams["pressure"].value.min(), abs=20
    )
    assert any(e.code == "until" for e in recording.events)


@pytest.mark.parametrize(
    ("harm", "code"),
    [
        (lambda d: setattr(d, "override", -60e3), "value"),
        (lambda d: setattr(d, "override", float("nan")), "nan"),
        (lambda d: setattr(d, "override", 0.0), "tracking"),
        (lambda d: setattr(d, "silent", True), "stale"),
        (lambda d: setattr(d, "unplugged", True), "link"),
        (lambda d: setattr(d, "fault", "overheated"), "device"),
        (lambda d: d.make_safe(), "device"),
        (lambda d: d.raise_on.update(read=RuntimeError("a bug in a driver")), "link"),
    ],
)
def test_a_trip_vents_latches_and_needs_a_reset(
    engine: RunEngine, device: FakeDevice, plan: Plan, harm: Callable[[FakeDevice], None], code: str
) -> None:
    running(engine, plan(LONG))
    harm(device)
    eventually(lambda: engine.state is State.TRIPPED)
    eventually(lambda: device.vented)
    outcome = engine.wait(10)
    assert outcome.trip is not None
    assert outcome.trip.code == code
    assert outcome.recording is not None
    recording = open_recording(outcome.recording)
    assert (recording.info.status, recording.info.trip_reason) == ("tripped", outcome.reason)
    for action in (engine.start, engine.resume, engine.connect, lambda: engine.arm(plan(SHORT, name="next"))):
        with pytest.raises(WrongState):
            action()
    lost = isinstance(device.raise_on.get("make_safe"), Exception) or device.unplugged
    assert outcome.safe is not lost
    assert ("NOT SEEN TO BE SAFE" in outcome.reason) is lost
    assert any(e.code == "unconfirmed" for e in recording.events) is lost
    device.__init__()  # type: ignore[misc]
    engine.reset()
    assert engine.trip is None
    engine.connect()
    engine.arm(plan(SHORT, name="next"))
    engine.start()
    assert engine.wait(10).status is State.COMPLETED


def test_a_rate_trips(engine: RunEngine, device: FakeDevice, plan: Plan) -> None:
    limits = Limits({"pressure": Range(-50e3, 0.0, rate=40e3)}, "test")
    engine.connect()
    engine.arm(plan(LONG, limits))
    engine.start()
    eventually(lambda: device.value <= -30e3)
    device.override = -10e3
    outcome = engine.wait(10)
    assert outcome.trip is not None
    assert outcome.trip.code == "rate"


def test_the_emergency_stop_latches_in_every_state(engine: RunEngine, device: FakeDevice, plan: Plan) -> None:
    engine.stop()
    eventually(lambda: engine.state is State.TRIPPED)
    engine.reset()
    running(engine, plan(LONG))
    engine.stop("red button")
    eventually(lambda: device.vented)
    assert engine.wait(5).reason == "estop: red button"
    with pytest.raises(WrongState):
        engine.connect()


def test_a_dead_supervisor_trips(engine: RunEngine, plan: Plan) -> None:
    running(engine, plan(LONG))
    heart = engine._heartbeat
    assert isinstance(heart, Heart)
    heart.alive = False
    outcome = engine.wait(5)
    assert outcome.trip is not None
    assert outcome.trip.code == "supervisor"


def test_an_exception_inside_the_engine_fails_safely(engine: RunEngine, device: FakeDevice, plan: Plan) -> None:
    running(engine, plan(LONG))
    engine._active.feeder.follow = None  # type: ignore[assignment, method-assign]
    outcome = engine.wait(5)
    assert outcome.status is State.FAILED
    assert "TypeError" in outcome.reason
    assert device.vented
    assert outcome.recording is not None


def test_lost_samples_are_counted_and_told(engine: RunEngine, device: FakeDevice, plan: Plan) -> None:
    running(engine, plan(LONG))
    device.gap = True
    eventually(lambda: engine.progress.lost == 100)
    engine.abort()
    outcome = engine.wait(5)
    assert outcome.lost == 100
    assert outcome.recording is not None
    assert any(e.code == "lost" for e in open_recording(outcome.recording).events)


def test_a_full_recorder_stops_the_run(
    engine: RunEngine, device: FakeDevice, plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    running(engine, plan(LONG))
    assert engine._run is not None
    monkeypatch.setattr(engine._run._recorder._queue, "_capacity", 1)
    monkeypatch.setattr(engine, "behind", lambda: False)
    outcome = engine.wait(5)
    assert outcome.trip is not None
    assert outcome.trip.code == "recorder"
    assert device.vented


def test_nothing_is_armed_without_sound_limits(engine: RunEngine, device: FakeDevice, plan: Plan) -> None:
    engine.connect()
    with pytest.raises(ValueError, match="without limits nothing is armed"):
        engine.arm(plan(SHORT, Limits()))
    with pytest.raises(ValueError, match="outside"):
        engine.arm(plan(SHORT, Limits({"pressure": Range(-10e3, 0.0)}, "subject")))
    robot = Setpoints((Segment(1, {"probe_x": 0.0}, {"probe_x": 0.0}),))
    with pytest.raises(ValueError, match="commanded by pressure"):
        engine.arm(plan(robot, LIMITS))
    assert engine.state is State.READY
    assert "arm" not in device.calls


def test_a_limit_of_the_probe_is_not_sent_to_a_device_without_one(
    engine: RunEngine, device: FakeDevice, plan: Plan
) -> None:
    engine.connect()
    engine.arm(plan(SHORT, Limits({"pressure": Range(-50e3, 0.0), "probe": Range(0.0, 2e-3)}, "test")))
    assert set(device.limits) == {"pressure"}


def test_a_recording_is_never_overwritten(engine: RunEngine, plan: Plan) -> None:
    engine.connect()
    made = plan()
    made.path.write_bytes(b"precious")
    with pytest.raises(FileExistsError):
        engine.arm(made)
    assert made.path.read_bytes() == b"precious"
    assert engine.state is State.READY


def test_a_device_that_cannot_be_connected_or_armed(engine: RunEngine, device: FakeDevice, plan: Plan) -> None:
    device.raise_on["connect"] = LinkLost("fake: nobody there")
    with pytest.raises(LinkLost, match="nobody there"):
        engine.connect()
    assert engine.state is State.FAILED
    engine.reset()
    device.raise_on = {"arm": Refused("fake: not today")}
    engine.connect()
    with pytest.raises(Refused, match="not today"):
        engine.arm(plan())
    assert engine.state is State.FAILED


def test_closing_in_the_middle_of_a_run_is_safe(engine: RunEngine, device: FakeDevice, plan: Plan) -> None:
    running(engine, plan(LONG))
    engine.close()
    assert device.vented
    assert engine.wait(0).status is State.ABORTED
    with pytest.raises(WrongState, match="closed"):
        engine.connect()


def test_a_listener_that_raises_does_no_harm(device: FakeDevice, plan: Plan) -> None:
    from acquire.engine import RunEngine
    from drivers.device import Rig

    def listener(state: State, event: str) -> None:
        raise RuntimeError("a bad listener")

    engine = RunEngine(Rig("fake", device), listener=listener)
    running(engine, plan(LONG))
    engine.abort()
    assert engine.wait(5).status is State.ABORTED
    engine.close()


def test_a_pause_before_anything_has_moved(engine: RunEngine, device: FakeDevice, plan: Plan) -> None:
    engine.connect()
    engine.arm(plan())
    engine.start()
    engine.pause()
    engine.resume()
    outcome = engine.wait(10)
    assert outcome.status is State.COMPLETED
    assert outcome.recording is not None
    assert open_recording(outcome.recording).streams["pressure"].value.min() == -30e3


@pytest.mark.parametrize("delay", [0.005, 0.015, 0.03, 0.05])
def test_pauses_at_any_moment_lose_nothing(engine: RunEngine, plan: Plan, delay: float) -> None:
    engine.connect()
    engine.arm(plan())
    engine.start()
    for _ in range(3):
        time.sleep(delay)
        if engine.state is State.RUNNING:
            engine.pause()
            engine.resume()
    outcome = engine.wait(10)
    assert outcome.status is State.COMPLETED
    assert outcome.recording is not None
    recording = open_recording(outcome.recording)
    assert np.sum(recording.streams["pressure"].value == -30e3) / 100 >= 1.99


def test_a_full_disk_trips_and_then_forbids_arming(
    engine: RunEngine, device: FakeDevice, plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    running(engine, plan(LONG))
    full = shutil._ntuple_diskusage(10**9, 10**9, 10**6)  # type: ignore[attr-defined]
    monkeypatch.setattr(interlock.shutil, "disk_usage", lambda folder: full)
    outcome = engine.wait(5)
    assert outcome.trip is not None
    assert outcome.trip.code == "disk"
    assert "1 MB free" in outcome.reason
    assert device.vented
    engine.reset()
    engine.connect()
    with pytest.raises(ValueError, match="200 MB needed"):
        engine.arm(plan(name="next"))
