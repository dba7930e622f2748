"""A probe's path as rays from the centre, so that the elastic force is solved once a ray and read off for every sample.

The elastic force depends on the probe's present position only. Samples are grouped around rays; along a ray the force
is solved at Chebyshev points and interpolated, off it (tracking error, tilt) it is continued with the solved tangent.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..api import Array

OFF_RAY = 0.05  # of the largest excursion: how far from a ray a sample may lie before it gets its own


@dataclass(frozen=True)
class Ray:
    """Unit ``direction`` (3,), ``reach`` [m], the ``samples`` near it, and the first of them at full reach."""

    direction: Array
    reach: float
    samples: NDArray[np.int64]
    farthest: int

    @property
    def across(self) -> Array:
        """Two unit vectors (2, 3) normal to the ray, the second one z where the ray lies in the sheet's plane."""
        x, y, _ = self.direction
        first = np.array([-y, x, 0.0]) / np.hypot(x, y) if np.hypot(x, y) > 1e-3 else np.array([1.0, 0.0, 0.0])
        second = np.cross(self.direction, first)
        return np.stack([first, second / np.linalg.norm(second)])

    def points(self, count: int) -> Array:
        """Distances (count,) of the Chebyshev points from 0 to the reach [m]."""
        return 0.5 * self.reach * (1.0 - np.cos(np.pi * np.arange(count) / (count - 1)))

    def weights(self, positions: Array, count: int) -> Array:
        """Interpolation weights (k, count) of positions (k, 3); barycentric (Berrut and Trefethen 2004, eq. 5.4)."""
        gap = (positions @ self.direction)[:, None] - self.points(count)
        exact = np.abs(gap) < 1e-12 * self.reach
        factor = (-1.0) ** np.arange(count)
        factor[[0, -1]] *= 0.5
        share = factor / np.where(exact, 1.0, gap)
        share[exact.any(axis=1)] = 0.0
        share[exact] = 1.0
        return np.asarray(share / share.sum(axis=1, keepdims=True))


def fold(positions: Array, aligned: bool) -> tuple[Array, Array]:
    """Positions (n, 3) mirrored into one part of space by the sheet's symmetry, and the signs (n, 3) that did it.

    An aligned law mirrors in x, y and z; any law here mirrors in z and turns by 180 degrees about z.
    """
    signs = np.where(positions < 0.0, -1.0, 1.0)
    if not aligned:
        half = np.where((positions[:, 0] < 0.0) | ((positions[:, 0] == 0.0) & (positions[:, 1] < 0.0)), -1.0, 1.0)
        signs[:, 0] = signs[:, 1] = half
    return positions * signs, signs


def rays(positions: Array) -> Iterator[Ray]:
    """Cover folded positions (n, 3) [m] with as few rays as the tolerance allows; every sample belongs to one."""
    distance = np.linalg.norm(positions, axis=1)
    allowed = OFF_RAY * float(distance.max())
    if allowed == 0.0:
        return
    open_samples = distance > allowed
    directions = []
    while open_samples.any():
        farthest = int(np.argmax(np.where(open_samples, distance, 0.0)))
        direction = positions[farthest] / distance[farthest]
        if abs(direction[2]) < OFF_RAY:  # meant to be in the sheet's plane, where a membrane stays flat
            direction[2] = 0.0
            direction /= np.linalg.norm(direction)
        directions.append(direction)
        open_samples &= _off(positions, direction) > allowed
        open_samples[farthest] = False
    nearest = np.argmin([_off(positions, direction) for direction in directions], axis=0)
    for k, direction in enumerate(directions):
        samples = np.flatnonzero(nearest == k)
        if samples.size:
            along = positions[samples] @ direction
            yield Ray(direction, float(along.max()), samples, int(samples[np.argmax(along)]))


def _off(positions: Array, direction: Array) -> Array:
    along = np.maximum(positions @ direction, 0.0)
    return np.asarray(np.linalg.norm(positions - along[:, None] * direction, axis=1))
