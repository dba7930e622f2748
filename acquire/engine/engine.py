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
from dataclasses import replace
from typing import Any, TypeVar

from acquire.engine.active import ActiveRun
from acquire.engine.interlock import Interlock
from acquire.engine.link import LinkThread
from acquire.engine.plan import Outcome, Progress, RunPlan
from acquire.engine.queues import DisplayQueue
from acquire.engine.rules import Rules, Trip
from acquire.engine.state import Aborted, State, StateMachine, Tripped, WrongState
from acquire.supervisor import Heartbeat
from drivers.device import DeviceError, Identity, LinkLost, Rig, Status
from drivers.signals import Block, Channel, Frame

log = logging.getLogger(__name__)
T = TypeVar("T")

TICK = 0.02  # s of wall time between two turns of the engine when nothing wakes it earlier
ANSWER = 5.0  # s of wall time within which a link's thread has to answer
BACKLOG = 200  # blocks that may wait for the interlock before links are read more slowly
SETTLE = 0.25  # s of device time that must have been heard before arming: a tare is made of it
SAFE = 2.0  # s of wall time within which a device must confirm that it is safe


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
        self._aborts: deque[str] = deque()
        self._ticked = 0.0
        self._closing = False
        self._outcome: Future[Outcome] = Future()
        self._run: ActiveRun | None = None
        self._thread = threading.Thread(target=self._serve, name=f"engine-{rig.instrument}", daemon=True)
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
    def found(self) -> str:
        """What `connect` found left behind by an earlier host and made safe, in words; '' where all was well."""
        return self._links[0].found if self._links else ""

    @property
    def plan(self) -> RunPlan | None:
        """The plan of the present or the last run."""
        return self._run.plan if self._run is not None else None

    @property
    def progress(self) -> Progress:
        """Where the run stands."""
        now = self.status.time if self.status else math.nan
        run = self._run
        progress = Progress(self.state, device_time=now) if run is None else run.progress(self.state, now)
        return replace(progress, trip=self.trip)

    # What a person, a program or a window may do ----------------------------------------------------------------------

    def connect(self, *, acknowledged: bool = False) -> None:
        """Open every link and make safe what an earlier host left behind (`found` says what that was).

        Raises DeviceError; the state is then ``failed``. A fault that the device latched is such an error, unless a
        person has ``acknowledged`` it.
        """
        self._do(lambda: self._connect(acknowledged))

    def arm(self, plan: RunPlan) -> None:
        """Check the plan against its limits, open its journal, hand the limits to the device.

        Raises ValueError (limits missing or exceeded, wrong quantities, disk full), FileExistsError, DeviceError.
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
        """End the run now, or the connecting or arming that is under way. Does nothing when there is none."""
        self._aborts.append(reason)
        self._void_requests()
        if self.state.live or self.state is State.CONNECTING:
            self._make_safe()
        self._wake.set()

    def stop(self, reason: str = "emergency stop") -> None:
        """Emergency stop: a trip, which latches until `reset`. Works in every state."""
        self._make_safe()
        self._interlock.fire(Trip("estop", reason))

    def reset(self) -> None:
        """Acknowledge a trip or failure: a person's. The links are closed; `connect` opens them anew."""
        self._do(self._reset)

    def make_safe(self) -> None:
        """Vent and stop where no run is on, and wait until the device says so. Raises WrongState, DeviceError."""
        self._do(self._confirm_safe)

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
        run = self._run
        for item in items:
            if run is not None:
                run.receive(item)
            self._interlock.receive(link.source.name, item, link.status)
        self.display.put(items)
        self._wake.set()

    def behind(self) -> bool:
        """Whether recorder or interlock cannot follow: the link is then read more slowly."""
        run = self._run
        return (run is not None and run.fill > 0.5) or self._interlock.backlog > BACKLOG

    def lost(self, link: LinkThread, error: Exception) -> None:
        """A link failed: a trip, or a failure where nothing is armed."""
        log.warning("%s: %s", link.source.name, error)
        self._interlock.fire(Trip("link", str(error), link.status.time if link.status else math.nan))

    # The engine's thread ----------------------------------------------------------------------------------------------

    def _serve(self) -> None:
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
            if not future.set_running_or_notify_cancel():
                continue
            try:
                future.set_result(action())
            except (CancelledError, WrongState) as error:
                future.set_exception(self._overtaken() or error)
            except Exception as error:
                future.set_exception(error)
        if not self._stopped() and self.state is State.RUNNING:
            self._drive()

    def _stopped(self) -> bool:
        """Whether a trip or an abort ended the run in this turn."""
        trip = self._interlock.trip
        if trip is not None and self._machine.can("trip"):
            self._end("trip", f"{trip.code}: {trip.message}")
            return True
        reasons = [self._aborts.popleft() for _ in range(len(self._aborts))]
        if reasons and self._machine.can("abort"):
            self._end("abort", reasons[0])
            return True
        return False

    def _overtaken(self) -> WrongState | None:
        """Why what was asked is void: a trip or an abort; None if there is none."""
        if (trip := self._interlock.trip) is not None:
            return Tripped(f"{trip.code}: {trip.message}")
        return Aborted(self._aborts[0]) if self._aborts else None

    def _void_requests(self) -> None:
        """Cancel what was asked of this thread and not begun."""
        for _, future in tuple(self._requests):
            future.cancel()

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
            except CancelledError:
                raise Aborted("a person ended it first") from None
            except BaseException:
                future.cancel()  # nobody waits any more (Ctrl-C): what has not begun must not begin
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
                if self._aborts or self._interlock.trip is not None:
                    raise CancelledError from None
                if time.monotonic() > deadline:
                    raise LinkLost(f"{self.rig.device.name}: the link's thread does not answer") from None

    # Steps ------------------------------------------------------------------------------------------------------------

    def _connect(self, acknowledged: bool) -> None:
        self._machine.fire("connect")
        beat = self._heartbeat.permissions if self._heartbeat is not None else None
        self._links = [LinkThread(source, self, beat) for source in (self.rig.device, *self.rig.sources)]
        for link in self._links:
            link.start()
        try:
            for link in self._links:
                self.identities[link.source.name] = self._await(link.connect(acknowledged=acknowledged), 15.0)
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
        plan.path.parent.mkdir(parents=True, exist_ok=True)
        if fault := self._interlock.short_of_space(plan.path.parent):
            raise ValueError(fault)
        run = ActiveRun(plan, self.rig, lambda why: self._interlock.fire(Trip("recorder", why)))
        self._run, self._outcome = run, Future()
        self._machine.fire("arm")
        try:
            self._wait_for_data()
            self._ask(lambda: device.arm(run.limits))
        except CancelledError:
            raise
        except Exception as error:
            self._end("fail", str(error))
            raise
        names = tuple(link.source.name for link in self._links)
        gappy = frozenset(c.name for source in self.rig.sources for c in source.channels)
        self._interlock.watch(plan.limits, names, run.feeder.commanded, plan.path.parent, gappy)

    def _wait_for_data(self) -> None:
        """Wait until the device has been heard for long enough, and every link once more: a silent one is found now."""
        device = self._links[0]
        before = [(link, link.latest) for link in self._links]
        self._wait_until(lambda: device.latest - device.first >= SETTLE, "deliver samples")
        self._wait_until(lambda: all(link.latest > then for link, then in before), "deliver data on every link")

    def _start(self) -> None:
        self._machine.fire("start")
        self._active.begin(self._now())

    def _pause(self) -> None:
        if not self._machine.can("pause"):
            raise WrongState(f"cannot pause while {self.state}")
        self._active.hold(self._ask, self._held)
        self._active.note("info", "pause", "vented and held", self._now())
        self._machine.fire("pause")

    def _resume(self) -> None:
        self._machine.fire("resume")
        self._active.note("info", "resume", "resumed at the beginning of the interrupted segment", self._now())
        self._active.resume(self._now())

    def _reset(self) -> None:
        self._machine.fire("reset")
        self._interlock.reset()
        self._close_links()

    def _confirm_safe(self) -> None:
        if not self._machine.can("disconnect"):
            raise WrongState(f"cannot make safe while {self.state}")
        self._ask(self.rig.device.make_safe)
        self._wait_until(lambda: self.status is not None and self.status.state == "safe", "say that it is safe")

    def _disconnect(self) -> None:
        self._machine.fire("disconnect")
        self._close_links()

    def _drive(self) -> None:
        """One turn of a running protocol."""
        if self.status is None:
            return
        trip = self._active.drive(self.status, self._ask)
        if trip is not None:
            self._interlock.fire(trip)
        elif self._active.feeder.finished:
            self._end("complete", "")

    # Ends -------------------------------------------------------------------------------------------------------------

    def _end(self, event: str, reason: str) -> None:
        """Leave a run: the one way out of every live state."""
        if not self._machine.can(event):
            return
        self._make_safe()
        state = self._machine.fire(event)
        asked = time.monotonic()
        safe = all([link.wait_safe(max(0.0, asked + SAFE - time.monotonic())) for link in self._links])
        self._interlock.rest()
        if self._run is not None and self._run.recording:
            if not safe:
                self._run.note("error", "unconfirmed", "the device did not confirm that it is safe", self._now())
            outcome = self._run.finish(state, reason, self._links)
            self._outcome.set_result(replace(outcome, trip=self.trip))

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

    def _changed(self, state: State, event: str) -> None:
        log.info("%s: %s -> %s", self.rig.instrument, event, state)
        if self._listener is not None:
            try:
                self._listener(state, event)
            except Exception:  # a listener's fault must not keep a device from being made safe
                log.exception("%s: a listener failed on %s", self.rig.instrument, event)

    # Small things -----------------------------------------------------------------------------------------------------

    @property
    def _active(self) -> ActiveRun:
        assert self._run is not None
        return self._run

    def _now(self) -> float:
        """Device time in s."""
        return self.status.time if self.status is not None else 0.0

    def _held(self) -> Status:
        """The status that says the device holds."""
        self._wait_until(lambda: self.status is not None and self.status.state == "held", "hold")
        assert self.status is not None
        return self.status

    def _wait_until(self, condition: Callable[[], bool], what: str) -> None:
        """Wait, beating, until ``condition`` holds. Raises DeviceError that the instrument does not do ``what``."""
        deadline = time.monotonic() + ANSWER
        while not condition():
            if self._aborts or self._interlock.trip is not None:
                raise CancelledError
            if time.monotonic() > deadline:
                raise DeviceError(f"{self.rig.device.name} does not {what} within {ANSWER:g} s")
            self._tick()
            time.sleep(TICK / 4)
