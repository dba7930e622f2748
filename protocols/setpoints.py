"""Compiled protocols: set-points as piecewise linear functions of time.

Every waveform an instrument executes is a sequence of linear segments (a step is a segment of no duration), because
the instruments' own queues take exactly these: the same table is checked against limits, sent to the device, recorded
as ``/entry/setpoints`` and fed to the simulation.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Until:
    """An early end of a segment: it stops as soon as ``channel`` satisfies ``comparison`` ``value``.

    ``value`` is in the channel's SI unit. The segment's duration is then its longest allowed one. The segment after one
    that ended early begins at the value reached, not at its own ``start``, and keeps its ``end`` and duration.
    """

    channel: str
    comparison: str  # one of "<", "<=", ">", ">="
    value: float


@dataclass(frozen=True)
class Segment:
    """One linear piece of a protocol.

    ``start`` and ``end`` map each commanded quantity (``pressure`` in Pa gauge, suction negative; ``probe_x|y|z`` in m)
    to its value at the beginning and the end. ``phase`` is one of ``load``, ``hold``, ``unload``, ``rest``;
    ``step`` is the index path of the protocol step it came from, ``labels`` are the keys an analysis groups by
    (``level``, ``direction``, ``repeat``, ``cycle``), as text.
    """

    duration: float
    start: Mapping[str, float]
    end: Mapping[str, float]
    phase: str = "hold"
    step: str = ""
    labels: Mapping[str, str] = field(default_factory=dict)
    until: Until | None = None


@dataclass(frozen=True)
class Setpoints:
    """A compiled protocol: segments that follow each other without gaps, beginning at time 0 s."""

    segments: tuple[Segment, ...]

    @property
    def quantities(self) -> tuple[str, ...]:
        """Names of the commanded quantities."""
        return tuple(self.segments[0].start) if self.segments else ()

    @property
    def edges(self) -> FloatArray:
        """Segment boundaries in s, shape (segments + 1,)."""
        return np.concatenate([[0.0], np.cumsum([s.duration for s in self.segments])])

    @property
    def duration(self) -> float:
        """Total duration in s, every ``until`` running to its longest."""
        return float(self.edges[-1])

    def table(self) -> tuple[FloatArray, dict[str, FloatArray]]:
        """Break points: times in s, shape (2 segments,), and the value of each quantity there.

        A step shows as two points at the same time.
        """
        edges = self.edges
        time = np.column_stack([edges[:-1], edges[1:]]).ravel()
        values = {
            q: np.array([v for s in self.segments for v in (s.start[q], s.end[q])], dtype=float)
            for q in self.quantities
        }
        return time, values

    def at(self, time: ArrayLike) -> dict[str, FloatArray]:
        """Set-points at ``time`` (s, any shape); right-continuous, constant before the first and after the last."""
        t = np.asarray(time, dtype=float)
        edges = self.edges
        index = np.clip(np.searchsorted(edges, t, side="right") - 1, 0, len(self.segments) - 1)
        # A segment of no duration is never the one found by side="right", save the last: there `fraction` is 1.
        length = np.diff(edges)[index]
        fraction = np.where(length > 0, np.clip((t - edges[index]) / np.where(length > 0, length, 1.0), 0, 1), 1.0)
        result = {}
        for q in self.quantities:
            start = np.array([s.start[q] for s in self.segments], dtype=float)[index]
            end = np.array([s.end[q] for s in self.segments], dtype=float)[index]
            result[q] = start + fraction * (end - start)
        return result
