"""The run engine: takes one instrument through one run at a time, and out of it safely whatever happens."""

from __future__ import annotations

import logging
import math
import time
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import CancelledError, Future
from dataclasses import replace
from typing import TypeVar

from acquire.engine.absence import Absence
from acquire.engine.active import ActiveRun
from acquire.engine.link import LinkThread
from acquire.engine.links import Links
from acquire.engine.loop import ControlLoop
from acquire.engine.plan import Outcome, Progress, RunPlan
from acquire.engine.queues import DisplayQueue
from acquire.engine.rules import Rules, Trip
from acquire.engine.state import State, StateMachine, WrongState
from acquire.supervisor import Heartbeat
from drivers.device import DeviceError, Faulted, Identity, LinkLost, Rig, Status
from drivers.signals import Block, Channel, Frame

log = logging.getLogger(__name__)
T = TypeVar("T")

BACKLOG = 200  # blocks that may wait for the interlock before links are read more slowly
SETTLE = 0.25  # s of device time that must have been heard before arming: a tare is made of it
CONNECT = 15.0  # s of wall time within which a link must be open


class RunEngine(ControlLoop):
    """Runs protocols on one `Rig`; see `StateMachine` for the states.

    Every method may be called from any thread. `connect`, `arm`, `start`, `pause`, `resume`, `reset` and `disconnect`
    are carried out by the engine's own thread and return when done; they raise `WrongState` where the state forbids
    them. `abort` and `stop` (the emergency stop) overtake everything and return at once. Leaving a run on any path
    makes every device safe. A link lost while no run is on is opened anew when it comes back; in a run it trips.

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
        super().__init__(rig.device.name, StateMachine(self._changed), rules or Rules(), heartbeat)
        self.rig = rig
        self.display: DisplayQueue[Block | Frame] = DisplayQueue()
        self.identities: dict[str, Identity] = {}
        self._listener = listener
        self._links = Links(rig, self, heartbeat.permissions if heartbeat is not None else None)
        self._lost: deque[str] = deque()  # links that went away where nothing was live
        self._absence: Absence | None = None
        self._outcome: Future[Outcome] = Future()
        self._run: ActiveRun | None = None
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
        return self._links.status

    @property
    def found(self) -> str:
        """What `connect` found left behind by an earlier host and made safe, in words; '' where all was well."""
        return self._links.found

    @property
    def away(self) -> str:
        """Why no link is open although one was, and when it is tried again, in words; '' where nothing is missing."""
        absence = self._absence
        return absence.words if absence is not None else ""

    @property
    def outcome(self) -> Outcome | None:
        """How the present or the last run ended; None while it has not."""
        return self._outcome.result() if self._outcome.done() else None

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
        return replace(progress, trip=self.trip, dwell=self._interlock.dwell)

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
        self._requests.void()
        if self.state.live or self.state is State.CONNECTING:
            self._links.make_safe()
        self._wake.set()

    def stop(self, reason: str = "emergency stop") -> None:
        """Emergency stop: a trip, which latches until `reset`. Works in every state."""
        self._links.make_safe()
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
        """A link failed: a trip where a person may be attached, else something to try again."""
        log.warning("%s: %s", link.source.name, error)
        if self._machine.can("lose"):
            self._lost.append(str(error))
            self._wake.set()
        else:
            self._interlock.fire(Trip("link", str(error), link.status.time if link.status else math.nan))

    # The engine's thread ----------------------------------------------------------------------------------------------

    def _turn(self) -> None:
        self._tick()
        if self._stopped():
            return
        self._look_for_links()
        self._answer_requests()
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

    def _look_for_links(self) -> None:
        """Where nothing is live: close what a link was lost of, and try it again when that is due."""
        if self._lost and self._machine.can("lose"):
            self._absence = Absence(self._lost[0])
            self._links.close()
            self._machine.fire("lose")
        self._lost.clear()
        if self._absence is not None and self.state is State.IDLE and time.monotonic() >= self._absence.due:
            self._try_again(self._absence)

    def _try_again(self, absence: Absence) -> None:
        before = dict(self.identities)
        self._machine.fire("connect")
        try:
            self._open_links(acknowledged=False)
        except CancelledError:
            self._links.close()
            raise
        except (DeviceError, OSError) as error:
            self._links.close()
            if isinstance(error, Faulted):
                self._end("fail", str(error))
            else:
                absence.failed(str(error))
                self._machine.fire("abort")
            return
        if self.identities != before:
            self._end("fail", f"another instrument answers than before the link was lost: {self.identities}")
            return
        log.warning("%s: the link is back after %.1f s", self._name, time.monotonic() - absence.since)
        self._absence = None
        self._machine.fire("connected")

    def _ask(self, action: Callable[[], T], link: LinkThread | None = None) -> T:
        """Have ``action`` carried out by a link's thread (the device's by default), beating meanwhile."""
        return self._await((link or self._links.device).ask(action))

    # Steps ------------------------------------------------------------------------------------------------------------

    def _connect(self, acknowledged: bool) -> None:
        if self.state is State.READY:
            return  # a lost link has come back meanwhile
        self._machine.fire("connect")
        self._absence = None
        try:
            self._open_links(acknowledged=acknowledged)
        except CancelledError:
            self._links.close()
            raise
        except Exception as error:
            self._end("fail", str(error))
            self._links.close()
            if isinstance(error, DeviceError):
                raise
            raise LinkLost(f"{self._name}: {error}") from error
        self._machine.fire("connected")

    def _open_links(self, *, acknowledged: bool) -> None:
        for name, identity in self._links.open(acknowledged=acknowledged).items():
            self.identities[name] = self._await(identity, CONNECT)

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
        if self._lost:  # between the check and now
            self._interlock.fire(Trip("link", self._lost[0]))
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
        device = self._links.device
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
        self._links.close()

    def _confirm_safe(self) -> None:
        if not self._machine.can("disconnect"):
            raise WrongState(f"cannot make safe while {self.state}")
        self._ask(self.rig.device.make_safe)
        self._wait_until(lambda: self.status is not None and self.status.state == "safe", "say that it is safe")

    def _disconnect(self) -> None:
        if self._absence is None or self.state is not State.IDLE:
            self._machine.fire("disconnect")
        self._absence = None
        self._links.close()

    def _drive(self) -> None:
        """One turn of a running protocol."""
        if self.status is None:
            return
        trip = self._active.drive(self.status, self._ask)
        if trip is not None:
            self._interlock.fire(trip)
        elif self._active.feeder.finished:
            self._end("complete", "")

    def _broken(self, error: Exception) -> None:
        self._end("fail", f"{type(error).__name__}: {error}")

    def _ended(self) -> None:
        self._absence = None
        self._links.close()

    # Ends -------------------------------------------------------------------------------------------------------------

    def _end(self, event: str, reason: str) -> None:
        """Leave a run: the one way out of every live state."""
        if not self._machine.can(event):
            return
        self._absence = None
        self._links.make_safe()
        state = self._machine.fire(event)
        safe = self._links.wait_safe()
        self._interlock.rest()
        if self._run is not None and self._run.recording:
            if not safe:
                self._run.note("error", "unconfirmed", "the device did not confirm that it is safe", self._now())
            outcome = self._run.finish(state, reason, tuple(self._links))
            self._outcome.set_result(replace(outcome, trip=self.trip))

    def _tripped(self, trip: Trip) -> None:
        """The interlock tripped, in whatever thread: stop first, think later."""
        self._links.make_safe()
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
