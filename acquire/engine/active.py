"""One armed run: its feeding, its following, its recording. States, links and stops are the engine's."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, Protocol, TypeVar

import numpy as np

from acquire.engine.course import Course
from acquire.engine.feeder import Feeder
from acquire.engine.link import LinkThread
from acquire.engine.plan import Outcome, Progress, RunPlan
from acquire.engine.recorder import Commanded, Recorder
from acquire.engine.rules import Trip
from acquire.engine.state import State
from acquire.recording import Event
from acquire.words import reading
from drivers.device import Rig, Status
from drivers.signals import Block, Frame
from protocols.limits import RELIEF, limited
from protocols.setpoints import Setpoints, Until

T = TypeVar("T")
TAIL = 3.0  # s of wall time without a word from a link after which its tail is not waited for any longer
LONGEST_TAIL = 30.0  # s of wall time for the tail altogether
START = 5.0  # s of wall time within which a device begins after it was told to start
LATE = 0.5  # s of device time by which a segment may end late

_COMPARE: dict[str, Callable[[Any, float], Any]] = {
    "<": np.less,
    "<=": np.less_equal,
    ">": np.greater,
    ">=": np.greater_equal,
}


class Ask(Protocol):
    """Have something carried out by the device's link thread."""

    def __call__(self, action: Callable[[], T]) -> T:
        """The result of ``action``."""


class ActiveRun:
    """State of a run between ``arm`` and its outcome."""

    def __init__(self, plan: RunPlan, rig: Rig, on_failure: Callable[[str], None]) -> None:
        """Checks the plan and opens its journal.

        Raises ValueError (limits missing or exceeded, wrong quantities), FileExistsError, OSError.
        """
        device, channels = rig.device, tuple(c for source in (rig.device, *rig.sources) for c in source.channels)
        if set(plan.setpoints.quantities) != set(device.quantities):
            raise ValueError(
                f"the protocol commands {', '.join(plan.setpoints.quantities) or 'nothing'}; "
                f"{device.name} is commanded by {', '.join(device.quantities)}"
            )
        for violation in plan.limits.violations(plan.setpoints):
            where = f"step {violation.step}: " if violation.step else ""
            raise ValueError(f"{where}{violation.quantity}: {violation.message}")
        self.plan = plan
        self.feeder = Feeder(plan.setpoints, device.queue_capacity, plan.rest, plan.limits.rates())
        known = limited({*device.quantities, *(c.name for c in channels)})
        self.limits = {n: r for n, r in plan.limits.ranges.items() if n in known and r.bounded}
        self.recording = True
        self.course: Course | None = None  # None until the device has begun; another one wherever the plan moved
        self._device = device
        self._discarded = {source.name: source.discarded for source in (device, *rig.sources)}
        self._recorder = Recorder(plan.path, plan.info, channels, on_failure, plan.frame_scale, region=plan.region)
        self._recorder.start()
        self._first = math.nan  # device time of `begin`
        self._start_at = math.nan  # device time at which the queue is to be started; NaN when it need not be
        self._started = False  # the device was told to start, and not to hold since
        self._start_told = math.nan  # wall time of that
        self._rest_began = -math.inf  # device time since when it holds, vented
        self._heard = False  # it has said that it runs
        self._arrived: deque[Block] = deque(maxlen=256)  # for `until` conditions

    # Data -------------------------------------------------------------------------------------------------------------

    def receive(self, item: Block | Frame) -> None:
        """Record the data of a link. Called by the links' threads."""
        if self.recording:
            self._recorder.put(item)
            if isinstance(item, Block):
                self._arrived.append(item)

    @property
    def fill(self) -> float:
        """How full the recorder's queue is, 0 … 1."""
        return self._recorder.fill

    def note(self, level: str, code: str, text: str, moment: float) -> None:
        """Record an event at device time ``moment`` (s)."""
        self._recorder.put(Event(moment, level, code, text))

    # Course -----------------------------------------------------------------------------------------------------------

    def begin(self, now: float) -> None:
        """The protocol is to start after the baseline; ``now`` is device time in s."""
        self._first = now
        self._start_at = now + self.plan.baseline

    def resume(self, now: float) -> None:
        """The protocol is to go on, after a rest that ends the dwell."""
        self._start_at = max(now, self._rest_began + RELIEF)

    def hold(self, ask: Ask, held: Callable[[], Status]) -> None:
        """Vent and wait; ``held()`` waits for the status that says so."""
        self._start_at = math.nan
        if not self._started:
            return
        ask(self._device.hold)
        status = held()
        self.feeder.follow(status)
        # Where the device does not say when it was stopped, its first word of it is the best there is.
        told = math.isfinite(status.began) and status.began > self.feeder.began
        self._rest_began = status.began if told else status.time
        self.feeder.interrupt(self._rest_began)
        self._set_course(None)
        self._started = self._heard = False

    def drive(self, status: Status, ask: Ask) -> Trip | None:
        """One turn: start a device that waits for it, follow the device, keep its queue filled.

        The result is a trip if the device left the run by itself; whether the run is over says ``feeder.finished``.
        """
        device, feeder = self._device, self.feeder
        if not self._started:
            if status.time >= self._start_at:
                segments = feeder.feed()
                ask(lambda: device.enqueue(segments))
                ask(device.start)
                self._started, self._heard = True, False
                self._start_told = time.monotonic()
                self._start_at = math.nan
            return None
        self._heard = self._heard or status.state == "running"
        if self._heard:
            feeder.follow(status)
        if not math.isfinite(feeder.began) and time.monotonic() - self._start_told > START:
            return Trip("device", f"{device.name} does not start within {START:g} s", status.time)
        if not self._heard or feeder.finished:
            return None
        if status.state != "running":
            text = status.fault or "it stopped by itself (heartbeat missed, or its own safety)"
            return Trip("device", f"{device.name}: {text}", status.time)
        if feeder.overdue(status.time) > LATE:
            return Trip("device", f"{device.name}: segment {feeder.index} does not end when it should", status.time)
        self._look_for_until(ask)
        if segments := feeder.feed():
            ask(lambda: device.enqueue(segments))
        if feeder.shifted and math.isfinite(feeder.began):
            # The journal's set-points stay true: written anew wherever the plan moved in time.
            feeder.shifted = False
            remaining = feeder.remaining()
            self._recorder.put(Commanded(remaining, feeder.began))
            self._set_course(remaining)
        return None

    def _set_course(self, ahead: Setpoints | None) -> None:
        """``ahead`` goes on from the running segment's beginning; None where nothing does, or nobody knows when."""
        feeder = self.feeder
        began = feeder.began if ahead is not None else math.nan
        self.course = Course(tuple(feeder.done), began, ahead or Setpoints(()), feeder.rest)

    def _look_for_until(self, ask: Ask) -> None:
        feeder, watched = self.feeder, self.feeder.watched
        while self._arrived:
            block = self._arrived.popleft()
            if watched is None or watched.until is None or watched.until.channel not in block.values:
                continue
            met = _COMPARE[watched.until.comparison](block.values[watched.until.channel], watched.until.value)
            met &= block.time >= feeder.began
            if met.any():
                ask(self._device.skip)
                feeder.skipped()
                self.note("info", "until", _words(watched.until), float(block.time[met.argmax()]))
                watched = None

    def progress(self, state: State, now: float) -> Progress:
        """Where the run stands at device time ``now`` (s)."""
        feeder, segments, edges = self.feeder, self.plan.setpoints.segments, self.plan.setpoints.edges
        index = min(feeder.index, len(segments) - 1)
        segment = segments[index]
        within = min(max(now - feeder.began, 0.0), segment.duration) if math.isfinite(feeder.began) else 0.0
        return Progress(
            state=state,
            segment=index,
            segments=len(segments),
            phase=segment.phase,
            step=segment.step,
            labels=segment.labels,
            elapsed=float(edges[-1] if feeder.finished else edges[index] + within),
            duration=float(edges[-1]),
            segment_left=segment.duration - within,
            device_time=now,
            lost=self._recorder.lost,
            recorder_fill=self._recorder.fill,
            written=self._recorder.written,
        )

    # End --------------------------------------------------------------------------------------------------------------

    def finish(self, state: State, reason: str, links: Sequence[LinkThread]) -> Outcome:
        """Record the venting, write the recording, say how it all ended. The device is safe already."""
        status = links[0].status
        ended = status.time if status is not None else 0.0
        if state is not State.COMPLETED:
            self.feeder.interrupt(ended)
            self.note("trip" if state is State.TRIPPED else "warning", str(state), reason, ended)
        self._set_course(None)
        _wait_for(links, ended + self.plan.tail)
        self.recording = False
        self._tell_discarded(links, ended)
        if self.feeder.done:
            first = min(self._first, self.feeder.done[0].begin)
            self._recorder.put(Commanded(self.feeder.executed(first, ended + self.plan.tail), first))
        path, journal = None, None
        try:
            path = self._recorder.finish(str(state), reason).result()
        except Exception as error:
            journal = self._recorder.journal if self._recorder.journal.exists() else None
            reason = f"{reason}; the recording could not be written: {error}".lstrip("; ")
            # Nobody may take a run for done of which there is no recording.
            state = State.FAILED if state is State.COMPLETED else state
        self._recorder.join()
        return Outcome(state, reason, path, journal, lost=self._recorder.lost)

    def _tell_discarded(self, links: Sequence[LinkThread], moment: float) -> None:
        for name, source in ((link.source.name, link.source) for link in links):
            if count := source.discarded - self._discarded.get(name, 0):
                text = f"{name}: {count} bytes that made no valid message (checksum, length) were discarded"
                self._recorder.put(Event(moment, "warning", "discarded", text, count))


def _wait_for(links: Sequence[LinkThread], moment: float) -> None:
    """Wait until every link delivered data up to device time ``moment`` (s), is lost, or has fallen silent."""
    began = time.monotonic()
    seen = {link: (link.latest, began) for link in links}
    waiting = set(links)
    while waiting and time.monotonic() - began < LONGEST_TAIL:
        now = time.monotonic()
        for link in tuple(waiting):
            latest, since = seen[link]
            if link.latest != latest:
                seen[link] = (link.latest, now)
            elif now - since > TAIL:
                waiting.discard(link)
            if link.error is not None or link.latest >= moment:
                waiting.discard(link)
        time.sleep(0.005)


def _words(until: Until) -> str:
    return f"{until.channel} {until.comparison} {reading(until.channel, until.value)}"
