"""The run engine: takes one instrument through one run at a time, and out of it safely whatever happens."""

from __future__ import annotations

import logging
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import CancelledError, Future
from concurrent.futures import TimeoutError as FutureTimeout
from typing import Any, Protocol, TypeVar

import numpy as np

from acquire.engine.feeder import Feeder
from acquire.engine.interlock import Interlock, Rules, Trip
from acquire.engine.link import LinkThread
from acquire.engine.plan import Outcome, Progress, RunPlan
from acquire.engine.queues import DisplayQueue
from acquire.engine.recorder import Commanded, Recorder
from acquire.engine.state import State, StateMachine, WrongState
from acquire.recording import Event
from drivers.device import DeviceError, Identity, LinkLost, Refused, Rig, Status
from drivers.signals import Block, Channel, Frame
from protocols.limits import PROBE
from protocols.setpoints import Until

log = logging.getLogger(__name__)
T = TypeVar("T")

TICK = 0.02  # s of wall time between two turns of the engine when nothing wakes it earlier
ANSWER = 5.0  # s of wall time within which a link's thread has to answer
SAFE = 2.0  # s of wall time within which a device must confirm that it is safe
TAIL = 3.0  # s of wall time after which the recording of the venting ends at the latest

_COMPARE: dict[str, Callable[[Any, float], Any]] = {
    "<": np.less,
    "<=": np.less_equal,
    ">": np.greater,
    ">=": np.greater_equal,
}


class Heartbeat(Protocol):
    """What the engine needs of `acquire.supervisor.Supervisor`."""

    @property
    def alive(self) -> bool:
        """Whether beats can still be permitted."""

    def permissions(self) -> int:
        """Beats permitted so far."""

    def tick(self, name: str = "engine") -> None:
        """The control loop is alive."""


class RunEngine:
    """Runs protocols on one `Rig`; see `StateMachine` for the states.

    Every method may be called from any thread. `connect`, `arm`, `start`, `pause`, `resume`, `reset` and `disconnect`
    are carried out by the engine's own thread and return when done; they raise `WrongState` where the state forbids
    them. `abort` and `stop` (the emergency stop) overtake everything and return at once. Leaving a run on any path
    makes every device safe.

    A `heartbeat` of None is for devices without a watchdog; a real one is never run without.
    """

    def __init__(
        self,
        rig: Rig,
        *,
        rules: Rules | None = None,
        heartbeat: Heartbeat | None = None,
        listener: Callable[[State, str], None] | None = None,
    ) -> None:
        self.rig = rig
        self.display: DisplayQueue[Block | Frame] = DisplayQueue()
        self.identities: dict[str, Identity] = {}
        self._machine = StateMachine(self._changed)
        self._listener = listener
        self._heartbeat = heartbeat
        self._links: list[LinkThread] = []
        self._interlock = Interlock(rules or Rules(), self._tripped)
        self._requests: deque[tuple[Callable[[], Any], Future[Any]]] = deque()
        self._wake = threading.Event()
        self._abort = ""
        self._ticked = 0.0
        self._closing = False
        self._outcome: Future[Outcome] = Future()
        self._plan: RunPlan | None = None
        self._recorder: Recorder | None = None
        self._feeder: Feeder | None = None
        self._arrived: deque[Block] = deque(maxlen=256)  # for `until` conditions
        self._recording_from = math.nan
        self._start_at = math.nan  # device time at which the protocol is to start; NaN once it has
        self._seen_running = False
        self._written_from = math.nan  # beginning of the set-points that the journal has
        self._thread = threading.Thread(target=self._run, name=f"engine-{rig.instrument}", daemon=True)
        self._thread.start()
        self._interlock.start()

    # What anybody may ask ---------------------------------------------------------------------------------------------

    @property
    def state(self) -> State:
        """The present state."""
        return self._machine.state

    @property
    def channels(self) -> tuple[Channel, ...]:
        """The channels of the device and its further sources."""
        return tuple(c for source in (self.rig.device, *self.rig.sources) for c in source.channels)

    @property
    def trip(self) -> Trip | None:
        """The trip that is latched."""
        return self._interlock.trip

    @property
    def status(self) -> Status | None:
        """The device's last status."""
        return self._links[0].status if self._links else None

    @property
    def progress(self) -> Progress:
        """Where the run stands."""
        feeder, plan, status, recorder = self._feeder, self._plan, self.status, self._recorder
        now = status.time if status else math.nan
        if feeder is None or plan is None:
            return Progress(self.state, device_time=now, trip=self.trip)
        segments = plan.setpoints.segments
        index = min(feeder.index, len(segments) - 1)
        segment, edges = segments[index], plan.setpoints.edges
        within = min(max(now - feeder.began, 0.0), segment.duration) if math.isfinite(feeder.began) else 0.0
        return Progress(
            state=self.state,
            segment=index,
            segments=len(segments),
            phase=segment.phase,
            step=segment.step,
            labels=segment.labels,
            elapsed=float(edges[-1] if feeder.finished else edges[index] + within),
            duration=float(edges[-1]),
            segment_left=segment.duration - within,
            device_time=now,
            lost=recorder.lost if recorder else 0,
            recorder_fill=recorder.fill if recorder else 0.0,
            trip=self.trip,
        )

    # What a person, a program or a window may do ----------------------------------------------------------------------

    def connect(self) -> None:
        """Open every link. Raises DeviceError; the state is then ``failed``."""
        self._do(self._connect)

    def arm(self, plan: RunPlan) -> None:
        """Check the plan against its limits, open its journal, hand the limits to the device.

        Raises ValueError (limits missing or exceeded, wrong quantities), FileExistsError, DeviceError.
        """
        self._do(lambda: self._arm(plan))

    def start(self) -> None:
        """Begin the run; returns at once."""
        self._do(self._start)

    def pause(self) -> None:
        """Vent and hold."""
        self._do(self._pause)

    def resume(self) -> None:
        """Go on from the beginning of the segment that was interrupted."""
        self._do(self._resume)

    def abort(self, reason: str = "aborted by a person") -> None:
        """End the run now. Does nothing when there is none."""
        if self.state.live or self.state is State.CONNECTING:
            self._abort = reason
            self._make_safe()
            self._wake.set()

    def stop(self, reason: str = "emergency stop") -> None:
        """Emergency stop: a trip, which latches until `reset`. Works in every state."""
        self._make_safe()
        self._interlock.fire(Trip("estop", reason))

    def reset(self) -> None:
        """Acknowledge a trip or failure: a person's. The links are closed; `connect` opens them anew."""
        self._do(self._reset)

    def disconnect(self) -> None:
        """Close the links."""
        self._do(self._disconnect)

    def wait(self, timeout: float | None = None) -> Outcome:
        """Wait for the end of the run and its recording. Raises TimeoutError."""
        return self._outcome.result(timeout)

    def close(self) -> None:
        """End everything: a run is aborted, devices are made safe, links closed, threads ended. Idempotent."""
        if self._closing:
            return
        self.abort("the application ended")
        self._closing = True
        self._wake.set()
        self._thread.join()
        self._interlock.close()
        self._interlock.join()

    # What the links' threads call -------------------------------------------------------------------------------------

    def receive(self, link: LinkThread, items: Sequence[Block | Frame]) -> None:
        """Hand on what arrived: recorder first, then interlock, then screens."""
        recorder = self._recorder
        for item in items:
            if recorder is not None:
                recorder.put(item)
            self._interlock.receive(link.source.name, item, link.status)
            if isinstance(item, Block):
                self._arrived.append(item)
        self.display.put(items)
        self._wake.set()

    def behind(self) -> bool:
        """Whether the recorder is half full: the link is then read more slowly."""
        recorder = self._recorder
        return recorder is not None and recorder.fill > 0.5

    def lost(self, link: LinkThread, error: Exception) -> None:
        """A link failed: a trip, or a failure where nothing is armed."""
        log.warning("%s: %s", link.source.name, error)
        self._interlock.fire(Trip("link", str(error), link.status.time if link.status else math.nan))

    # The engine's thread ----------------------------------------------------------------------------------------------

    def _run(self) -> None:
        while not (self._closing and not self.state.live):
            self._wake.wait(TICK)
            self._wake.clear()
            try:
                self._turn()
            except CancelledError:
                pass  # a stop overtook what was asked of a link; the next turn acts on it
            except Exception as error:
                if self._interlock.trip is not None:
                    continue  # a lost link has tripped already, in its own words
                log.exception("%s: the engine failed", self.rig.instrument)
                self._end("fail", f"{type(error).__name__}: {error}")
        self._close_links()
        while self._requests:
            self._requests.popleft()[1].set_exception(WrongState("the engine is closed"))

    def _turn(self) -> None:
        self._tick()
        if self._stopped():
            return
        while self._requests:
            action, future = self._requests.popleft()
            try:
                future.set_result(action())
            except CancelledError:
                future.set_exception(WrongState("a stop came first"))
            except Exception as error:
                future.set_exception(error)
        if not self._stopped() and self.state is State.RUNNING:
            self._drive()

    def _stopped(self) -> bool:
        """Whether a trip or an abort ended the run in this turn."""
        trip, reason = self._interlock.trip, self._abort
        if trip is not None and self._machine.can("trip"):
            self._end("trip", f"{trip.code}: {trip.message}")
            return True
        self._abort = ""
        if reason and self._machine.can("abort"):
            self._end("abort", reason)
            return True
        return False

    def _tick(self) -> None:
        """Tell the supervisor that the control loop is alive; only while it is in charge of a live device."""
        if self._heartbeat is None or not self.state.live:
            return
        now = time.monotonic()
        if now - self._ticked >= TICK / 2:
            self._ticked = now
            self._heartbeat.tick()
            if not self._heartbeat.alive:
                self._interlock.fire(Trip("supervisor", "the supervisor process is gone: no heartbeat any more"))

    def _do(self, action: Callable[[], T]) -> T:
        """Have ``action`` carried out by the engine's thread and wait for it."""
        if self._closing:
            raise WrongState("the engine is closed")
        future: Future[T] = Future()
        self._requests.append((action, future))
        self._wake.set()
        while self._thread.is_alive():
            try:
                return future.result(1.0)
            except FutureTimeout:
                if future.done():
                    raise
        raise WrongState("the engine is closed")

    def _ask(self, action: Callable[[], T], link: LinkThread | None = None) -> T:
        """Have ``action`` carried out by a link's thread (the device's by default), beating meanwhile."""
        return self._await((link or self._links[0]).ask(action))

    def _await(self, future: Future[T], timeout: float = ANSWER) -> T:
        deadline = time.monotonic() + timeout
        while True:
            try:
                return future.result(TICK)
            except FutureTimeout:
                self._tick()
                if future.done():
                    continue  # the action itself raised a TimeoutError
                if self._abort or self._interlock.trip is not None:
                    raise CancelledError from None
                if time.monotonic() > deadline:
                    raise LinkLost(f"{self.rig.device.name}: the link's thread does not answer") from None

    # Steps ------------------------------------------------------------------------------------------------------------

    def _connect(self) -> None:
        self._machine.fire("connect")
        beat = self._heartbeat.permissions if self._heartbeat is not None else None
        self._links = [LinkThread(source, self, beat) for source in (self.rig.device, *self.rig.sources)]
        for link in self._links:
            link.start()
        try:
            for link in self._links:
                self.identities[link.source.name] = self._await(link.connect(), 15.0)
        except CancelledError:
            self._close_links()
            raise
        except Exception as error:
            self._end("fail", str(error))
            self._close_links()
            if isinstance(error, DeviceError):
                raise
            raise LinkLost(f"{self.rig.instrument}: {error}") from error
        self._machine.fire("connected")

    def _arm(self, plan: RunPlan) -> None:
        if not self._machine.can("arm"):
            raise WrongState(f"cannot arm while {self.state}")
        device = self.rig.device
        if set(plan.setpoints.quantities) != set(device.quantities):
            raise ValueError(
                f"the protocol commands {', '.join(plan.setpoints.quantities) or 'nothing'}; "
                f"{device.name} is commanded by {', '.join(device.quantities)}"
            )
        for violation in plan.limits.violations(plan.setpoints):
            where = f"step {violation.step}: " if violation.step else ""
            raise ValueError(f"{where}{violation.quantity}: {violation.message}")
        plan.path.parent.mkdir(parents=True, exist_ok=True)
        feeder = Feeder(plan.setpoints, device.queue_capacity, plan.rest, plan.limits.rates())
        recorder = Recorder(plan.path, plan.info, self.channels, self._recorder_failed, plan.frame_scale)
        recorder.start()
        self._plan, self._feeder, self._outcome = plan, feeder, Future()
        self._start_at = self._written_from = math.nan
        self._recording_from = self._now()
        self._seen_running = False
        known = {PROBE, *device.quantities, *(c.name for c in self.channels)}
        limits = {n: v for n, v in plan.limits.values().items() if n in known and plan.limits[n].bounded}
        self._machine.fire("arm")
        self._recorder = recorder
        try:
            self._ask(lambda: device.arm(limits))
        except CancelledError:
            raise
        except Exception as error:
            self._end("fail", str(error))
            raise
        names = tuple(link.source.name for link in self._links)
        gappy = frozenset(c.name for source in self.rig.sources for c in source.channels)
        self._interlock.watch(plan.limits, names, feeder.commanded, plan.path.parent, gappy)

    def _start(self) -> None:
        self._machine.fire("start")
        self._start_at = self._now() + (self._plan.baseline if self._plan else 0.0)

    def _pause(self) -> None:
        if not self._machine.can("pause"):
            raise WrongState(f"cannot pause while {self.state}")
        assert self._feeder is not None
        if self._seen_running:
            self._ask(self.rig.device.hold)
            held = self._until_status("held")
            self._feeder.follow(held)
            at = held.began if math.isfinite(held.began) else held.time
            self._feeder.interrupt(max(at, self._feeder.began))
            self._note("info", "pause", "vented and held")
        self._machine.fire("pause")

    def _resume(self) -> None:
        self._machine.fire("resume")
        self._note("info", "resume", "resumed at the beginning of the interrupted segment")
        self._start_at = self._now()

    def _reset(self) -> None:
        self._machine.fire("reset")
        self._interlock.reset()
        self._close_links()

    def _disconnect(self) -> None:
        self._machine.fire("disconnect")
        self._close_links()

    def _drive(self) -> None:
        """One turn of a running protocol: feed the device, follow it, end what is to end."""
        feeder, status, device = self._feeder, self.status, self.rig.device
        assert feeder is not None
        if status is None:
            return
        if math.isfinite(self._start_at):
            if status.time >= self._start_at:
                self._start_at = math.nan
                self._seen_running = False
                self._ask(lambda segments=feeder.feed(): device.enqueue(segments))  # type: ignore[misc]
                self._ask(device.start)
            return
        if not self._seen_running:
            self._seen_running = status.state == "running"
            if not self._seen_running:
                return
        feeder.follow(status)
        if feeder.finished:
            self._end("complete", "")
            return
        if status.state in ("safe", "idle", "held"):
            text = status.fault or "it stopped by itself (heartbeat missed, or its own safety)"
            self._interlock.fire(Trip("device", f"{device.name}: {text}", status.time))
            return
        self._look_for_until(feeder)
        if segments := feeder.feed():
            self._ask(lambda: device.enqueue(segments))
        self._write_setpoints(feeder)

    def _look_for_until(self, feeder: Feeder) -> None:
        watched = feeder.watched
        while self._arrived:
            block = self._arrived.popleft()
            if watched is None or watched.until is None or watched.until.channel not in block.values:
                continue
            met = _COMPARE[watched.until.comparison](block.values[watched.until.channel], watched.until.value)
            met &= block.time >= feeder.began
            if met.any():
                self._ask(self.rig.device.skip)
                feeder.skipped()
                self._note("info", "until", f"{_words(watched.until)} at {block.time[met.argmax()]:.3f} s")
                watched = None

    def _write_setpoints(self, feeder: Feeder) -> None:
        """Keep the journal's set-points true: written at the start and wherever the plan shifted."""
        if self._recorder is None or not math.isfinite(feeder.began):
            return
        if feeder.shifted or not math.isfinite(self._written_from):
            feeder.shifted = False
            self._written_from = feeder.began
            self._recorder.put(Commanded(feeder.remaining(), feeder.began))

    # Ends -------------------------------------------------------------------------------------------------------------

    def _end(self, event: str, reason: str) -> None:
        """Leave a run: the one way out of every live state."""
        if not self._machine.can(event):
            return
        self._make_safe()
        state = self._machine.fire(event)
        asked = time.monotonic()
        safe = all([link.wait_safe(max(0.0, asked + SAFE - time.monotonic())) for link in self._links])
        if self._recorder is not None and self._plan is not None and self._feeder is not None:
            if not safe:
                self._note("error", "unconfirmed", "the device did not confirm that it is safe; its watchdog vents it")
            self._close_recording(state, reason)
        self._interlock.rest()

    def _close_recording(self, state: State, reason: str) -> None:
        recorder, plan, feeder = self._recorder, self._plan, self._feeder
        assert recorder is not None
        assert plan is not None
        assert feeder is not None
        ended = self._now()
        if state is not State.COMPLETED:
            feeder.interrupt(ended)
            self._note("trip" if state is State.TRIPPED else "warning", str(state), reason)
        deadline = time.monotonic() + TAIL
        while self._now() < ended + plan.tail and time.monotonic() < deadline and not self._links[0].error:
            time.sleep(TICK / 4)
        self._recorder = None
        if feeder.done:
            first = min(self._recording_from, feeder.done[0].begin)
            recorder.put(Commanded(feeder.executed(first, self._now()), first))
        result = recorder.finish(str(state), reason)
        path, journal = None, None
        try:
            path = result.result()
        except Exception as error:
            journal = recorder.journal
            reason = f"{reason}; the recording could not be written: {error}".lstrip("; ")
        recorder.join()
        self._outcome.set_result(Outcome(state, reason, path, journal, self.trip, recorder.lost))

    def _make_safe(self) -> None:
        for link in self._links:
            link.make_safe()

    def _close_links(self) -> None:
        for link in self._links:
            link.stop()
        for link in self._links:
            link.join()
        self._links = []

    def _tripped(self, trip: Trip) -> None:
        """The interlock tripped, in whatever thread: stop first, think later."""
        self._make_safe()
        self._wake.set()

    def _recorder_failed(self, reason: str) -> None:
        self._interlock.fire(Trip("recorder", reason))

    def _changed(self, state: State, event: str) -> None:
        log.info("%s: %s -> %s", self.rig.instrument, event, state)
        if self._listener is not None:
            try:
                self._listener(state, event)
            except Exception:  # a listener's fault must not keep a device from being made safe
                log.exception("%s: a listener failed on %s", self.rig.instrument, event)

    # Small things -----------------------------------------------------------------------------------------------------

    def _now(self) -> float:
        """Device time in s."""
        return self.status.time if self.status is not None else 0.0

    def _until_status(self, state: str) -> Status:
        deadline = time.monotonic() + ANSWER
        while time.monotonic() < deadline:
            if self.status is not None and self.status.state == state:
                return self.status
            if self._abort or self._interlock.trip is not None:
                raise CancelledError
            self._tick()
            time.sleep(TICK / 4)
        raise Refused(f"{self.rig.device.name} does not become {state}")

    def _note(self, level: str, code: str, text: str) -> None:
        if self._recorder is not None:
            self._recorder.put(Event(self._now(), level, code, text))


def _words(until: Until) -> str:
    return f"{until.channel} {until.comparison} {until.value:g} (SI)"
