"""The engine's smaller parts: queues, recorder, link thread, interlock rules."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from acquire.engine.freshness import Freshness
from acquire.engine.interlock import Interlock
from acquire.engine.link import LinkThread
from acquire.engine.queues import DisplayQueue, Overflow, RecordQueue
from acquire.engine.recorder import Recorder
from acquire.engine.rules import Rules, Tracking, Trip
from acquire.recording import RunInfo, open_recording
from drivers.device import LinkLost, Status
from drivers.signals import Block, FloatArray, Frame
from protocols.limits import PROBE, Limits, Range
from tests.acquire.engine.fake import FakeDevice
from tests.acquire.engine.helpers import eventually

INFO = RunInfo("r", "fake", "2024-01-01T00:00:00+00:00")


def block(first: int, n: int = 10, rate: float = 100.0, **values: object) -> Block:
    seq = np.arange(first, first + n)
    filled = {name: np.broadcast_to(np.asarray(v, float), (n,)).copy() for name, v in values.items()}
    return Block(filled or {"pressure": np.zeros(n)}, seq, seq / rate, np.zeros(n))


def test_the_record_queue_never_drops() -> None:
    queue: RecordQueue[Block] = RecordQueue(capacity=2000)
    taken = 0
    while queue.fill < 0.8:
        queue.put(block(10 * taken))
        taken += 1
    with pytest.raises(Overflow, match="behind"):
        queue.put(block(0, 100))
    assert 0.5 < queue.fill <= 1
    assert [b.seq[0] for b in queue.take(0)] == [10 * k for k in range(taken)]
    assert queue.fill == 0
    queue.put(block(0))


def test_the_display_queue_drops_the_oldest() -> None:
    queue: DisplayQueue[int] = DisplayQueue(3)
    queue.put(range(5))
    assert (queue.take(), queue.dropped, queue.take()) == ([2, 3, 4], 2, [])


def test_the_recorder_counts_what_is_missing(tmp_path: Path) -> None:
    failures: list[str] = []
    recorder = Recorder(tmp_path / "r.h5", INFO, (), failures.append, 2e-5)
    recorder.start()
    image = np.zeros((4, 6), np.uint8)
    for item in (block(0), block(10), block(25), Frame(image, 0, 0.0, 0.0), Frame(image, 3, 0.3, 0.0)):
        recorder.put(item)
    recording = open_recording(recorder.finish("completed", "").result(10))
    recorder.join()
    assert (recorder.lost, failures) == (7, [])
    assert [e.text for e in recording.events if e.code == "lost"] == [
        "5 samples of pressure are lost",
        "2 samples of frames are lost",
    ]
    assert recording.frames is not None
    assert recording.frames.scale == 2e-5


def test_a_recorder_that_cannot_write_says_so_once_and_keeps_what_it_has(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    failures: list[str] = []
    recorder = Recorder(tmp_path / "r.h5", INFO, (), failures.append)
    recorder.start()
    recorder.put(block(0))
    eventually(lambda: recorder._missing != {})

    def full(item: Block) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(recorder._writer, "block", full)
    recorder.put(block(10))
    eventually(lambda: bool(failures))
    recorder.put(block(20))
    recording = open_recording(recorder.finish("tripped", "disk").result(10))
    recorder.join()
    assert len(failures) == 1
    assert "No space" in failures[0]
    assert len(recording.streams["pressure"].value) == 10


class Receiver:
    """Takes the samples that a link delivers."""

    def __init__(self) -> None:
        self.items: list[Block | Frame] = []
        self.errors: list[Exception] = []
        self.slow = False

    def receive(self, link: LinkThread, items: object) -> None:
        self.items += items  # type: ignore[operator]

    def behind(self) -> bool:
        return self.slow

    def lost(self, link: LinkThread, error: Exception) -> None:
        self.errors.append(error)


@pytest.fixture
def link() -> Iterator[tuple[LinkThread, FakeDevice, Receiver]]:
    device, receiver = FakeDevice(), Receiver()
    thread = LinkThread(device, receiver)
    thread.start()
    yield thread, device, receiver
    thread.stop()
    thread.join()


def test_a_stop_overtakes_what_is_queued(link: tuple[LinkThread, FakeDevice, Receiver]) -> None:
    thread, device, _ = link
    thread.connect().result(5)
    busy = threading.Event()
    first = thread.ask(lambda: busy.wait(5))
    eventually(first.running)
    later = [thread.ask(device.start) for _ in range(3)]
    thread.make_safe()
    assert not thread.wait_safe(0.05)
    busy.set()
    assert thread.wait_safe(5)
    assert first.result(5)
    assert all(future.cancelled() for future in later)
    assert "start" not in device.calls


def test_a_receiver_that_is_behind_slows_the_reading_but_not_the_commands(
    link: tuple[LinkThread, FakeDevice, Receiver],
) -> None:
    thread, _, receiver = link
    thread.connect().result(5)
    eventually(lambda: bool(receiver.items))
    receiver.slow = True
    thread.ask(lambda: None).result(5)
    count = len(receiver.items)
    assert thread.ask(lambda: 7).result(5) == 7
    time.sleep(0.05)
    assert len(receiver.items) <= count + 1
    receiver.slow = False
    eventually(lambda: len(receiver.items) > count + 1)


def test_a_lost_link_is_told_once_and_made_safe(link: tuple[LinkThread, FakeDevice, Receiver]) -> None:
    thread, device, receiver = link
    thread.connect().result(5)
    device.raise_on["read"] = LinkLost("gone")
    eventually(lambda: bool(receiver.errors))
    time.sleep(0.05)
    assert [str(e) for e in receiver.errors] == ["gone"]
    assert "make_safe" in device.calls
    thread.stop()
    thread.join()
    with pytest.raises(LinkLost, match="closed"):
        thread.ask(lambda: 1).result(1)


Look = Callable[..., Trip | None]


@pytest.fixture
def look() -> Iterator[Look]:
    """Let an interlock look at blocks; the trip it finds."""
    made: list[Interlock] = []

    def run(blocks: list[Block], limits: Limits, rules: Rules | None = None, **more: object) -> Trip | None:
        interlock = Interlock(rules or Rules(), lambda trip: None)
        made.append(interlock)
        interlock.watch(limits, ("fake",), **more)  # type: ignore[arg-type]
        for item in blocks:
            interlock.receive("fake", item, None)
        interlock.start()
        eventually(lambda: interlock.backlog == 0)
        time.sleep(0.01)
        return interlock.trip

    yield run
    for interlock in made:
        interlock.close()
        interlock.join()


def test_values_within_the_margin_do_not_trip(look: Look) -> None:
    limits = Limits({"pressure": Range(-10e3, 0.0)})
    assert look([block(0, pressure=-10.9e3)], limits) is None
    trip = look([block(0, pressure=0.0), block(10, pressure=-11.1e3)], limits)
    assert trip is not None
    assert (trip.code, trip.time) == ("value", 0.11)  # one sample alone may be a disturbance


def test_the_probe_as_a_whole_is_limited(look: Look) -> None:
    limits = Limits({PROBE: Range(0.0, 1e-3)})
    sideways = {"probe_x": 0.9e-3, "probe_y": 0.9e-3, "probe_z": 0.0}
    trip = look([block(0, **sideways), block(10, **sideways)], limits)
    assert trip is not None
    assert trip.message == "probe is 1.273 mm, outside 0 mm … 1 mm"
    assert look([block(0, **{**sideways, "probe_y": 0.0})], limits) is None


def test_a_rate_is_seen_across_blocks(look: Look) -> None:
    limits = Limits({"pressure": Range(-50e3, 0.0, rate=1e3)})
    slow = [block(10 * k, pressure=-10.0 * np.arange(10 * k, 10 * k + 10)) for k in range(5)]
    assert look(slow, limits) is None
    jump = [block(0, pressure=0.0), block(10, pressure=-500.0)]
    trip = look(jump, limits)
    assert trip is not None
    assert trip.code == "rate"


def test_tracking_counts_only_lasting_errors(look: Look) -> None:
    rules = Rules(tracking={"pressure": Tracking(100.0, 0.25)}, plausible=False)

    def commanded(time: object, status: object) -> dict[str, object]:
        return {"pressure": np.full(np.shape(time), -1000.0)}

    errors = [block(10 * k, pressure=-500.0) for k in range(2)]
    good = [block(10 * k, pressure=-990.0) for k in range(2, 4)]
    again = [block(10 * k, pressure=-500.0) for k in range(4, 6)]
    assert look(errors + good + again, Limits(), rules, commanded=commanded) is None
    trip = look([block(10 * k, pressure=-500.0) for k in range(4)], Limits(), rules, commanded=commanded)
    assert trip is not None
    assert (trip.code, trip.message.split(" since")[0]) == ("tracking", "pressure is off its set-point by 5 mbar")


@pytest.mark.parametrize(("unknown", "trips"), [(2, True), (40, False)])
def test_a_set_point_unknown_between_segments_does_not_end_a_deviation(look: Look, unknown: int, trips: bool) -> None:
    rules = Rules(tracking={"pressure": Tracking(100.0, 0.25)}, plausible=False)

    def commanded(time: FloatArray, status: object) -> dict[str, FloatArray]:
        known = (time < 0.2) | (time > 0.2 + 0.01 * unknown)  # 100 samples a second
        return {"pressure": np.where(known, -1000.0, np.nan)}

    blocks = [block(5 * k, 5, pressure=-500.0) for k in range(8 + unknown // 5)]
    assert (look(blocks, Limits(), rules, commanded=commanded) is not None) == trips


def test_too_long_away_from_rest_trips(look: Look) -> None:
    limits = Limits({"pressure": Range(-10e3, 0.0, dwell=1.0)})
    away, rest = np.full(50, -5e3), np.zeros(50)
    assert look([block(0, 100, pressure=np.concatenate([rest, away]))], limits) is None
    trip = look([block(100 * k, 100, pressure=np.concatenate([rest, away])) for k in range(2)], limits)
    assert trip is not None, "half a second is no rest"
    assert trip.code == "dwell"
    assert 1.6 <= trip.time < 2.0
    commanded = {"pressure": np.full(100, -100.0)}  # what hardly shows counts too if it is commanded

    def asked(time: FloatArray, status: object) -> dict[str, FloatArray]:
        return {q: v[: len(time)] for q, v in commanded.items()}

    still = [block(100 * k, 100, pressure=0.0) for k in range(2)]
    trip = look(still, limits, commanded=asked)
    assert trip is not None
    assert trip.code == "dwell"
    assert look([block(100 * k, 100, pressure=0.0) for k in range(2)], limits) is None


def test_one_sample_far_away_trips_nothing_and_two_do(look: Look) -> None:
    limits = Limits({"pressure": Range(-50e3, 0.0, rate=100e3)})
    for count, expected in ((1, False), (2, True)):
        for first in (3, 9):  # inside a block and across two
            spiky = np.full(30, -30e3)
            spiky[first : first + count] = -90e3
            trip = look([block(0, pressure=spiky[:10]), block(10, 20, pressure=spiky[10:])], limits)
            assert (trip is not None) == expected
            if trip is not None:
                assert trip.time == (first + 1) / 100


def test_only_new_samples_are_a_sign_of_life() -> None:
    rules = Rules(stale=0.5, lag=0.95)
    fresh = Freshness(("fake",), rules, 0.0)
    first = block(0)
    assert fresh.take("fake", first, 0.1) is first
    assert fresh.take("fake", first, 0.4) is None
    overlapping = fresh.take("fake", block(5), 0.5)
    assert isinstance(overlapping, Block)
    assert list(overlapping.seq) == [10, 11, 12, 13, 14]
    frozen = Block({"pressure": np.zeros(3)}, np.array([20, 21, 22]), np.full(3, 0.14), np.zeros(3))
    assert fresh.take("fake", frozen, 0.9) is None, "the number goes on, the time does not"
    assert fresh.fault(0.99) is None
    trip = fresh.fault(1.01)
    assert trip is not None
    assert trip.code == "stale"
    assert "no new sample for 0.51 s; the last is of device time 0.14 s" in trip.message
    image = np.zeros((2, 2), np.uint8)
    assert fresh.take("camera", Frame(image, 1, 0.1, 0.0), 0.1) is not None
    assert fresh.take("camera", Frame(image, 2, 0.1, 0.0), 0.1) is None
    assert fresh.take("camera", Frame(image, 1, 0.2, 0.0), 0.1) is None


def test_a_slow_device_clock_trips() -> None:
    for pace, code in ((1.0, ""), (0.9, ""), (0.5, "clock")):
        fresh = Freshness(("fake",), Rules(), 0.0)
        trip = None
        for k in range(1, 500):
            moment = 0.01 * k
            fresh.take("fake", Block({}, np.array([k]), np.array([pace * moment]), np.array([moment])), moment)
            trip = trip or fresh.fault(moment)
        assert (trip.code if trip else "") == code


def test_a_camera_may_miss_a_contour_but_a_gauge_may_not_fail(look: Look) -> None:
    missing = [block(0, apex_height=np.nan)]
    limits = Limits({"apex_height": Range(0.0, 5e-3, rate=1.0)})
    assert look(missing, limits, gappy=frozenset({"apex_height"})) is None
    trip = look(missing, limits)
    assert trip is not None
    assert trip.code == "nan"


def test_an_interlock_that_fails_trips(look: Look) -> None:
    def commanded(time: object, status: object) -> dict[str, object]:
        raise ZeroDivisionError("a bug")

    trip = look([block(0, pressure=0.0)], Limits(), commanded=commanded)
    assert trip is not None
    assert trip.code == "interlock"


def test_the_first_trip_latches() -> None:
    told: list[Trip] = []
    interlock = Interlock(Rules(), told.append)
    first = Trip("a", "first")
    for trip in (first, Trip("b", "second")):
        interlock.fire(trip)
    assert (interlock.trip, told) == (first, [first])
    interlock.reset()
    assert interlock.trip is None


def test_a_device_fault_in_the_status_trips() -> None:
    interlock = Interlock(Rules(), lambda trip: None)
    interlock.watch(Limits(), ("fake",))
    interlock.receive("fake", block(0), Status(1.0, "fault", 0, 0, "overheated"))
    interlock.start()
    eventually(lambda: interlock.trip is not None)
    interlock.close()
    interlock.join()
    assert interlock.trip == Trip("device", "fake reports overheated", 1.0)
