"""Thinning: bins that are narrow after every kink of the command and widen with its age.

A hold of a minute has little to say after its first second; averaging there keeps every slow trend, lowers the noise
and makes a diagnosis take seconds. Traits of single samples (repeats, jitter, coarse steps) are looked for before,
by `gap.data.signatures`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sim_devices.chain import FloatArray

GROWTH = 0.08
"""Width of a bin over the time since the last kink."""
WIDEST = 0.25
"""s; a pulse of 1.2 Hz keeps 86 % of its amplitude in it."""
TURN = 0.7
"""rad by which a command that is curved may turn within a bin: the mean from two nodes is then off by 6e-5 of its
amplitude, at twice the angle by 1e-3, which is many times the noise of a bin."""

GUARD = 2
"""Samples before a kink that stand alone: stamps may be a sampling period early and more, and then the last ones of a
hold show the kink's response already, which two nodes of a wide bin's times do not foretell."""
AVERAGING, SPACING = 4, 0.01
"""Nodes of a mean over a sampling period, in which a signal may bend, at least; and how far apart they are, s, at most:
four in a tenth of a second miss a regulator's answer to a step by four times a gauge's noise."""
JUMP, ALONE = 15.0, 5.0
"""A jump is so many times the noise, and the changes next to it."""
MANY = 8
"""Jumps of a recording at most."""


@dataclass(frozen=True)
class Bins:
    """Means over bins: ``time``, ``value`` (m,), ``count`` (m,) of samples in each, ``spread`` (m,) of their times
    (standard deviation, s)."""

    time: FloatArray
    value: FloatArray
    count: NDArray[np.int64]
    spread: FloatArray


def node_times(time: FloatArray, spread: FloatArray, period: float) -> FloatArray:
    """Times (m, n) s whose mean a signal has over bins about ``time`` (n,) s of a ``spread`` (n,) s: one standard
    deviation on either side; where each sample is itself the mean over a ``period`` s, `AVERAGING` or more even ones
    that are as far spread."""
    count = max(AVERAGING, int(np.ceil(period / SPACING)))
    places = 2.0 * (np.arange(count) + 0.5) / count - 1.0 if period > 0.0 else np.array([-1.0, 1.0])
    reach = np.sqrt((np.square(spread) + period**2 / 12.0) / np.mean(np.square(places)))
    return np.asarray(time + reach * places[:, None])


def bin_edges(
    begin: float,
    end: float,
    kinks: FloatArray,
    dt: float,
    growth: float = GROWTH,
    widest: float = WIDEST,
    turning: Callable[[float, float], float] = lambda start, stop: 0.0,
    curve_ends: FloatArray = np.zeros(0),
) -> FloatArray:
    """Edges from ``begin`` to ``end`` s for samples ``dt`` s apart; ``kinks`` (k,) s are where the command bends,
    ``turning`` says how fast it turns between two times, rad/s, and at ``curve_ends`` (m,) s curves begin or end
    smoothly. Behind a curve bins grow from those in it, as they do behind a kink from single samples."""
    inside = np.unique(np.concatenate([[begin], kinks[(kinks > begin) & (kinks < end)], [end + dt]]))
    edges, widest = [float(begin)], max(widest, dt)
    for start, stop in pairwise(inside):
        between = np.unique(curve_ends[(curve_ends > start + dt) & (curve_ends < stop - dt)]).tolist()
        alone, t, curved = stop - GUARD * dt, start, widest
        for a, b in pairwise([start, *between, stop]):
            turn = turning(a, b)
            longest = max(min(widest, TURN / max(turn, 1e-9)), dt)
            while b - t > 0.5 * dt:
                width = min(max(dt, growth * (t - start)), longest, curved + growth * max(t - a, 0.0))
                t = min(t + width, max(alone, t + dt), b if b < stop else np.inf)
                if b - t < 0.5 * dt:
                    t = b
                edges.append(float(t))
            curved = longest if turn > 0.0 else min(widest, curved + growth * (b - a))
        # Two kinks closer than a sample (a step written as a steep ramp) share an edge: the first.
    return np.asarray(edges)


def breaks(time: FloatArray, value: FloatArray, sigma: float) -> FloatArray:
    """Times (m,) s between two samples at which a record jumps as nothing with a time constant does; ``sigma`` is the
    noise of a sample."""
    change = np.abs(np.diff(value))
    about = np.max([np.roll(change, k) for k in (-2, -1, 1, 2)], axis=0)
    at = np.flatnonzero((change > JUMP * sigma) & (change > ALONE * about))
    at = at[(at > 2) & (at < len(change) - 3)]
    at = np.sort(at[np.argsort(-change[at])[:MANY]])
    return np.asarray(0.5 * (time[at] + time[at + 1]))


def bin_means(time: FloatArray, value: FloatArray, edges: FloatArray) -> Bins:
    """Means of the finite samples in each bin that has any."""
    good = np.isfinite(value) & np.isfinite(time)
    where = np.searchsorted(edges, time[good] + 1e-9, side="right") - 1
    inside = (where >= 0) & (where < len(edges) - 1)
    where, t, v = where[inside], time[good][inside], value[good][inside]
    count = np.bincount(where, minlength=len(edges) - 1)
    used = count > 0
    n = count[used]
    mean_t = np.bincount(where, t, minlength=len(edges) - 1)[used] / n
    mean_v = np.bincount(where, v, minlength=len(edges) - 1)[used] / n
    offset = t - (np.bincount(where, t, minlength=len(edges) - 1) / np.maximum(count, 1))[where]
    spread = np.sqrt(np.bincount(where, offset**2, minlength=len(edges) - 1)[used] / n)
    return Bins(mean_t, mean_v, n.astype(np.int64), spread)
