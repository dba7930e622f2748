"""Commands: tables of set-points without the rows that straight lines between neighbours give, and their kinks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from sim_devices.chain import FloatArray

COLLINEAR = 2e-5
"""Of a command's range: how far a row that is left out may be from the straight line that takes its place."""
DENSE = 50
"""Rows of an even table from which on a change between two of them is a step, not a ramp between them."""
EVEN, ROUNDED, MOSTLY = 2e-3, 1e-3, 0.8
"""Of the usual time between rows, and s: how far one may be off it, by its clock and by rounding to ms; and in which
share of a table. Rows that somebody chose, the corners of a protocol, are meant as they stand."""
STEP = 0.02
"""Of a command's range: the least change between two rows of a dense table that may be a step."""
ON_ITS_WAY = 0.2
"""Of a step: the most that the command moves in the interval before or behind it."""
HALF_WAY, RESTS, AT_REST = 0.02, 4.0, 0.02
"""Of a step: how far from half-way a row is that was sampled on its way, how many times more than rows beyond it moves,
and the most that these do."""
NEAR, AROUND = 0.02, 1.0
"""s: what bends within `NEAR` of a row is the same kink, and what bends within `AROUND` says whether rows bend there
anyhow."""
SHARPER = 4.0
"""Times the usual bend around a row, from which on it is a kink and not a place on a smooth curve."""
CORNER, HELD = 0.1, 0.1
"""Of a command's range, and s: the least turn of the command that is a kink even among others like it, as in a random
binary sequence, and how long the line before or behind it is. Rows on a curve turn by less, or lie closer."""
FAINT = 1e-4
"""Of a command's range, per second: a change of its rate below which there is no kink."""

BRIEF = 0.03
"""s: a line of the table that is no longer than this and goes far is a step."""
MOMENT = 1e-6
"""s within which nothing turns."""
LINE, CHORDS = 0.2, 12.0
"""s, and times the usual interval between rows of a curve that straight lines need: from there on one of these lines is
a hold or a ramp beside the curve. Where a sine does not bend, one is up to eight times the usual."""
CURVED = 0.005
"""Of a command's range: the standard deviation about a straight line that a curve has at least."""


@dataclass(frozen=True)
class Command:
    """A commanded quantity over the whole session: times (m,) s and values (m,), two points at one time for a step;
    straight in between. ``kinks`` (k,) s are those times at which its rate jumps. ``late`` (m,) s is half the interval
    of rows that were sampled: a controller that holds each until the next is so late in the mean, but for its steps."""

    time: FloatArray
    value: FloatArray
    kinks: FloatArray
    late: FloatArray

    def table(self, held: bool) -> tuple[FloatArray, FloatArray]:
        """Times (m,) s and values (m,) of a controller that goes straight between sampled rows, or has them ``held``,
        in the mean."""
        return (self.time + self.late if held else self.time), self.value

    @property
    def steps(self) -> FloatArray:
        """Times (k,) s at which the command jumps."""
        far = np.abs(np.diff(self.value)) > STEP * float(np.ptp(self.value))
        return self.time[:-1][far & (np.diff(self.time) <= BRIEF)]

    @property
    def curve_ends(self) -> FloatArray:
        """Times (k,) s at which a curve passes into a long straight line, or out of one: smoothly, so that many of them
        are no kinks. None where there are too few rows for a curve."""
        apart = np.diff(self.time)
        chords = apart[apart > 0.0]
        if len(chords) < DENSE:
            return np.zeros(0)
        long = apart > max(LINE, CHORDS * float(np.median(chords)))
        return np.union1d(self.time[:-1][long], self.time[1:][long])

    def turning(self, start: float, stop: float) -> float:
        """How fast the command turns between ``start`` and ``stop`` s, rad/s: the angular frequency of a sine; 0 of a
        straight line, of a curve that hardly differs from one, and of a moment."""
        if not stop - start > MOMENT:
            return 0.0
        rows = int(np.searchsorted(self.time, stop) - np.searchsorted(self.time, start))
        time = np.linspace(start, stop, max(2 * rows, 64) + 2)[1:-1]  # a step at an end belongs to neither stretch
        value = np.interp(time, self.time, self.value)
        curved = value - np.polyval(np.polyfit(time - start, value, 1), time - start)
        size = float(np.std(curved))
        if size <= CURVED * float(np.ptp(self.value)):
            return 0.0
        return float(np.std(np.diff(curved)) / (time[1] - time[0]) / size)


def command(time: FloatArray, value: FloatArray) -> Command:
    """The command of one recording from its table of set-points (n,)."""
    even = even_intervals(time, value)
    half = 0.5 * float(np.median(np.diff(time)[even])) if np.any(even) else 0.0
    jumps = _jumps(time, value, even)
    moving = even & ~jumps & (np.diff(value) != 0.0)
    steps = np.flatnonzero(jumps) + 1
    late = np.where(np.r_[moving, False] | np.r_[False, moving], half, 0.0)
    late[steps] = 0.0
    # A jump between two rows is a step at the later one.
    late = np.insert(late, steps, 0.0)
    time, value = np.insert(time, steps, time[steps]), np.insert(value, steps, value[steps - 1])
    keep = needed_rows(time, value, COLLINEAR * float(np.ptp(value)))
    time, value, late = time[keep], value[keep], late[keep]
    return Command(time, value, time[bends(time, value)], late)


def even_intervals(time: FloatArray, value: FloatArray) -> NDArray[np.bool_]:
    """Which intervals (n − 1,) lie evenly in a table that was sampled from a command. One that writes a step as two
    rows of one time says itself where its steps are, and few rows, or mostly uneven ones, are meant as they stand."""
    dt = np.diff(time)
    if len(time) < DENSE or np.ptp(value) == 0 or np.any((dt <= 0.0) & (np.diff(value) != 0.0)):
        return np.zeros(len(dt), dtype=bool)
    usual = float(np.median(dt))
    even: NDArray[np.bool_] = (np.abs(dt - usual) <= EVEN * usual + ROUNDED) & (dt > 0.5 * usual)
    return even if np.mean(even) >= MOSTLY else np.zeros(len(dt), dtype=bool)


def _jumps(time: FloatArray, value: FloatArray, even: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which of the ``even`` intervals (n − 1,) of a table stand for a step. Where a row was sampled on the way of one,
    it came in two."""
    if not np.any(even):
        return even
    dt, change = np.diff(time), np.diff(value)
    span, usual = float(np.ptp(value)), float(np.median(dt))
    slope = np.divide(change, dt, out=np.zeros(len(dt)), where=dt > 0)
    jump = even & (np.abs(change) > STEP * span) & (np.abs(slope) * usual > STEP * span)
    alone = jump & ~np.r_[False, jump[:-1]] & ~np.r_[jump[1:], False]
    # A smooth command that is quick moves as much in the rows around; one may be on its way when it steps.
    beside = np.maximum(np.abs(np.r_[0.0, change[:-1]]), np.abs(np.r_[change[1:], 0.0]))
    clear = (alone & (beside < 0.5 * np.abs(change))) | (jump & (beside < ON_ITS_WAY * np.abs(change)))
    return np.asarray(clear | _in_two(np.where(even, change, 0.0), STEP * span))


def _in_two(change: FloatArray, least: float) -> NDArray[np.bool_]:
    """Which changes (n,) are one of the two parts of a step of at least ``least`` that was sampled on its way: next to
    none comes before and behind. One of two equal parts may be of a ramp that took two intervals, and is none."""
    size = np.abs(change)
    # The two changes before each two neighbours, and the two behind them.
    beyond = sliding_window_view(np.pad(size, 2), 6)[:, [0, 1, 4, 5]].max(axis=1)
    total = change[:-1] + change[1:]
    parts = np.minimum(size[:-1], size[1:])
    one_way = (change[:-1] * change[1:] > 0) & (np.abs(total) > least)
    uneven = np.abs(change[:-1] - 0.5 * total) > HALF_WAY * np.abs(total)
    pair = one_way & uneven & (parts > RESTS * beyond) & (beyond < AT_REST * np.abs(total))
    return np.asarray(np.r_[pair, False] | np.r_[False, pair])


def in_whole_steps(time: FloatArray, value: FloatArray, step: float) -> tuple[FloatArray, FloatArray]:
    """The table with levels that are held at whole ``step``s, as by a regulator of this resolution. A ramp goes through
    them all, in its mean straight."""
    held = (np.diff(value) == 0.0) & (np.diff(time) > 0.0)
    level = np.round(value / step) * step
    starts, ends = np.r_[held, False], np.r_[False, held]
    here = np.where(starts | ends, level, value)
    # A ramp ends where it was sent to, and the level begins a little beside.
    meets = np.flatnonzero((starts != ends) & (level != value) & (np.diff(time, prepend=-np.inf) > 0.0))
    at = meets[(meets > 0) & (meets < len(time) - 1)]
    extra = at + ends[at].astype(int)
    return np.insert(time, extra, time[at]), np.insert(here, extra, value[at])


def needed_rows(time: FloatArray, value: FloatArray, tolerance: float) -> NDArray[np.bool_]:
    """Which rows (n,) of a table straight lines need to pass every row within ``tolerance``."""
    keep = np.zeros(len(time), dtype=bool)
    keep[[0, -1]] = True
    _swing(time, value, tolerance, keep)
    return keep


@njit(cache=True, error_model="numpy")
def _swing(time: FloatArray, value: FloatArray, tolerance: float, keep: NDArray[np.bool_]) -> None:
    """From each kept row on as far as one straight line through it meets all rows on the way (swinging door)."""
    anchor = 0
    low, high = -np.inf, np.inf
    for i in range(1, len(time)):
        dt = time[i] - time[anchor]
        step = time[i] <= time[i - 1]
        if dt > 0.0 and not step:
            slope = (value[i] - value[anchor]) / dt
            if low <= slope <= high:
                low, high = max(low, slope - tolerance / dt), min(high, slope + tolerance / dt)
                continue
        keep[i - 1] = True
        anchor = i - 1
        dt = time[i] - time[anchor]
        if dt <= 0.0:  # both points of a step stay
            keep[i] = True
            anchor = i
            low, high = -np.inf, np.inf
        else:
            slope = (value[i] - value[anchor]) / dt
            low, high = slope - tolerance / dt, slope + tolerance / dt


def bends(time: FloatArray, value: FloatArray) -> NDArray[np.bool_]:
    """At which of the rows (m,) of a thinned table its rate jumps: not where it only bends as all around, unless it
    turns between straight lines.

    The first and the last row count, and so does a step.
    """
    m = len(time)
    if m < 3:
        return np.ones(m, dtype=bool)
    span = float(np.ptp(value)) or 1.0
    dt = np.diff(time)
    slope = np.divide(np.diff(value), dt, out=np.full(m - 1, np.inf), where=dt > 0)
    with np.errstate(invalid="ignore"):
        bend = np.r_[np.inf, np.abs(np.diff(slope)), np.inf]
    bend[np.isnan(bend)] = np.inf
    kink: NDArray[np.bool_] = bend > FAINT * span
    turn = np.r_[0.0, np.where(np.isfinite(bend[1:-1]), bend[1:-1], 0.0) * np.minimum(dt[:-1], dt[1:]), 0.0]
    held = np.r_[0.0, np.maximum(dt[:-1], dt[1:]), 0.0]
    corner = (turn > CORNER * span) & (held >= HELD)
    first, last = np.searchsorted(time, time - AROUND), np.searchsorted(time, time + AROUND, side="right")
    _sharp(time, bend, first, last, np.flatnonzero(kink & ~corner & np.isfinite(bend)), kink)
    return kink


@njit(cache=True, error_model="numpy")
def _sharp(
    time: FloatArray,
    bend: FloatArray,
    first: NDArray[np.int64],
    last: NDArray[np.int64],
    asked: NDArray[np.int64],
    kink: NDArray[np.bool_],
) -> None:
    """Which of the rows ``asked`` (k,) bend sharper than those around, ``first`` to ``last``: into ``kink`` (m,)."""
    for i in asked:
        around = np.empty(last[i] - first[i])
        count = 0
        for j in range(first[i], last[i]):
            if abs(time[j] - time[i]) > NEAR and np.isfinite(bend[j]):
                around[count] = bend[j]
                count += 1
        kink[i] = count < 3 or bend[i] > SHARPER * np.median(around[:count])
