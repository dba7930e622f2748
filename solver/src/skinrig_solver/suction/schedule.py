"""Which instants a quasi-static run must compute, and how its samples follow from them.

A drive on a dense grid is reduced to straight segments. Each segment is stepped evenly where the drive moves and with
growing steps where it rests; within a segment the channel is interpolated by a cubic in the step number, which is the
logarithm of time where the steps grow. The interpolation is linear in the computed values: it carries derivatives too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.linalg import solveh_banded

from ..api import Array

GROWTH = 2.5  # of successive steps at constant drive
RAMP_STEPS = 6  # for a ramp over the whole range of the drive
CORNER = 4e-3  # of the drive's range: how far a sample may lie from the polyline


@dataclass(frozen=True)
class Segment:
    """Steps ``times[i]`` (start excluded) of one straight piece from ``start``; ``growth`` of the step sizes."""

    start: float
    stop: float
    drive_start: float
    drive_stop: float
    steps: int
    growth: float

    @property
    def times(self) -> Array:
        i = np.arange(1, self.steps + 1, dtype=np.float64)
        if self.growth == 1.0:
            return self.start + (self.stop - self.start) * i / self.steps
        return self.start + (self.stop - self.start) * (self.growth**i - 1.0) / (self.growth**self.steps - 1.0)

    def drive(self, time: float) -> float:
        part = (time - self.start) / (self.stop - self.start)
        return self.drive_start + (self.drive_stop - self.drive_start) * part

    def step_number(self, time: Array) -> Array:
        """The (fractional) step at which a time lies: 0 at the start."""
        part = (time - self.start) / (self.stop - self.start)
        if self.growth == 1.0:
            return part * self.steps
        number: Array = np.log1p(part * (self.growth**self.steps - 1.0)) / np.log(self.growth)
        return number


def corners(time: Array, drive: Array, tolerance: float) -> list[int]:
    """Indices of the samples that a polyline within ``tolerance`` of the drive keeps (Douglas and Peucker)."""
    keep = {0, len(time) - 1}
    stack = [(0, len(time) - 1)]
    while stack:
        a, b = stack.pop()
        if b - a < 2:
            continue
        inner = slice(a + 1, b)
        line = drive[a] + (drive[b] - drive[a]) * (time[inner] - time[a]) / (time[b] - time[a])
        off = np.abs(drive[inner] - line)
        worst = int(np.argmax(off))
        if off[worst] > tolerance:
            keep.add(a + 1 + worst)
            stack += [(a, a + 1 + worst), (a + 1 + worst, b)]
    return sorted(keep)


def noise(drive: Array) -> float:
    """Standard deviation of the white noise in a drive, from its third differences; robust to steps."""
    if len(drive) < 8:
        return 0.0
    return float(np.median(np.abs(np.diff(drive, 3))) / (0.6745 * np.sqrt(20.0)))


def polyline_fit(time: Array, drive: Array, knots: Array) -> Array:
    """Values at the knots of the polyline that fits the samples best in the least-squares sense."""
    cell = np.clip(np.searchsorted(knots, time, side="right") - 1, 0, len(knots) - 2)
    part = (time - knots[cell]) / (knots[cell + 1] - knots[cell])
    diagonal = np.bincount(cell, (1.0 - part) ** 2, len(knots)) + np.bincount(cell + 1, part**2, len(knots))
    beside = np.bincount(cell, part * (1.0 - part), len(knots))[:-1]
    right = np.bincount(cell, (1.0 - part) * drive, len(knots)) + np.bincount(cell + 1, part * drive, len(knots))
    banded = np.stack([np.concatenate([[0.0], beside]), diagonal])
    values: Array = solveh_banded(banded, right)
    return values


def segments(time: Array, drive: Array, rise: float, density: float = 1.0) -> list[Segment]:
    """The pieces of a run that starts at rest.

    ``rise`` [s]: time in which a drive that is not zero at the first sample has been reached before it.
    ``density`` scales the number of steps.
    """
    span = float(np.max(np.abs(drive)))
    if span == 0.0:
        return [Segment(float(time[0]), float(time[-1]), 0.0, 0.0, max(1, round(2 * density)), 1.0)]
    kept = corners(time, drive, max(CORNER * span / density, 6.0 * noise(drive)))
    t = time[kept]
    p = polyline_fit(time, drive, t)  # halves the error of a smooth drive, averages the noise of a recorded one
    if drive[0] == 0.0:
        p[0] = 0.0
    else:
        t, p = np.concatenate([[t[0] - rise], t]), np.concatenate([[0.0], p])
    pieces = []
    growth = GROWTH ** (1.0 / density)
    for a in range(len(t) - 1):
        length, change = t[a + 1] - t[a], abs(p[a + 1] - p[a]) / span
        before = t[a] - t[a - 1] if a else length
        uniform = max(1, int(np.ceil(RAMP_STEPS * density * change - 1e-9)))
        # after a fast piece the response starts with steps as short as that piece
        graded = int(np.ceil(np.log1p(length / max(before, 1e-4 * length) * (growth - 1.0)) / np.log(growth)))
        rest = change < 0.5 * before / length if before < length else change < 1e-2
        steps = max(graded, uniform, 2 if rest else 1)
        pieces.append(Segment(t[a], t[a + 1], p[a], p[a + 1], steps, growth if rest or graded > uniform else 1.0))
    return pieces


def interpolation(pieces: list[Segment], time: Array) -> sp.csr_matrix:
    """(len(time), 1 + total steps): weights of the initial value and every step's value in the value at each time."""
    starts = np.array([piece.start for piece in pieces])
    owner = np.clip(np.searchsorted(starts, time, side="right") - 1, 0, len(pieces) - 1)
    blocks, first = [], 0
    for number, piece in enumerate(pieces):
        rows = np.flatnonzero(owner == number)
        x = np.clip(piece.step_number(np.clip(time[rows], piece.start, piece.stop)), 0.0, piece.steps)
        cell = np.minimum(x.astype(np.int64), piece.steps - 1)
        s = x - cell
        slopes = _slopes(piece.steps + 1)
        local = (s * (1 - s) ** 2)[:, None] * slopes[cell] + (s * s * (s - 1))[:, None] * slopes[cell + 1]
        local[np.arange(len(rows)), cell] += (1 + 2 * s) * (1 - s) ** 2
        local[np.arange(len(rows)), cell + 1] += s * s * (3 - 2 * s)
        row, column = np.nonzero(local)
        blocks.append((local[row, column], rows[row], first + column))
        first += piece.steps
    values, rows, columns = (np.concatenate(part) for part in zip(*blocks, strict=True))
    return sp.csr_matrix((values, (rows, columns)), shape=(len(time), first + 1))


def _slopes(n: int) -> Array:
    """(n, n) second-order differences on n equally spaced values."""
    if n == 2:
        return np.array([[-1.0, 1.0], [-1.0, 1.0]])
    matrix = 0.5 * (np.eye(n, k=1) - np.eye(n, k=-1))
    matrix[0, :3] = -1.5, 2.0, -0.5
    matrix[-1, -3:] = 0.5, -2.0, 1.5
    return matrix
