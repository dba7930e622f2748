"""What the interlock checks of measured values: finite, within limits, not too fast, not too long, on their set-points.

Each check looks at the new samples of a run, block by block and in order, and says when it trips. A single sample far
away may be a disturbance on a wire: what depends on one value trips when the next one says the same.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from acquire.engine.rules import AXES, Rules, Trip
from drivers.signals import Block, FloatArray
from protocols.limits import PROBE, DwellTimer, Limits

Bools = NDArray[np.bool_]
#: Set-points (n,) per quantity at device times (n,) s; NaN where they are not known.
Commanded = Callable[[FloatArray], Mapping[str, FloatArray]]


@dataclass(frozen=True)
class Watch:
    """A run to be watched: its limits, its rules, what is commanded, and the ``gappy`` channels, which may be NaN."""

    limits: Limits
    rules: Rules
    commanded: Commanded | None = None
    gappy: frozenset[str] = frozenset()


class Check(Protocol):
    """Looks at one run."""

    def __init__(self, watch: Watch) -> None: ...

    def look(self, block: Block) -> Trip | None:
        """What is wrong with the next samples."""


class Twice:
    """Remembers across blocks whether something held for the sample before."""

    def __init__(self) -> None:
        self._last: dict[str, bool] = {}

    def __call__(self, name: str, holds: Bools) -> Bools:
        """Where (n,) it holds for this sample and for the one before."""
        twice: Bools = holds & np.append(self._last.get(name, False), holds[:-1])
        self._last[name] = bool(holds[-1])
        return twice


class Values:
    """Every value is a number within its limits."""

    def __init__(self, watch: Watch) -> None:
        self._watch = watch
        self._twice = Twice()

    def look(self, block: Block) -> Trip | None:
        """What is wrong with the next samples."""
        for name, values in block.values.items():
            bad = ~np.isfinite(values)
            if bad.any() and name not in self._watch.gappy:
                return Trip("nan", f"{name} is not a number", float(block.time[bad.argmax()]))
            if trip := self._outside(name, values, block.time):
                return trip
        way = _way(block)
        return None if way is None else self._outside(PROBE, way, block.time)

    def _outside(self, name: str, values: FloatArray, when: FloatArray) -> Trip | None:
        limit = self._watch.limits[name]
        # A bound at infinity has no span to widen; the other one then stands as it is.
        slack = self._watch.rules.margin * (limit.high - limit.low) if limit.bounded else 0.0
        outside = (values < limit.low - slack) | (values > limit.high + slack)  # False for NaN
        twice = self._twice(name, outside)
        if not twice.any():
            return None
        first = twice.argmax()
        message = f"{name} is {values[first]:.6g}, outside {limit.low:.6g} … {limit.high:.6g} (SI)"
        return Trip("value", message, float(when[first]))


class Rates:
    """Nothing changes faster than its limit."""

    def __init__(self, watch: Watch) -> None:
        self._watch = watch
        self._twice = Twice()
        self._tails: dict[str, tuple[FloatArray, FloatArray]] = {}

    def look(self, block: Block) -> Trip | None:
        """What is wrong with the next samples."""
        for name, values in block.values.items():
            if math.isfinite(self._watch.limits[name].rate) and (trip := self._too_fast(name, values, block.time)):
                return trip
        return None

    def _too_fast(self, name: str, values: FloatArray, when: FloatArray) -> Trip | None:
        limit, window, count = self._watch.limits[name].rate, self._watch.rules.rate_window, len(values)
        if name in self._tails:
            old_time, old_values = self._tails[name]
            when, values = np.concatenate([old_time, when]), np.concatenate([old_values, values])
        before = np.searchsorted(when, when - window, side="right") - 1
        known = before >= 0
        rate = np.zeros(len(when))
        rate[known] = np.abs(values[known] - values[before[known]]) / (when[known] - when[before[known]])
        keep = when > when[-1] - 2 * window
        self._tails[name] = (when[keep], values[keep])
        when, rate = when[-count:], rate[-count:]
        twice = self._twice(name, rate > limit * (1 + self._watch.rules.rate_margin))
        if not twice.any():
            return None
        message = f"{name} changes by {rate[twice].max():.6g} per s, more than {limit:.6g} (SI)"
        return Trip("rate", message, float(when[twice.argmax()]))


class Dwells:
    """Nothing is away from rest for longer than its limit, whether by its set-point or by what is measured."""

    def __init__(self, watch: Watch) -> None:
        self._watch = watch
        self._timers = {n: DwellTimer() for n, r in watch.limits.ranges.items() if math.isfinite(r.dwell)}
        self.now: dict[str, tuple[float, float]] = {}  # per quantity the dwell in s, and the longest allowed

    def look(self, block: Block) -> Trip | None:
        """What is wrong with the next samples."""
        commanded = self._watch.commanded(block.time) if self._watch.commanded and self._timers else {}
        for name, timer in self._timers.items():
            measured = _way(block) if name == PROBE else block.values.get(name)
            if measured is None:
                continue
            limit = self._watch.limits[name]
            away = np.abs(measured) > self._watch.rules.margin * (limit.high - limit.low)
            for quantity in AXES if name == PROBE else (name,):
                if quantity in commanded:
                    away |= np.nan_to_num(commanded[quantity]) != 0
            # Only the ends of what lasts are told: the rest follows.
            edge = np.flatnonzero(np.diff(away))
            for k in np.unique([0, *edge, *(edge + 1), len(away) - 1]):
                dwell = timer.at(float(block.time[k]), bool(away[k]))
                self.now[name] = dwell, limit.dwell
                if dwell > limit.dwell * (1 + self._watch.rules.margin):
                    message = f"{name} is away from rest for longer than {limit.dwell:g} s"
                    return Trip("dwell", message, float(block.time[k]))
        return None


class Following:
    """What is measured follows its set-point."""

    def __init__(self, watch: Watch) -> None:
        self._watch = watch
        self._off_since: dict[str, float] = {}

    def look(self, block: Block) -> Trip | None:
        """What is wrong with the next samples."""
        rules = {q: r for q, r in self._watch.rules.tracking.items() if q in block.values}
        if not rules or self._watch.commanded is None:
            return None
        commanded = self._watch.commanded(block.time)
        for quantity, rule in rules.items():
            if quantity not in commanded:
                continue
            # NaN where the set-point is not known: not off, so that the count begins anew.
            off = np.abs(block.values[quantity] - commanded[quantity]) > rule.error
            near = np.flatnonzero(~off)
            if len(near) and near[-1] == len(off) - 1:
                self._off_since.pop(quantity, None)
                continue
            if len(near) or quantity not in self._off_since:
                self._off_since[quantity] = float(block.time[near[-1] + 1 if len(near) else 0])
            if block.time[-1] - self._off_since[quantity] > rule.duration:
                error = float(block.values[quantity][-1] - commanded[quantity][-1])
                message = f"{quantity} is off its set-point by {error:.6g} (SI) since {rule.duration:g} s"
                return Trip("tracking", message, float(block.time[-1]))
        return None


CHECKS: tuple[type[Check], ...] = (Values, Rates, Dwells, Following)


def _way(block: Block) -> FloatArray | None:
    """How far (n,) the probe is from the centre, m; None where the block does not say."""
    if not all(axis in block.values for axis in AXES):
        return None
    way: FloatArray = np.sqrt(sum(block.values[axis] ** 2 for axis in AXES))
    return way
