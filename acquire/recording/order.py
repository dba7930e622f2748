"""Samples in the order in which they were taken, each once: whatever order and number a link delivered them in.

A link may repeat a message, deliver it late, or lose it. In a recording the sequence numbers of a channel rise and its
device time never goes back, and events tell the corrections:

=============  ========================================================================================
``lost``       sequence numbers that never came
``duplicate``  samples that came again, equal in every value: left out, nothing is lost by it
``late``       samples that came after later ones: put in their place
``conflict``   samples whose number came before with other values: left out, the first to come stays
``misdated``   samples whose device time contradicts their number, or is no number: left out
=============  ========================================================================================
"""

from __future__ import annotations

import bisect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from acquire.recording.model import Event, FloatArray, Frames, Series

IntArray = NDArray[np.int64]
MOST_GAPS = 200  # gaps told one by one; the others in one event

#: Whether the samples at two sets of positions (in the order of arrival) are equal in every value.
Equal = Callable[[IntArray, IntArray], NDArray[np.bool_]]


@dataclass(frozen=True)
class Arrangement:
    """Which samples to keep, as positions in the order of arrival, and how many were of which kind."""

    kept: IntArray
    gaps: tuple[tuple[float, int], ...]  # device time after the gap in s, samples lost in it
    duplicate: int
    late: int
    conflict: int
    misdated: int

    @property
    def whole(self) -> bool:
        """Whether nothing was left out but duplicates."""
        return not self.conflict and not self.misdated

    def events(self, names: str, time: FloatArray) -> list[Event]:
        """The fate of the samples of ``names``, whose kept device times are ``time``."""
        told = [Event(t, "warning", "lost", f"{n} samples of {names} are lost", n) for t, n in self.gaps[:MOST_GAPS]]
        if more := self.gaps[MOST_GAPS:]:
            count = sum(n for _, n in more)
            text = f"{count} samples of {names} are lost in {len(more)} more gaps"
            told.append(Event(more[0][0], "warning", "lost", text, count))
        end = float(time[-1]) if len(time) else 0.0
        words = {
            "duplicate": "came twice and were left out once",
            "late": "came late and were put in their place",
            "conflict": "came again with other values and were left out",
            "misdated": "bear a time that contradicts their number and were left out",
        }
        for code, what in words.items():
            if count := getattr(self, code):
                told.append(Event(end, "warning", code, f"{count} samples of {names} {what}", count))
        return told


def arrange(seq: IntArray, time: FloatArray, equal: Equal) -> Arrangement:
    """How samples that came as ``seq`` (n,) at device times ``time`` (n,) s are to be ordered."""
    order = np.argsort(seq, kind="stable").astype(np.int64)
    again = np.flatnonzero(np.diff(seq[order]) == 0) + 1  # places in `order` whose number was there before
    first = order[np.searchsorted(seq[order], seq[order][again])]
    same = (time[order[again]] == time[first]) & equal(order[again], first)
    fresh = np.delete(order, again)
    known = np.maximum.accumulate(seq) if len(seq) else seq
    late = int(np.sum(seq[np.sort(fresh)] < known[np.sort(fresh)]))
    kept = fresh[_rising(time[fresh])]
    jumps = np.diff(seq[kept]) - 1
    gaps = np.flatnonzero(jumps > 0)
    return Arrangement(
        kept,
        tuple((float(time[kept][g + 1]), int(jumps[g])) for g in gaps),
        duplicate=int(np.sum(same)),
        late=late,
        conflict=int(np.sum(~same)),
        misdated=len(fresh) - len(kept),
    )


def ordered(streams: Mapping[str, Series], *, tell: bool = True) -> tuple[dict[str, Series], list[Event], bool]:
    """``streams`` with their samples in order, the corrections, and whether nothing was left out.

    Channels that share their stamps (the same arrays) are arranged together; those without a counter are left alone.
    Without ``tell`` only channels whose time goes back are arranged and told.
    """
    groups: dict[tuple[int, int], list[str]] = {}
    for name, series in streams.items():
        if series.seq is not None and (tell or np.any(np.diff(series.time) < 0)):
            groups.setdefault((id(series.time), id(series.seq)), []).append(name)
    result, events, whole = dict(streams), [], True
    for names in groups.values():
        first = streams[names[0]]
        assert first.seq is not None, "only such are in a group"
        plan = arrange(first.seq, first.time, _equal([streams[name].value for name in names]))
        whole &= plan.whole
        events += plan.events(", ".join(names), first.time[plan.kept])
        if not np.array_equal(plan.kept, np.arange(len(first.time))):
            seq, time = first.seq[plan.kept], first.time[plan.kept]
            host = None if first.time_host is None else first.time_host[plan.kept]
            for name in names:
                value = streams[name].value[plan.kept]
                result[name] = replace(streams[name], value=value, time=time, seq=seq, time_host=host)
    return result, events, whole


def ordered_frames(frames: Frames) -> tuple[Frames, list[Event], bool]:
    """As `ordered`, for camera frames."""
    assert frames.seq is not None, "frames of a journal are counted"

    def equal(a: IntArray, b: IntArray) -> NDArray[np.bool_]:
        pairs = zip(a.tolist(), b.tolist(), strict=True)
        return np.array([np.array_equal(frames.data[i], frames.data[j]) for i, j in pairs], bool)

    plan = arrange(frames.seq, frames.time, equal)
    events = plan.events("frames", frames.time[plan.kept])
    if not np.array_equal(plan.kept, np.arange(len(frames.time))):
        frames = replace(
            frames, data=frames.data.take(plan.kept), time=frames.time[plan.kept], seq=frames.seq[plan.kept]
        )
    return frames, events, plan.whole


class Missing:
    """Counts, while samples arrive, the numbers that have not come yet; a late one is no longer missing."""

    def __init__(self) -> None:
        self.count = 0
        self._next: int | None = None
        self._gaps: list[tuple[int, int]] = []  # first missing number and the one after the last, ascending

    def take(self, seq: IntArray) -> None:
        """The numbers (n,) of samples that arrived."""
        if self._next is None and len(seq):
            self._next = int(seq[0])
        if len(seq) and seq[0] == self._next and np.all(np.diff(seq) == 1):
            self._next = int(seq[-1]) + 1
            return
        for number in seq.tolist():
            assert self._next is not None, "set with the first number"
            if number >= self._next:
                if number > self._next:
                    self._gaps.append((self._next, number))
                    self.count += number - self._next
                self._next = number + 1
            else:
                self._fill(number)

    def _fill(self, number: int) -> None:
        place = bisect.bisect_right(self._gaps, number, key=lambda gap: gap[0]) - 1
        if place < 0 or number >= self._gaps[place][1]:
            return  # it came before
        first, after = self._gaps[place]
        self._gaps[place : place + 1] = [g for g in ((first, number), (number + 1, after)) if g[0] < g[1]]
        self.count -= 1


def _equal(values: Sequence[FloatArray]) -> Equal:
    def equal(a: IntArray, b: IntArray) -> NDArray[np.bool_]:
        # Bit by bit: a value that is no number equals itself here.
        same: NDArray[np.bool_] = np.all(
            [value[a].view(np.int64) == value[b].view(np.int64) for value in values], axis=0
        )
        return same

    return equal


def _rising(time: FloatArray) -> IntArray:
    """Positions (ascending) of the longest part of ``time`` that never goes back."""
    if np.all(np.isfinite(time)) and not np.any(np.diff(time) < 0):
        return np.arange(len(time))
    ends: list[float] = []  # least end of a rising part of each length
    last: list[int] = []  # where that part ends
    before = np.full(len(time), -1, np.int64)
    for position, moment in enumerate(time.tolist()):
        if not np.isfinite(moment):
            continue
        length = bisect.bisect_right(ends, moment)
        ends[length : length + 1] = [moment]
        last[length : length + 1] = [position]
        before[position] = last[length - 1] if length else -1
    chosen: list[int] = []
    position = last[-1] if last else -1
    while position >= 0:
        chosen.append(position)
        position = int(before[position])
    return np.array(chosen[::-1], np.int64)
