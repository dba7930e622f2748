"""Curves thinned to their extremes: a screen shows the same as of all samples."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drivers.signals import FloatArray

POINTS = 800  # drawn per curve
CAPACITY = 1 << 15  # kept per curve


def extremes(time: FloatArray, value: FloatArray, width: float) -> tuple[FloatArray, FloatArray]:
    """The least and the greatest value in each stretch of ``width`` s, in the order in which they came.

    ``time`` (n,) rises; the result has two points for each stretch that holds samples, at its first and last time. They
    are NaN only where the whole stretch is.
    """
    if not len(time):
        return time, value
    stretch = np.floor((time - time[0]) / width)
    starts = np.concatenate([[0], np.flatnonzero(np.diff(stretch)) + 1])
    ends = np.append(starts[1:], len(time)) - 1
    thin_time, thin_value = np.empty(2 * len(starts)), np.empty(2 * len(starts))
    thin_time[0::2], thin_time[1::2] = time[starts], time[ends]
    least, greatest = np.fmin.reduceat(value, starts), np.fmax.reduceat(value, starts)
    count = ends - starts + 1
    rising = _first(value == np.repeat(least, count), starts) <= _first(value == np.repeat(greatest, count), starts)
    thin_value[0::2] = np.where(rising, least, greatest)
    thin_value[1::2] = np.where(rising, greatest, least)
    return thin_time, thin_value


def _first(true: NDArray[np.bool_], starts: NDArray[np.intp]) -> NDArray[np.intp]:
    """Index of the first true element in each stretch that begins at ``starts``; ``len(true)`` where there is none."""
    index = np.where(true, np.arange(len(true)), len(true))
    return np.asarray(np.minimum.reduceat(index, starts), np.intp)


class Trace:
    """One curve of a run, in memory that does not grow: when full, it becomes half as fine."""

    def __init__(self, capacity: int = CAPACITY) -> None:
        self._time, self._value = np.empty(capacity), np.empty(capacity)
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def clear(self) -> None:
        """Forget everything."""
        self._count = 0

    def add(self, time: FloatArray, value: FloatArray) -> None:
        """Append points (n,); a part longer than the trace is made as fine as fits."""
        if self._count and len(time) and time[0] < self._time[self._count - 1]:
            self.clear()  # the device began to count anew: it was switched off and on
        capacity = len(self._time)
        if self._count + len(time) > capacity:
            time = np.concatenate([self._time[: self._count], time])
            value = np.concatenate([self._value[: self._count], value])
            time, value = extremes(time, value, (time[-1] - time[0]) / (capacity // 4))
            self._count = 0
        end = self._count + len(time)
        self._time[self._count : end], self._value[self._count : end] = time, value
        self._count = end

    @property
    def last(self) -> tuple[float, float]:
        """The newest point; NaN before there is one."""
        if not self._count:
            return float("nan"), float("nan")
        return float(self._time[self._count - 1]), float(self._value[self._count - 1])

    def between(self, begin: float, end: float, points: int = POINTS) -> tuple[FloatArray, FloatArray]:
        """At most about ``points`` points of the curve between two times."""
        time, value = self._time[: self._count], self._value[: self._count]
        first, last = np.searchsorted(time, [begin, end])
        time, value = time[max(first - 1, 0) : last + 1], value[max(first - 1, 0) : last + 1]
        if len(time) <= points:
            return time.copy(), value.copy()
        return extremes(time, value, (end - begin) / (points / 2))
