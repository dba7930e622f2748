"""The run engine: takes one instrument through one run at a time, and out of it safely whatever happens."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Sequence
from concurrent.futures import CancelledError, Future
from dataclasses import replace

from acquire.engine.active import ActiveRun
from acquire.engine.connection import Connection
from acquire.engine.course import Course
from acquire.engine.link import LinkThread
from acquire.engine.plan import Outcome, Progress, RunPlan
from acquire.engine.queues import DisplayQueue
from acquire.engine.rules import Rules, Trip
from acquire.engine.state import State, StateMachine, WrongState
from acquire.supervisor import Heartbeat
from drivers.device import Refused, Rig, Status
from drivers.signals import Block, Frame
from protocols import specimens

log = logging.getLogger(__name__)

UNSEEN = "NOT SEEN TO BE SAFE: vent by hand or pull the plug"
"""Said of a device that did not confirm that it vented and stopped; its own watchdog may have."""
BACKLOG = 200  # blocks that may wait for the interlock before links are read more slowly


class RunEngine(Connection):
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
        super().__init__(rig, StateMachine(self._changed), rules or Rules(), heartbeat)
        self.display: DisplayQueue[Block | Frame] = DisplayQueue()
        self._listener = listener
        self._outcome: Future[Outcome] = Future()
        self._run: ActiveRun | None = None
        self._thread.start()
        self._interlock.start()

    # For anybody to ask -----------------------------------------------------------------------------------------------

    @property
    def trip(self) -> Trip | None:
        """The trip that is latched."""
        return self._interlock.trip

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

    @property
    def course(self) -> Course | None:
        """The command of the present or the last run in device time; another object wherever the plan moved."""
        return self._run.course if self._run is not None else None

    # For a person, a program or a window to do ------------------------------------------------------------------------

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

    # Called by the links' threads -------------------------------------------------------------------------------------

    def receive(self, link: LinkThread, items: Sequence[Block | Frame]) -> None:
        """Hand on new data: recorder first, then interlock, then screens."""
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

    # Steps ------------------------------------------------------------------------------------------------------------

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
        specimen = plan.info.specimen
        flags = specimens.yields(specimen), specimen != specimens.MANOMETER
        self._interlock.watch(plan.limits, names, run.feeder.commanded, plan.path.parent, gappy, *flags)

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

    def _drive(self) -> None:
        """One turn of a running protocol."""
        if self.status is None:
            return
        try:
            trip = self._active.drive(self.status, self._ask)
        except Refused as error:
            # A device that takes no more of a run has left it: its own fault arrives with the next samples.
            trip = Trip("device", str(error), self._now())
        if trip is not None:
            self._interlock.fire(trip)
        elif self._active.feeder.finished:
            self._end("complete", "")

    def _broken(self, error: Exception) -> None:
        self._end("fail", f"{type(error).__name__}: {error}")

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
                reason = f"{reason}; {UNSEEN}".lstrip("; ")
            outcome = self._run.finish(state, reason, tuple(self._links))
            self._outcome.set_result(replace(outcome, trip=self.trip, safe=safe))

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
