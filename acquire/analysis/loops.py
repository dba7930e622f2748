"""Force against displacement of the micro-robot: loops, the energy they lose, how far repeats differ."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from acquire.recording.model import FloatArray, Recording, Series

AXES = ("x", "y", "z")
SMALLEST = 0.02  # of the largest displacement: below it the probe counts as at its centre


@dataclass(frozen=True)
class Loop:
    """One out-and-back of the probe along ``direction`` (unit vector (3,)).

    ``displacement`` (n,) m is the probe's along it, ``force`` (n,) N holds it there (minus the skin's force on the
    probe, along it), ``time`` (n,) s. ``stored`` J is the work done going out, ``lost`` J the area of the loop.
    """

    direction: FloatArray
    time: FloatArray
    displacement: FloatArray
    force: FloatArray
    stored: float
    lost: float

    @property
    def loss(self) -> float:
        """Energy lost over energy put in, 0 … 1."""
        return self.lost / self.stored if self.stored > 0 else float("nan")

    @property
    def peak(self) -> tuple[float, float]:
        """Displacement (m) and force (N) at the turning point."""
        turn = int(np.argmax(self.displacement))
        return float(self.displacement[turn]), float(self.force[turn])


def loops(recording: Recording) -> tuple[Loop, ...]:
    """Every out-and-back in a robot recording, in order; empty if the channels are not there or nothing moved.

    An excursion ends where the commanded (else measured) tip is back at its centre or turns to another direction.
    """
    if not all(f"{q}_{axis}" in recording.streams for q in ("probe", "force") for axis in AXES):
        return ()
    time = recording.streams["probe_x"].time
    probe = _vectors(recording.streams, "probe", time)
    force = -_vectors(recording.streams, "force", time)
    moved = _vectors(recording.setpoints, "probe", time) if _complete(recording.setpoints) else probe
    distance = np.linalg.norm(moved, axis=1)
    if not len(distance) or distance.max() <= 0:
        return ()
    away = distance > SMALLEST * distance.max()
    edges = np.flatnonzero(np.diff(np.concatenate([[False], away, [False]])))
    found = []
    for first, past in zip(edges[::2], edges[1::2], strict=True):
        if past - first < 8:
            continue
        part = slice(max(first - 1, 0), min(past + 1, len(time)))
        extreme = moved[part][np.argmax(distance[part])]
        direction = extreme / np.linalg.norm(extreme)
        found.append(_loop(direction, time[part], probe[part] @ direction, force[part] @ direction))
    return tuple(found)


def _loop(direction: FloatArray, time: FloatArray, x: FloatArray, f: FloatArray) -> Loop:
    turn = int(np.argmax(x))
    out = float(np.trapezoid(f[: turn + 1], x[: turn + 1]))
    back = -float(np.trapezoid(f[turn:], x[turn:]))
    return Loop(direction, time, x, f, out, out - back)


def by_direction(found: tuple[Loop, ...]) -> dict[tuple[float, ...], list[Loop]]:
    """Loops grouped by direction (rounded to 0.01), in the order of their first appearance."""
    groups: dict[tuple[float, ...], list[Loop]] = {}
    for loop in found:
        key = tuple(float(x) + 0.0 for x in np.round(loop.direction, 2))
        groups.setdefault(key, []).append(loop)
    return groups


def _complete(group: Mapping[str, Series]) -> bool:
    return all(f"probe_{axis}" in group for axis in AXES)


def _vectors(group: Mapping[str, Series], quantity: str, time: FloatArray) -> FloatArray:
    columns = []
    for axis in AXES:
        series = group[f"{quantity}_{axis}"]
        columns.append(np.interp(time, series.time, series.value))
    return np.column_stack(columns)
