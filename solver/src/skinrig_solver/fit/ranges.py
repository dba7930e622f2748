"""Where a live fit is trained: over which parameters, and for which course of the drive."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..api import Array
from ..emulator import Region
from .variables import Free, Variables

FACTOR, TIMES = 4.0, 2.5  # a logarithmic parameter is trained over start / 4 … 4 start, others up to 2.5 starts
RISE = 0.01  # s that a commanded jump takes


def as_curve(time: Array, setpoints: Mapping[str, Array]) -> tuple[Array, dict[str, Array]]:
    """Break points (k,) [s] with jumps, where the same time stands several times, as a curve: a jump takes `RISE`."""
    first = np.flatnonzero(np.diff(time, prepend=-np.inf) > 0.0)
    last = np.append(first[1:], time.size) - 1
    jumps = np.any([values[first] != values[last] for values in setpoints.values()], axis=0)
    times = np.concatenate([time[first], time[last][jumps] + RISE])
    order = np.argsort(times, kind="stable")
    return times[order], {k: np.concatenate([v[first], v[last][jumps]])[order] for k, v in setpoints.items()}


def region_of(variables: Variables) -> Region:
    """The box over which a live fit is trained: about each start, within the bounds."""
    sides = np.array([_range(free) for free in variables.free])
    return box(sides[:, 0], sides[:, 1])


def _range(free: Free) -> tuple[float, float]:
    """Coordinates between which a parameter is trained."""
    if free.log:
        low, high = free.start / FACTOR, free.start * FACTOR
    else:
        reach = abs(free.start) or 0.1 * (free.upper - free.lower)
        low, high = free.start - (TIMES - 1.0) * reach, free.start + (TIMES - 1.0) * reach
    return free.coordinate(max(low, free.lower)), free.coordinate(min(high, free.upper))


def box(lower: Array, upper: Array) -> Region:
    """The region (m coordinates) between two corners."""
    half = 0.5 * (upper - lower)
    return Region(0.5 * (lower + upper), np.diag(half), float(np.sqrt(half.size)), lower, upper)
