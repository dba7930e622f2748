"""Where narrow effects would have to be: frequencies, looks, wanderings and jumps that a residual itself shows.

A fit finds a rhythm, or a moment, only from close by; a grid over its prior would miss it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from gap.data.session import CLOCK_SD
from gap.inference.hypothesis import Lateness
from sim_devices.chain import FloatArray

LINES = 2
"""How many of each are tried."""
ALIKE = 0.5
"""s by which the clearest jumps of recordings may differ and be one after the same time."""
HUMP, WIDE = 0.02, 0.06
"""Of the logarithm of a rate: between rates that are tried, and by which a rhythm that keeps no phase wanders (rms)."""
SHARP = 3e-3
"""s: lateness known worse than that says nothing of looks at equal intervals."""
SLOWEST_LOOK, QUICKEST_LOOK = 1.0, 2e-3
"""s between looks at the command."""
BLUR = 5e-4
"""s: the least error of a lateness, whatever its noise."""
MANY = 300_000
"""Frequencies at most: shorter intervals in longer sessions would take minutes, and any of them would do."""
TRIED = 8
"""How many intervals are looked at for each skew."""
SKEWS = CLOCK_SD * np.linspace(-2.0, 2.0, 9)
"""Rates of sound clocks that are tried."""
PHASES = 6
"""Phases that are tried of looks whose interval a ripple tells."""
SPARSE = 2.0
"""How many times the range of lateness an interval may be."""


def lines(time: FloatArray, residual: FloatArray, low: float, high: float) -> list[float]:
    """The strongest frequencies, Hz, between ``low`` and ``high`` in a residual (n,) at uneven ``time`` (n,) s."""
    step = 0.2 / high
    index = ((time - time.min()) / step).astype(np.int64)
    even = np.bincount(index, residual - residual.mean())
    power = np.abs(np.fft.rfft(even, 4 * len(even)))
    frequency = np.fft.rfftfreq(4 * len(even), step)
    power[(frequency < low) | (frequency > high)] = 0.0
    return [float(frequency[k]) for k in _peaks(power, 8)]


def humps(time: FloatArray, piece: NDArray[np.int64], residual: FloatArray, low: float, high: float) -> list[float]:
    """The rates, Hz, between ``low`` and ``high`` about which a residual (n,) at uneven ``time`` (n,) s has most power,
    above that of half and one and a half times the rate: of a rhythm that keeps no phase. Each ``piece`` (n,) of it, by
    number, is asked by itself."""
    rates = np.geomspace(low / 2.0, 1.5 * high, 1 + round(np.log(3.0 * high / low) / HUMP))
    power = np.zeros(len(rates))
    for k in np.unique(piece):
        t, own = time[piece == k], residual[piece == k]
        window = np.sin(np.pi * np.clip((t - t.min()) / max(float(np.ptp(t)), 1e-9), 0.0, 1.0)) ** 2
        power += np.square(np.abs(np.exp(-2j * np.pi * np.outer(rates, t)) @ (window * (own - own.mean()))))
    smooth = gaussian_filter1d(power, WIDE / HUMP)
    beside = 0.5 * sum(np.interp(k * rates, rates, smooth) for k in (0.5, 1.5))
    above = np.where((rates >= low) & (rates <= high), smooth / np.maximum(beside, 1e-300), 0.0)
    return [float(rates[k]) for k in _peaks(above, 8)]


def looks(lateness: Lateness) -> list[tuple[float, float, float]]:
    """Intervals (s) at which a device could look at its command, the phase (0 to 1) of it, and the share of lateness
    (0 to 1) that waiting for the next look explains, beside a constant and a sound clock's skew. The best first, of one
    clock that all recordings share and of clocks that begin with each.

    Where a ripple tells intervals, they may have any phase: a regulator delays the ripple as it does all else.
    """
    told = [(interval, k / PHASES, 1.0) for interval in lateness.intervals for k in range(PHASES)]
    own = [] if lateness.since is None else _looks(replace(lateness, time=lateness.since))
    return told + sorted([*_looks(lateness), *own], key=lambda found: -found[2])


def _looks(lateness: Lateness) -> list[tuple[float, float, float]]:
    """Those that the kinks alone tell."""
    sharp = lateness.sd < SHARP
    time, late, steps = lateness.time[sharp], lateness.late[sharp], lateness.steps[sharp]
    sd = np.hypot(lateness.sd[sharp], BLUR)
    if np.sum(steps) < 5:
        return []
    sound = _Sound(time, sd)
    # Lateness fills the interval: one much longer than its range would agree with any. Some of it may look like skew.
    spreads = float(np.ptp(late - sound.part(late))), float(np.ptp(late))
    least, most = max(min(spreads) / 1.2, QUICKEST_LOOK), min(SPARSE * max(spreads), SLOWEST_LOOK)
    if least >= most:
        return []
    step = 0.1 / float(np.ptp(time))
    frequency = np.arange(1.0 / most, min(1.0 / least, 1.0 / most + MANY * step), step)
    found = []
    for skew in SKEWS:
        shown = (time + late - skew * time)[steps]
        for k in _peaks(np.abs(_turns(frequency[0], step, len(frequency), shown)), 10, TRIED):
            low, fine = frequency[k] - step, step / 20
            interval = 1.0 / float(low + fine * np.argmax(np.abs(_turns(low, fine, 41, shown))))
            phases = np.linspace(0.0, 1.0, 400, endpoint=False)
            wait = interval * np.where(steps, np.mod(phases[:, None] - time / interval, 1.0), 0.5)
            left = sound.misfit(late - wait)
            best = int(np.argmin(left))
            found.append((interval, float(phases[best]), 1.0 - float(left[best] / sound.misfit(late[None])[0])))
    return sorted(found, key=lambda f: -f[2])[:LINES]


class _Sound:
    """Lateness of a sound instrument: a constant, and a skew of an ordinary clock."""

    def __init__(self, time: FloatArray, sd: FloatArray) -> None:
        self.weight = 1.0 / sd
        self.design = np.column_stack([np.ones_like(time), (time - time.mean()) * CLOCK_SD])
        rows = self.design * self.weight[:, None]
        self.solve = np.linalg.solve(rows.T @ rows + np.diag([0.0, 1.0]), rows.T)

    def part(self, late: FloatArray) -> FloatArray:
        """The lateness of a fault-free instrument, rows (k, m) or (m,)."""
        return np.asarray((late * self.weight) @ self.solve.T @ self.design.T)

    def misfit(self, late: FloatArray) -> FloatArray:
        """χ² (k,) of the rest of each row of lateness (k, m)."""
        return np.asarray(np.sum(np.square((late - self.part(late)) * self.weight), axis=-1))


def _turns(first: float, step: float, n: int, moments: FloatArray) -> NDArray[np.complex128]:
    """Sum of exp(2πi f t) over moments (m,) s, for each of ``n`` frequencies from ``first`` on, ``step`` Hz apart.

    A frequency is a coarse one and a little more, so that the sums are a product of two small matrices.
    """
    few = math.isqrt(n - 1) + 1
    coarse = np.exp(2j * np.pi * np.outer(first + few * step * np.arange(few), moments))
    more = np.exp(2j * np.pi * np.outer(step * np.arange(few), moments))
    return np.asarray((coarse @ more.T).ravel()[:n])


def wanderings(lateness: Lateness, low: float, high: float) -> list[tuple[float, float, float]]:
    """Periods (s) between ``low`` and ``high``, phases (0 to 1) and amplitudes (s) of the sines, beside an offset and
    a rate, that describe lateness best."""
    time, weight = lateness.time, 1.0 / lateness.sd
    if len(time) < 6:
        return []
    periods = np.geomspace(low, high, 120)
    misfit, fitted = np.empty(len(periods)), np.empty((len(periods), 4))
    for k, period in enumerate(periods):
        turn = 2 * np.pi * time / period
        design = np.column_stack([np.ones_like(time), time / high, np.sin(turn), np.cos(turn)])
        # A little of a prior, or half a turn of a huge sine passes for a straight line.
        rows = np.vstack([design * weight[:, None], np.diag([1.0, 1.0, 100.0, 100.0])])
        fitted[k] = np.linalg.lstsq(rows, np.r_[lateness.late * weight, np.zeros(4)], rcond=None)[0]
        misfit[k] = float(np.sum(((design @ fitted[k] - lateness.late) * weight) ** 2))
    found = []
    for k in _peaks(-misfit, 6):
        sine, cosine = fitted[k, 2:]
        phase = float(np.arctan2(-cosine, sine) / (2 * np.pi)) % 1.0
        found.append((float(periods[k]), phase, float(np.hypot(sine, cosine))))
    return found


def jumps(time: FloatArray, residual: FloatArray, recording: NDArray[np.int64]) -> list[float]:
    """The moments, s, from which on a residual (n,) is most different from its past: within a recording, and
    the one between two of them."""
    order = np.argsort(time, kind="stable")
    time, residual, recording = time[order], residual[order], recording[order]
    out = [moment for _, moment, _ in _jump_of_each(time, residual, recording)[:LINES]]
    borders = np.flatnonzero(np.diff(recording))
    if len(borders):
        best = int(borders[np.argmax(_step_gain(residual)[borders])])
        out.append(float(0.5 * (time[best] + time[best + 1])))
    return out


def since_the_start(time: FloatArray, residual: FloatArray, recording: NDArray[np.int64]) -> list[float]:
    """How long, s, after the start of its recording a residual (n,) is most different from its past: as most of them
    have in common, then as the clearest have."""
    clearest = [moment - begin for _, moment, begin in _jump_of_each(time, residual, recording)]
    return list(dict.fromkeys([*in_common(clearest, ALIKE), *clearest]))[:LINES]


def _jump_of_each(
    time: FloatArray, residual: FloatArray, recording: NDArray[np.int64]
) -> list[tuple[float, float, float]]:
    """Of each recording the χ² that one jump takes off, its moment, s, and when the recording begins, s; the clearest
    first."""
    found = []
    for k in np.unique(recording):
        stamps, gain = time[recording == k], _step_gain(residual[recording == k])
        if len(stamps) > 12:
            best = 3 + int(np.argmax(gain[3:-4]))
            found.append((float(gain[best]), float(0.5 * (stamps[best] + stamps[best + 1])), float(stamps[0])))
    return sorted(found, reverse=True)


def spells(time: FloatArray, residual: FloatArray, recording: NDArray[np.int64]) -> list[tuple[float, float]]:
    """Moments, s, at which a residual (n,) becomes most different for a while within a recording, and how long that
    lasts, s; the clearest first, at most `LINES`."""
    found = []
    for k in np.unique(recording):
        at = np.flatnonzero(recording == k)
        at = at[np.argsort(time[at], kind="stable")]
        if len(at) > 12:
            gain, first, behind = _window_gain(residual[at])
            stamps = time[at]
            begin = 0.5 * (stamps[first - 1] + stamps[first])
            found.append((gain, float(begin), float(0.5 * (stamps[behind - 1] + stamps[behind]) - begin)))
    return [(begin, length) for _, begin, length in sorted(found, reverse=True)[:LINES]]


def _window_gain(residual: FloatArray) -> tuple[float, int, int]:
    """χ² that a level of its own within a window takes off a residual (n,) whose mean is free, at most; and the
    window's first sample and the one behind it."""
    n, total = len(residual), np.concatenate([[0.0], np.cumsum(residual - residual.mean())])
    best = (-1.0, 1, 2)
    for first in range(1, n - 1):
        size = np.arange(1, n - first)
        gain = (total[first + 1 : n] - total[first]) ** 2 * n / (size * (n - size))
        k = int(np.argmax(gain))
        best = max(best, (float(gain[k]), first, first + 1 + k))
    return best


def _step_gain(residual: FloatArray) -> FloatArray:
    """χ² (n - 1,) that a step after each sample takes off a residual (n,) whose mean is free."""
    before = np.arange(1, len(residual))
    left = np.cumsum(residual - residual.mean())[:-1]
    return np.asarray(left**2 * len(residual) / (before * (len(residual) - before)))


def _peaks(power: FloatArray, apart: int, most: int = LINES) -> list[int]:
    """Indices of the highest of ``power`` (n,), farther than ``apart`` from each other."""
    out: list[int] = []
    for k in np.argsort(-power):
        if all(abs(int(k) - other) > apart for other in out):
            out.append(int(k))
        if len(out) == most:
            break
    return out


def in_common(delays: Sequence[float], within: float) -> tuple[float, ...]:
    """Means of the ``delays`` (s) that several recordings have in common, but for ``within``; the most common first."""
    groups: list[list[float]] = []
    for delay in sorted(delays):
        if groups and delay - groups[-1][-1] <= within:
            groups[-1].append(delay)
        else:
            groups.append([delay])
    common = sorted((g for g in groups if len(g) > 1), key=len, reverse=True)
    return tuple(float(np.mean(g)) for g in common)
