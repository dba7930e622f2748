"""Checks of measured values by the interlock: finite, within limits, not too fast, not too long, on their set-points.

Each check looks at the new samples of a run, block by block and in order, and says when it trips. A single sample far
away may be a disturbance on a wire: a check of one value trips when the next value says the same.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from acquire.engine.rules import AXES, Rules, Trip
from acquire.words import reading
from drivers.signals import Block, FloatArray
from protocols.limits import PROBE, DwellTimer, Limits

Bools = NDArray[np.bool_]
#: Set-points (n,) per quantity at the device times of a block's samples; NaN where they are not known.
Targets = Mapping[str, FloatArray]


@dataclass(frozen=True)
class Watch:
    """A run to be watched: its limits and rules.

    The ``gappy`` channels may be NaN: a camera does not find a contour in every picture. A specimen that ``yields``
    comes up under suction. Two gauges are ``compared`` unless it is a manometer, there to show by how much they differ.
    """

    limits: Limits
    rules: Rules
    gappy: frozenset[str] = frozenset()
    yields: bool = True
    compared: bool = True


UNKNOWN = 0.25
"""s without a known set-point after which a deviation from it is a new one."""


class Check(Protocol):
    """Looks at one run."""

    def __init__(self, watch: Watch) -> None: ...

    def look(self, block: Block, targets: Targets) -> Trip | None:
        """The fault in the next samples, for which ``targets`` are commanded."""


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

    def look(self, block: Block, targets: Targets) -> Trip | None:
        """The fault in the next samples, for which ``targets`` are commanded."""
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
        low, high = (reading(name, bound) for bound in (limit.low, limit.high))
        message = f"{name} is {reading(name, values[first])}, outside {low} … {high}"
        return Trip("value", message, float(when[first]))


class Rates:
    """Nothing changes faster than its limit."""

    def __init__(self, watch: Watch) -> None:
        self._watch = watch
        self._twice = Twice()
        self._tails: dict[str, tuple[FloatArray, FloatArray]] = {}

    def look(self, block: Block, targets: Targets) -> Trip | None:
        """The fault in the next samples, for which ``targets`` are commanded."""
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
        fastest = float(rate[twice].max())
        message = f"{name} changes by {reading(name, fastest, '/s')}, more than {reading(name, limit, '/s')}"
        return Trip("rate", message, float(when[twice.argmax()]))


class Dwells:
    """Nothing is away from rest for longer than its limit, whether by its set-point or by its measured value."""

    def __init__(self, watch: Watch) -> None:
        self._watch = watch
        self._timers = {n: DwellTimer() for n, r in watch.limits.ranges.items() if math.isfinite(r.dwell)}
        self.now: dict[str, tuple[float, float]] = {}  # per quantity the dwell in s, and the longest allowed

    def look(self, block: Block, targets: Targets) -> Trip | None:
        """The fault in the next samples, for which ``targets`` are commanded."""
        for name, timer in self._timers.items():
            measured = _way(block) if name == PROBE else block.values.get(name)
            if measured is None:
                continue
            limit = self._watch.limits[name]
            away = np.abs(measured) > self._watch.rules.margin * (limit.high - limit.low)
            for quantity in AXES if name == PROBE else (name,):
                if quantity in targets:
                    away |= np.nan_to_num(targets[quantity]) != 0
            # Only the ends of a lasting state are told: the rest follows.
            edge = np.flatnonzero(np.diff(away))
            for k in np.unique([0, *edge, *(edge + 1), len(away) - 1]):
                dwell = timer.at(float(block.time[k]), bool(away[k]))
                self.now[name] = dwell, limit.dwell
                if dwell > limit.dwell * (1 + self._watch.rules.margin):
                    message = f"{name} is away from rest for longer than {limit.dwell:g} s"
                    return Trip("dwell", message, float(block.time[k]))
        return None


class Lasting:
    """Remembers across blocks since when something holds without a break."""

    def __init__(self) -> None:
        self._since: dict[str, float] = {}

    def __call__(self, name: str, holds: Bools, when: FloatArray, duration: float) -> bool:
        """Whether it has held (n,) for longer than ``duration`` s at the last of the device times (n,) s."""
        breaks = np.flatnonzero(~holds)
        if len(breaks) and breaks[-1] == len(holds) - 1:
            self._since.pop(name, None)
            return False
        if len(breaks) or name not in self._since:
            self._since[name] = float(when[breaks[-1] + 1 if len(breaks) else 0])
        return bool(when[-1] - self._since[name] > duration)

    def forget(self, name: str) -> None:
        """Begin anew."""
        self._since.pop(name, None)


class Following:
    """The measured value follows its set-point."""

    def __init__(self, watch: Watch) -> None:
        self._watch = watch
        self._lasting = Lasting()
        self._compared: dict[str, float] = {}  # device time of the last sample whose set-point was known

    def look(self, block: Block, targets: Targets) -> Trip | None:
        """The fault in the next samples, for which ``targets`` are commanded."""
        for quantity, rule in self._watch.rules.tracking.items():
            if quantity not in targets or quantity not in block.values:
                continue
            known = np.isfinite(targets[quantity])
            if not known.any():
                continue
            error, when = (block.values[quantity] - targets[quantity])[known], block.time[known]
            # Between two segments a set-point is unknown for a sample or two, which says nothing; after a pause the
            # count begins anew.
            if when[0] - self._compared.get(quantity, -math.inf) > UNKNOWN:
                self._lasting.forget(quantity)
            self._compared[quantity] = float(when[-1])
            if self._lasting(quantity, np.abs(error) > rule.error, when, rule.duration):
                message = f"{quantity} is off its set-point by {reading(quantity, error[-1])} since {rule.duration:g} s"
                return Trip("tracking", message, float(block.time[-1]))
        return None


LIMITS: tuple[type[Check], ...] = (Values, Rates, Dwells, Following)


def _way(block: Block) -> FloatArray | None:
    """How far (n,) the probe is from the centre, m; None where the block does not say."""
    if not all(axis in block.values for axis in AXES):
        return None
    way: FloatArray = np.sqrt(sum(block.values[axis] ** 2 for axis in AXES))
    return way
