"""Geometry of the three-slide platform, by the Fermat point (an own derivation).

Three pivots rise on fixed vertical lines 120 degrees apart. Each lies on a straight slide through the platform's
centre, the slides 120 degrees apart in the platform's plane. Seen from the centre the pivots are 120 degrees apart,
which makes the centre the Fermat point of their triangle; the platform's plane is the triangle's, and the first slide
gives its heading.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from .signals import Array

RADIUS = 30e-3  # m, pivots' circle
TIP = 20e-3  # m, tip above the platform
LEG_HEIGHT = 20e-3  # m, h of the force matrix
LEG_RADIUS = 15e-3 / np.sqrt(3.0)  # m, w of the force matrix
_AZIMUTH = np.radians([0.0, 120.0, 240.0])
PIVOTS = RADIUS * np.stack([np.cos(_AZIMUTH), np.sin(_AZIMUTH)], axis=1)  # (3, 2)


@njit(cache=True)
def tip_and_tilt(q, pivots, length):  # type: ignore[no-untyped-def]
    """Tip displacement (N, 3) [m] from its rest, and the platform's unit normal (N, 3), for axis positions q (N, 3) [m]."""
    out = np.empty((q.shape[0], 3))
    normal = np.empty((q.shape[0], 3))
    p = np.zeros((3, 3))
    p[:, :2] = pivots
    weight = np.empty(3)
    for i in range(q.shape[0]):
        p[:, 2] = q[i]
        e1, e2 = p[1] - p[0], p[2] - p[0]
        n = np.array(
            [e1[1] * e2[2] - e1[2] * e2[1], e1[2] * e2[0] - e1[0] * e2[2], e1[0] * e2[1] - e1[1] * e2[0]]
        )
        area2 = np.sqrt(n @ n)
        n = n / area2
        # Barycentric weights of the Fermat point: a / sin(A + 60 deg) with side a opposite to the corner A.
        for k in range(3):
            u, v = p[(k + 1) % 3] - p[k], p[(k + 2) % 3] - p[k]
            side = p[(k + 2) % 3] - p[(k + 1) % 3]
            angle = np.arctan2(area2, u @ v)
            weight[k] = np.sqrt(side @ side) / np.sin(angle + np.pi / 3)
        total = weight.sum()
        for c in range(3):
            centre = (weight[0] * p[0, c] + weight[1] * p[1, c] + weight[2] * p[2, c]) / total
            out[i, c] = centre + length * n[c] - (length if c == 2 else 0.0)
            normal[i, c] = n[c]
    return out, normal


def tip(q: Array) -> Array:
    """Tip displacement (N, 3) [m] for axis positions (N, 3) [m], both zero at the centre pose."""
    return np.asarray(tip_and_tilt(np.ascontiguousarray(q), PIVOTS, TIP)[0])


def jacobian_at_centre() -> Array:
    """d(tip)/d(axis position), (3, 3), by central differences at the centre pose."""
    e = 1e-6
    return np.stack([(tip(e * d[None]) - tip(-e * d[None]))[0] / (2 * e) for d in np.eye(3)], axis=1)


def axes_for(target: Array) -> Array:
    """Axis positions (N, 3) [m] that bring the tip to ``target`` (N, 3) [m]: Newton's chord with the centre Jacobian."""
    inverse = np.linalg.inv(jacobian_at_centre())
    q = target @ inverse.T
    for _ in range(12):
        q = q + (target - tip(q)) @ inverse.T
    return q


def force_matrix(h: float = LEG_HEIGHT, w: float = LEG_RADIUS) -> Array:
    """R of tip reaction = R (F_a, F_b, F_c), (3, 3)."""
    r3 = np.sqrt(3.0)
    return np.array([[-r3 * w / 2 / h, 0, r3 * w / 2 / h], [-w / 2 / h, w / h, -w / 2 / h], [-1.0, -1.0, -1.0]])
