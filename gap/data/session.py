"""A measuring session: recordings on one clock, their commands as tables, their channels thinned."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from acquire.recording.model import Recording, Series
from gap.data.binning import GROWTH, WIDEST, Bins, bin_edges, bin_means, breaks
from gap.data.command import Command, command
from gap.data.noise import grid_step, high_band_sigma, rounding_floor
from gap.data.slow_noise import WHITE_NOISE, Colour, colour, no_jerks, slow_variance
from sim_devices.chain import FloatArray

REST, LONGEST_REST = 45.0, 3600.0
"""s between recordings whose clocks all begin anew and that do not say when they began (assumed; then the report says
so); and the longest that is simulated: skin has forgotten by then."""
OVERLAP = 1.0
"""s by which a recording may seem to begin before the last one ended: nobody pressed a key at an exact second."""
BEFORE, SHORTLY = 5e-3, 0.2
"""s by which a recording begins before its first row, and within which a command begins with the samples behind it."""
CLOCK_SD = 2e-5
"""How fast the recording's clock may soundly run against the command's: an ordinary crystal (assumed)."""
SKIN = "skin"
HELD = 10.0
"""s for which a recording that begins at a level is taken to have been there: regulators and loops are at rest then;
how long it was, it does not tell (assumed)."""


class Sigma(NamedTuple):
    """Noise of one sample of a channel, SI, which averages as ``quick`` has it, and two parts that averaging does not
    lower: its grid's, and its slow one."""

    white: float
    grid: float
    slow: float
    quick: Colour = WHITE_NOISE

    @property
    def kept(self) -> float:
        """The part that averaging does not lower."""
        return float(np.hypot(self.grid, self.slow))

    def of_mean(self, counts: FloatArray) -> FloatArray:
        """Variance (n,) of means over ``counts`` (n,) samples, without the slow part."""
        return np.asarray(self.white**2 * self.quick.of_mean(counts) / counts + self.grid**2)


def evenly(starts: FloatArray, spans: FloatArray, steps: FloatArray) -> FloatArray:
    """Times (n,) s from each of ``starts`` (k,) s on, a step (k,) s apart, within its span (k,) s: one start after the
    other."""
    counts = np.maximum(np.ceil(spans / steps), 0.0).astype(int)
    which = np.repeat(np.arange(len(starts)), counts)
    place = np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)
    return np.asarray(starts[which] + place * steps[which])


@dataclass(frozen=True)
class Pace:
    """Time ``steps`` (n + 1,) s before, between and behind ``edges`` (n,) s."""

    edges: FloatArray
    steps: FloatArray

    def at(self, time: FloatArray) -> FloatArray:
        """The steps (n,) s at a ``time`` (n,) s."""
        return np.asarray(self.steps[np.searchsorted(self.edges, time, side="right")])

    def nodes(self, begin: float, end: float) -> FloatArray:
        """Times (m,) s from ``begin`` to ``end`` s at this pace."""
        starts = np.concatenate([[begin], self.edges[(self.edges > begin) & (self.edges < end)], [end]])
        return evenly(starts[:-1], np.diff(starts), self.at(0.5 * (starts[1:] + starts[:-1])))


class Session:
    """Recordings in order on the session's clock."""

    def __init__(self, recordings: Sequence[Recording]) -> None:
        self.recordings = tuple(recordings)
        self.shifts, self.own_clocks, self.rests_assumed = _shifts(recordings)
        self._own: dict[int, dict[str, Command]] = {}
        self._paces: dict[tuple[tuple[int, ...], float, float, float], Pace] = {}
        self._set = np.array([self.span(k)[0] for k in range(len(recordings) if self.own_clocks else 1)])

    def clock_age(self, time: FloatArray) -> FloatArray:
        """s, of the shape of ``time`` s, since the recording's clock was set: at the start of the session, or of each
        recording that has a clock of its own."""
        which = np.searchsorted(self._set - OVERLAP, time, side="right") - 1
        age: FloatArray = time - self._set[np.maximum(which, 0)]
        return age

    def time(self, k: int, series: Series) -> FloatArray:
        """Time stamps of a series of recording ``k`` on the session's clock, s."""
        stamps: FloatArray = np.asarray(series.time, dtype=float) + self.shifts[k]
        return stamps

    def span(self, k: int) -> tuple[float, float]:
        """First and last time of recording ``k``, s."""
        times = [s.time for s in self.recordings[k].streams.values() if len(s.time)]
        return min(float(t[0]) for t in times) + self.shifts[k], max(float(t[-1]) for t in times) + self.shifts[k]

    def begin(self, k: int) -> float:
        """When recording ``k`` begins, s: `BEFORE` its command, if that has rows shortly before the first sample. That
        is of its own recording in any case, be the clocks some milliseconds apart."""
        first, tables = self.span(k)[0], self.recordings[k].setpoints.values()
        asked = min((float(t.time[0]) for t in tables if len(t.time)), default=np.inf) + self.shifts[k]
        ended = self.span(k - 1)[1] + BEFORE if k else -np.inf
        return (asked if max(first - SHORTLY, ended) < asked < first else first) - BEFORE

    def command(self, quantity: str, members: Sequence[int]) -> Command:
        """The command over the recordings ``members``, at rest (zero) between them.

        One that begins at another level has been there for `HELD`, or half of the time since the recording before.
        """
        times, values, kinks, late = (list[FloatArray]() for _ in range(4))
        ended = -np.inf
        for k in members:
            own = self._commands(k)[quantity]
            begin, end = self.span(k)
            t, v = own.time + self.shifts[k], own.value
            first, last = min(begin, t[0]), max(end, t[-1])
            if v[0] != 0:
                first -= min(HELD, 0.5 * (first - ended))
                times.append(np.array([first]))
                values.append(np.zeros(1))
                late.append(np.zeros(1))
            kinks.append(np.r_[first, own.kinks + self.shifts[k], last])
            times.append(np.concatenate([[first], t, [last]]))
            values.append(np.concatenate([[v[0]], v, [v[-1]]]))
            late.append(np.concatenate([[0.0], own.late, own.late[-1:]]))
            ended = last
            if v[-1] != 0 and k != members[-1]:
                times.append(times[-1][-1:])
                values.append(np.zeros(1))
                late.append(late[-1][-1:])
        time = np.concatenate(times)
        order = np.argsort(time, kind="stable")
        value, after = (np.concatenate(parts)[order] for parts in (values, late))
        return Command(time[order], value, np.unique(np.concatenate(kinks)), after)

    def binned(
        self,
        channel: str,
        k: int,
        kinks: FloatArray,
        growth: float = GROWTH,
        widest: float = WIDEST,
        ends: Sequence[float] = (),
    ) -> Bins:
        """A channel of recording ``k`` in bins that follow the command's kinks; some end at ``ends`` (s)."""
        series = self.recordings[k].streams[channel]
        time = self.time(k, series)
        dt = float(np.median(np.diff(time)))
        turning, curve_ends = partial(self.turning, k), self._curve_ends(k)
        edges = bin_edges(time[0], time[-1], kinks, dt, growth, widest, turning, curve_ends)
        return bin_means(time, np.asarray(series.value, dtype=float), np.union1d(edges, ends))

    def turning(self, k: int, start: float, stop: float) -> float:
        """How fast the quickest command of recording ``k`` turns between two times of the session, rad/s."""
        shift = self.shifts[k]
        return max((c.turning(start - shift, stop - shift) for c in self._commands(k).values()), default=0.0)

    def pace(self, members: Sequence[int], step: float, turn: float, curve: float = np.inf) -> Pace:
        """Time steps of ``step`` s at most, and of ``curve`` s where a command of the recordings is curved, in which
        none turns by more than ``turn`` rad."""
        asked = (tuple(members), step, turn, curve)
        if asked not in self._paces:
            self._paces[asked] = self._pace(*asked)
        return self._paces[asked]

    def _pace(self, members: Sequence[int], step: float, turn: float, curve: float) -> Pace:
        edges, steps = list[float](), [step]
        for k in members:
            for start, stop in pairwise(self._stretches(k)):
                turning = self.turning(k, start, stop)
                edges += [start, stop]
                steps += [min(step, curve, turn / turning) if turning > 0.0 else step, step]
        return Pace(np.asarray(edges), np.asarray(steps))

    def _stretches(self, k: int) -> list[float]:
        """The kinks of recording ``k``, the ends of its command's curves and its own, s."""
        begin, end = self.span(k)
        kinks = np.concatenate([c.kinks for c in self._commands(k).values()]) + self.shifts[k]
        inside = np.concatenate([kinks, self._curve_ends(k)])
        return sorted({begin, *inside[(inside > begin) & (inside < end)].tolist(), end})

    def _curve_ends(self, k: int) -> FloatArray:
        """Times (m,) s at which curves in the commands of recording ``k`` begin or end smoothly."""
        own = [c.curve_ends for c in self._commands(k).values()]
        return np.asarray(np.concatenate([np.zeros(0), *own]) + self.shifts[k])

    def _commands(self, k: int) -> dict[str, Command]:
        """The commands of recording ``k`` by quantity, on its own clock."""
        if k not in self._own:
            tables = self.recordings[k].setpoints.items()
            self._own[k] = {q: command(np.asarray(t.time, float), np.asarray(t.value, float)) for q, t in tables}
        return self._own[k]

    @property
    def sampled(self) -> bool:
        """Whether some command was sampled on its way, so that a controller may hold its rows."""
        return any(np.any(c.late > 0.0) for k in range(len(self.recordings)) for c in self._commands(k).values())

    def breaks(self, channel: str, k: int) -> FloatArray:
        """Times (m,) s at which a channel of recording ``k`` jumps."""
        series = self.recordings[k].streams[channel]
        value = np.asarray(series.value, dtype=float)
        good = np.isfinite(value)
        return breaks(self.time(k, series)[good], value[good], high_band_sigma(value))

    def sigma(self, channel: str, members: Sequence[int], kinks: FloatArray) -> Sigma:
        """Noise of one sample of a channel in recordings ``members``; the command has ``kinks`` (k,) s.

        Its slow part may be too slow for few and short recordings to tell: all of the session may tell more.
        """
        noise = [self.recordings[k].streams[channel].noise for k in members]
        runs, every = self._runs(channel, members), self._runs(channel, range(len(self.recordings)))
        stated = [n for n in noise if n > 0]
        white = float(np.median(stated or [high_band_sigma(v) for _, v in runs]))
        step = max(grid_step(v) for _, v in runs)
        if stated and white < step / np.sqrt(12.0):  # of the sensor, before its values were rounded
            white = float(np.hypot(white, step / np.sqrt(12.0)))
        quick = colour(every, kinks, white)
        asked = [runs] if len(runs) == len(every) else [runs, every]
        slow = max(slow_variance(some, kinks, white, quick) for some in asked)
        return Sigma(white, rounding_floor(white, step), float(np.sqrt(slow)), quick)

    def _runs(self, channel: str, members: Sequence[int]) -> list[tuple[FloatArray, FloatArray]]:
        """Time and value (n,) of a channel in those of recordings ``members`` that have it."""
        series = [(k, self.recordings[k].streams.get(channel)) for k in members]
        return [(self.time(k, s), np.asarray(s.value, dtype=float)) for k, s in series if s is not None]

    def sigmas(self, channels: Sequence[str], members: Sequence[int], kinks: FloatArray) -> Sequence[Sigma]:
        """The same of several channels, alike where there are three or more: one that jerks is no noisier than they."""
        noise = [self.sigma(c, members, kinks) for c in channels]
        slow = no_jerks([(n.white, n.slow) for n in noise])
        return [n._replace(slow=kept) for n, kept in zip(noise, slow, strict=True)]


def _shifts(recordings: Sequence[Recording]) -> tuple[FloatArray, bool, bool]:
    """The shift of each recording's clock; whether each has a clock of its own; and whether the rests between them are
    not known, as they do not say when they began."""
    spans = []
    for r in recordings:
        times = [np.asarray(s.time, dtype=float) for s in r.streams.values() if len(s.time)]
        spans.append((min(float(t[0]) for t in times), max(float(t[-1]) for t in times)))
    own = any(b[0] < a[1] for a, b in pairwise(spans))
    shifts = np.zeros(len(recordings))
    if not own:
        return shifts, False, False
    rests = _rests([r.info.start_time for r in recordings], [end - begin for begin, end in spans])
    at = 0.0
    for k, (begin, end) in enumerate(spans):
        shifts[k] = at - begin
        at += end - begin + (REST if rests is None else rests[min(k, len(rests) - 1)])
    return shifts, True, rests is None


def _rests(started: Sequence[str], lasted: Sequence[float]) -> list[float] | None:
    """Rests (n − 1) s between n recordings that ``started`` then (ISO 8601) and ``lasted`` so many s; None where one
    does not say, or they contradict each other, as recordings of a simulation that ran faster than time do."""
    try:
        begun = [datetime.fromisoformat(text) for text in started]
        apart = [(b - a).total_seconds() for a, b in pairwise(begun)]
    except (ValueError, TypeError):  # no time, or with a time zone and without
        return None
    rests = [gap - length for gap, length in zip(apart, lasted, strict=False)]
    return None if min(rests) < -OVERLAP else [min(max(rest, 0.0), LONGEST_REST) for rest in rests]
