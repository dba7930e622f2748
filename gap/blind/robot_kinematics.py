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


@njit(cache=True, error_model="numpy")
def tip_and_tilt(q, pivots, length):  # type: ignore[no-untyped-def]
    """Tip displacement (N, 3) [m] and the platform's unit normal (N, 3), from axis positions (N, 3) [m]."""
    n_poses = q.shape[0]
    out, normal = np.empty((n_poses, 3)), np.empty((n_poses, 3))
    e1x, e1y = pivots[1, 0] - pivots[0, 0], pivots[1, 1] - pivots[0, 1]
    e2x, e2y = pivots[2, 0] - pivots[0, 0], pivots[2, 1] - pivots[0, 1]
    side2 = e1x * e1x + e1y * e1y  # the pivots' circle holds an equilateral triangle
    for i in range(n_poses):
        a, b, c = q[i, 0], q[i, 1], q[i, 2]
        nx, ny = e1y * (c - a) - (b - a) * e2y, (b - a) * e2x - e1x * (c - a)
        nz = e1x * e2y - e1y * e2x
        area2 = np.sqrt(nx * nx + ny * ny + nz * nz)
        nx, ny, nz = nx / area2, ny / area2, nz / area2
        # Barycentric weights of the Fermat point: a / sin(A + 60 deg), the side a opposite to the corner A. With the
        # cosine rule and the area, sin(A) = area2 / (b c): all weights follow from squared sides.
        sa, sb, sc = side2 + (b - c) ** 2, side2 + (a - c) ** 2, side2 + (a - b) ** 2
        s60, c60 = 0.8660254037844386, 0.5
        wa = 1.0 / (area2 * c60 + 0.5 * (sb + sc - sa) * s60)
        wb = 1.0 / (area2 * c60 + 0.5 * (sa + sc - sb) * s60)
        wc = 1.0 / (area2 * c60 + 0.5 * (sa + sb - sc) * s60)
        total = wa + wb + wc
        out[i, 0] = (wa * pivots[0, 0] + wb * pivots[1, 0] + wc * pivots[2, 0]) / total + length * nx
        out[i, 1] = (wa * pivots[0, 1] + wb * pivots[1, 1] + wc * pivots[2, 1]) / total + length * ny
        out[i, 2] = (wa * a + wb * b + wc * c) / total + length * (nz - 1.0)
        normal[i, 0], normal[i, 1], normal[i, 2] = nx, ny, nz
    return out, normal


def tip(q: Array) -> Array:
    """Tip displacement (N, 3) [m] for axis positions (N, 3) [m], both zero at the centre pose."""
    return np.asarray(tip_and_tilt(np.ascontiguousarray(q), PIVOTS, TIP)[0])


def jacobian_at_centre() -> Array:
    """d(tip)/d(axis position), (3, 3), by central differences at the centre pose."""
    e = 1e-6
    return np.stack([(tip(e * d[None]) - tip(-e * d[None]))[0] / (2 * e) for d in np.eye(3)], axis=1)


def axes_for(target: Array) -> Array:
    """Axis positions (N, 3) [m] that bring the tip to ``target`` (N, 3) [m]: chord method, centre Jacobian."""
    inverse = np.linalg.inv(jacobian_at_centre())
    q = target @ inverse.T
    for _ in range(8):
        q = q + (target - tip(q)) @ inverse.T
    return q


def force_matrix(h: float = LEG_HEIGHT, w: float = LEG_RADIUS) -> Array:
    """R of tip reaction = R (F_a, F_b, F_c), (3, 3)."""
    r3 = np.sqrt(3.0)
    return np.array([[-r3 * w / 2 / h, 0, r3 * w / 2 / h], [-w / 2 / h, w / h, -w / 2 / h], [-1.0, -1.0, -1.0]])
