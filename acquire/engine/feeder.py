"""Which segments the device gets next, and the set-points so far: no threads, no clocks, no links.

The device numbers segments from its last ``start``. The feeder knows which protocol segment each number is, keeps the
device's queue filled, and writes down when every segment really began and ended, in device time: an ``until`` or a
pause makes that differ from the compiled table.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from drivers.device import Status
from drivers.signals import FloatArray
from protocols.setpoints import Segment, Setpoints

Values = dict[str, float]


@dataclass(frozen=True)
class Executed:
    """A segment, or a part of one, as the device executed it: from ``begin`` to ``end`` s of device time."""

    index: int  # of the protocol segment; -1 for a lead-in after a pause
    begin: float
    end: float
    start: Values
    finish: Values


class Feeder:
    """Feeds one protocol to one device and follows it through ``until`` conditions and pauses."""

    def __init__(self, setpoints: Setpoints, capacity: int, rest: Mapping[str, float], rates: Mapping[str, float]):
        """``rest`` is the value of each quantity when vented or centred; ``rates`` (SI/s) limit the lead-in."""
        if not setpoints.segments:
            raise ValueError("the protocol has no segments")
        if capacity < 1:
            raise ValueError(f"a device queue of {capacity} segments cannot be fed")
        self._all = setpoints.segments
        self._capacity = capacity
        self.rest = self._rest = {q: float(rest.get(q, 0.0)) for q in setpoints.quantities}
        self._rates = dict(rates)
        self.done: list[Executed] = []
        self.shifted = False  # whether `remaining` moved in time since somebody last cleared this
        self._restart(0)

    def _restart(self, first: int) -> None:
        self._fed: list[tuple[int, Segment]] = []  # (protocol index, segment as sent) since the last start
        self._ended = 0  # of those, how many have ended
        self._clock = math.nan  # device time at which segment number `_ended` began
        self._skipping = False
        lead = self._lead_in(self._all[first].start) if first < len(self._all) else None
        self._waiting: list[tuple[int, Segment]] = [(-1, lead)] if lead is not None and self.done else []
        self._next = first
        self.shifted = True
        self._known: tuple[Executed, ...] = tuple(self.done[-1:])

    def _lead_in(self, target: Mapping[str, float]) -> Segment | None:
        """The way from rest to ``target`` at the allowed rate; None if there is none to go."""
        jumps = {q: abs(target[q] - self._rest[q]) for q in self._rest}
        if not any(jumps.values()):
            return None
        # A rate limit on the probe as a whole bounds the length of the way, which the sum of its parts exceeds.
        whole = self._rates.get("probe")
        durations = [jumps[q] / self._rates[q] for q in jumps if q in self._rates]
        if whole is not None:
            durations.append(math.hypot(*(j for q, j in jumps.items() if q.startswith("probe_"))) / whole)
        return Segment(max(durations, default=0.0), dict(self._rest), dict(target), "load", "resume")

    # To be sent -------------------------------------------------------------------------------------------------------

    def feed(self) -> list[Segment]:
        """The segments to enqueue now. Nothing is sent behind an ``until`` segment before that one has ended."""
        sent: list[Segment] = []
        while len(self._fed) - self._ended < self._capacity and not self._barrier():
            if self._waiting:
                index, segment = self._waiting.pop(0)
            elif self._next < len(self._all):
                index, segment = self._next, self._join(self._all[self._next])
                self._next += 1
            else:
                break
            self._fed.append((index, segment))
            sent.append(segment)
        self._known = tuple(self._pieces())
        return sent

    def _barrier(self) -> bool:
        return len(self._fed) > self._ended and self._fed[-1][1].until is not None

    def _join(self, segment: Segment) -> Segment:
        """``segment`` from the value that was reached, where an ``until`` ended the one before it early."""
        if self.done and self._next == self.done[-1].index + 1 and self._all[self._next - 1].until is not None:
            return replace(segment, start=self.done[-1].finish)
        return segment

    # Said by the device ----------------------------------------------------------------------------------------------

    def follow(self, status: Status) -> None:
        """Take in a status that the device sent after ``start``."""
        if status.executed > len(self._fed):
            raise ValueError(f"the device says it executed {status.executed} segments but got {len(self._fed)}")
        if status.executed == 0 and not math.isfinite(status.began):
            return  # on its way to the first segment
        began = status.began if math.isfinite(status.began) else status.time
        fresh = self._fed[self._ended : status.executed]
        if not math.isfinite(self._clock):
            self._clock = began - sum(segment.duration for _, segment in fresh)
        for number, (index, segment) in enumerate(fresh):
            # Those that ended unseen took their duration; the last one ended when the running one began, which is
            # earlier where it was skipped (a skipped one is the last that was fed, hence the last that ended).
            last = number == len(fresh) - 1 and status.state == "running"
            end = began if last else self._clock + segment.duration
            self._write(index, segment, self._clock, end)
            self._clock = end
            self._skipping = False
            self.shifted |= segment.until is not None
        self._ended += len(fresh)
        self._known = tuple(self._pieces())

    def _write(self, index: int, segment: Segment, begin: float, end: float) -> None:
        whole = segment.until is None or segment.duration == 0
        part = 1.0 if whole else min(1.0, max(0.0, (end - begin) / segment.duration))
        finish = {q: v + part * (segment.end[q] - v) for q, v in segment.start.items()} if part < 1 else segment.end
        self.done.append(Executed(index, begin, end, dict(segment.start), dict(finish)))

    def interrupt(self, time: float) -> None:
        """The device was made to hold at device time ``time``; the running segment will be repeated from its start."""
        if self._ended < len(self._fed) and math.isfinite(self._clock) and time > self._clock:
            index, segment = self._fed[self._ended]
            part = min(1.0, (time - self._clock) / segment.duration) if segment.duration > 0 else 1.0
            reached = {q: v + part * (segment.end[q] - v) for q, v in segment.start.items()}
            self.done.append(Executed(index, self._clock, time, dict(segment.start), reached))
        self._restart(self.index)

    # Where it stands --------------------------------------------------------------------------------------------------

    @property
    def index(self) -> int:
        """Protocol index of the running (or next) segment; the number of segments when all have ended."""
        for number in range(self._ended, len(self._fed)):
            if self._fed[number][0] >= 0:
                return self._fed[number][0]
        return self._next

    @property
    def finished(self) -> bool:
        """Whether every segment has ended."""
        return self._ended == len(self._fed) and not self._waiting and self._next == len(self._all)

    @property
    def watched(self) -> Segment | None:
        """The running segment if it has an ``until`` that has not been met yet."""
        if self._skipping or self._ended >= len(self._fed) or not math.isfinite(self._clock):
            return None
        segment = self._fed[self._ended][1]
        return segment if segment.until is not None else None

    @property
    def began(self) -> float:
        """Device time in s at which the running segment began; not a number before the first status."""
        return self._clock

    def overdue(self, time: float) -> float:
        """By how much (s) the running segment should have ended before device time ``time``; negative if it need not.

        An ``until`` ends a segment early, never late.
        """
        if self._ended >= len(self._fed) or not math.isfinite(self._clock):
            return -math.inf
        return time - self._clock - self._fed[self._ended][1].duration

    def skipped(self) -> None:
        """The device was told to skip the running segment: it is not watched any longer."""
        self._skipping = True

    def commanded(self, time: FloatArray, status: Status | None = None) -> dict[str, FloatArray]:
        """Set-points at device times ``time`` (n,) s; NaN where the host cannot know (long ago, not yet, or paused).

        Nor can it where ``status``, which came with the samples of these times, is ahead of the followed segments:
        the device may have been told to skip or to hold. While it is armed everything is at rest.
        May be called from another thread: it reads one snapshot.
        """
        armed = status is not None and status.state == "armed"
        out = {q: np.full(np.shape(time), rest if armed else np.nan) for q, rest in self._rest.items()}
        if armed or (status is not None and (status.state != "running" or status.executed != self._ended)):
            return out
        for piece in self._known:
            inside = (time >= piece.begin) & (time < piece.end)
            if inside.any():
                part = (time[inside] - piece.begin) / (piece.end - piece.begin)
                for q in out:
                    out[q][inside] = piece.start[q] + part * (piece.finish[q] - piece.start[q])
        return out

    def executed(self, first: float, last: float) -> Setpoints:
        """The command from device time ``first`` to ``last``: at rest before, after and while paused."""
        segments: list[Segment] = []
        moment, value = first, self._rest
        for piece in self.done:
            if piece.begin > moment:
                segments.append(Segment(piece.begin - moment, self._rest, self._rest, "rest"))
            about = self._all[piece.index] if piece.index >= 0 else Segment(0.0, {}, {}, "load", "resume")
            length = max(0.0, piece.end - piece.begin)
            segments.append(replace(about, duration=length, start=piece.start, end=piece.finish, until=None))
            moment, value = piece.end, piece.finish
        if value != self._rest or last > moment:
            segments.append(Segment(max(0.0, last - moment), self._rest, self._rest, "rest"))
        return Setpoints(tuple(segments))

    def remaining(self) -> Setpoints:
        """The plan from the running segment's beginning on, every ``until`` running to its longest."""
        fed = [segment for _, segment in (*self._fed[self._ended :], *self._waiting)]
        return Setpoints((*fed, *self._all[self._next :]))

    def _pieces(self) -> Iterator[Executed]:
        """The last executed pieces and the running one, as planned."""
        yield from self.done[-8:]
        moment = self._clock
        if not math.isfinite(moment):
            return
        for index, segment in self._fed[self._ended :]:
            yield Executed(index, moment, moment + segment.duration, dict(segment.start), dict(segment.end))
            if segment.until is not None:
                return
            moment += segment.duration
