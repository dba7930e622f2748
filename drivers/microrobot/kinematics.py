"""Exact kinematics of the three-slide platform, parasitic motion included.

Pivot i sits on the fixed vertical line at angle 0°, 120°, 240° and radius ``axis_radius``, at height z_i (the axis
position), and must lie on slide line i of the platform; the slide lines meet in the platform's centre, in its plane,
120° apart. The three pivots thus span the platform's plane, and its centre sees each two of them under 120°: it is the
Fermat point (first isogonic centre, X(13)) of their triangle, whose barycentric weights are 1 / (S_A + S/√3)
(Kimberling, Encyclopedia of Triangle Centers). The tip stands on the plane's normal through the centre. Forward
kinematics is therefore closed; the inverse is Newton's method on the two slopes of the plane, which converges
quadratically because the parasitic motion is of second order.

Lengths in m. Axis positions and tip are zero at the centre pose; z runs from the platform towards the tip.

>>> tip = forward(inverse([[1e-3, 0.0, 0.5e-3]]))
>>> bool(abs(tip - [[1e-3, 0.0, 0.5e-3]]).max() < 1e-15)
True
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

_SINE = math.sqrt(0.75)
_NEWTON = 12  # iterations allowed; 4 suffice in the workspace


@dataclass(frozen=True)
class Geometry:
    """The platform's dimensions. All assumed: the paper gives none of them."""

    axis_radius: float = 30e-3
    """Distance of each axis from the centre line, m."""
    tip_height: float = 20e-3
    """Height of the tip above the platform's plane, m."""
    stroke: float = 10e-3
    """Travel of an axis, m, half of it to each side of the centre pose."""
    slide_travel: float = 3e-3
    """How far a pivot may run along its slide from the centre pose, m."""


GEOMETRY = Geometry()


def forward(axis: ArrayLike, geometry: Geometry = GEOMETRY) -> FloatArray:
    """Tip position (..., 3) for axis positions (..., 3)."""
    z, shape = _columns(axis)
    tip = np.empty_like(z)
    forward_into(z[0], z[1], z[2], geometry.axis_radius, geometry.tip_height, tip[0], tip[1], tip[2])
    return tip.T.reshape(shape)


def inverse(tip: ArrayLike, geometry: Geometry = GEOMETRY) -> FloatArray:
    """Axis positions (..., 3) for tip positions (..., 3); NaN where no pose exists (strokes are not checked here).

    The pose of least tilt: beyond a singularity (see ``conditioning``) a second one leads to the same tip.
    """
    p, shape = _columns(tip)
    axis = np.empty_like(p)
    inverse_into(p[0], p[1], p[2], geometry.axis_radius, geometry.tip_height, axis[0], axis[1], axis[2])
    return axis.T.reshape(shape)


def jacobian(axis: ArrayLike, geometry: Geometry = GEOMETRY) -> FloatArray:
    """d tip_k / d axis_i, shape (..., 3, 3) with k before i, for axis positions (..., 3)."""
    z, shape = _columns(axis)
    out = np.empty((z.shape[1], 3, 3))
    _jacobian_into(z[0], z[1], z[2], geometry.axis_radius, geometry.tip_height, out)
    return out.reshape(*shape, 3)


@dataclass(frozen=True)
class Pose:
    """Where the platform is: ``centre`` (..., 3) m, ``rotation`` (..., 3, 3), ``slides`` (..., 3) centre to pivot."""

    centre: FloatArray
    rotation: FloatArray
    slides: FloatArray


def pose(axis: ArrayLike, geometry: Geometry = GEOMETRY) -> Pose:
    """Full pose for axis positions (..., 3); the rotation's columns: slide 1, its normal in the plane, the plane's."""
    z = np.asarray(axis, dtype=float)
    angle = np.arange(3) * 2 * np.pi / 3
    rim = geometry.axis_radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    pivots = np.concatenate([np.broadcast_to(rim, (*z.shape, 2)), z[..., None]], axis=-1)
    normal = np.cross(pivots[..., 1, :] - pivots[..., 0, :], pivots[..., 2, :] - pivots[..., 0, :])
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    centre = forward(z, geometry) + geometry.tip_height * (np.array([0.0, 0.0, 1.0]) - normal)
    arms = pivots - centre[..., None, :]
    slides = np.linalg.norm(arms, axis=-1)
    first = arms[..., 0, :] / slides[..., :1]
    rotation = np.stack([first, np.cross(normal, first), normal], axis=-1)
    return Pose(centre, rotation, slides)


def conditioning(axis: ArrayLike, geometry: Geometry = GEOMETRY) -> FloatArray:
    """Smallest over largest singular value of the Jacobian, (...,): 0 at a singularity, 0.94 at the centre pose."""
    values = np.linalg.svd(jacobian(axis, geometry), compute_uv=False)
    return np.asarray(values[..., -1] / values[..., 0])


@dataclass(frozen=True)
class Reach:
    """Whether tip positions can be taken, and each reason that forbids them: each (...,) of bool."""

    pose_exists: BoolArray
    within_stroke: BoolArray
    within_slides: BoolArray
    regular: BoolArray

    @property
    def ok(self) -> BoolArray:
        """All four."""
        return self.pose_exists & self.within_stroke & self.within_slides & self.regular


def reach(tip: ArrayLike, geometry: Geometry = GEOMETRY, *, least_conditioning: float = 0.1) -> Reach:
    """Workspace and singularity check of tip positions (..., 3)."""
    axis = inverse(tip, geometry)
    exists = _all(np.isfinite(axis))
    safe = np.where(exists[..., None], axis, 0.0)
    slides = pose(safe, geometry).slides
    return Reach(
        pose_exists=exists,
        within_stroke=exists & _all(np.abs(safe) <= geometry.stroke / 2),
        within_slides=exists & _all(np.abs(slides - geometry.axis_radius) <= geometry.slide_travel),
        regular=exists & (conditioning(safe, geometry) >= least_conditioning),
    )


def _all(flags: BoolArray) -> BoolArray:
    return np.asarray(flags.all(axis=-1), dtype=bool)


def _columns(points: ArrayLike) -> tuple[FloatArray, tuple[int, ...]]:
    array = np.asarray(points, dtype=float)
    if array.shape[-1:] != (3,):
        raise ValueError(f"three components are needed in the last axis, the shape is {array.shape}")
    return np.ascontiguousarray(array.reshape(-1, 3).T), array.shape


@njit(cache=True, error_model="numpy")
def _weights(z1: float, z2: float, z3: float, rho: float, q: float) -> tuple[float, float, float]:
    """Barycentric weights of the centre, not normalised; q = sqrt(1 + slope²)."""
    k = 1.5 * rho * rho * (1.0 + q)
    return (
        1.0 / (k + (z2 - z1) * (z3 - z1)),
        1.0 / (k + (z3 - z2) * (z1 - z2)),
        1.0 / (k + (z1 - z3) * (z2 - z3)),
    )


@njit(cache=True, error_model="numpy")
def forward_into(
    z1: FloatArray,
    z2: FloatArray,
    z3: FloatArray,
    rho: float,
    height: float,
    x: FloatArray,
    y: FloatArray,
    z: FloatArray,
) -> None:
    """``forward`` on separate arrays (n,), into ``x``, ``y``, ``z``."""
    for i in range(z1.size):
        a, b, c = z1[i], z2[i], z3[i]
        gx, gy = (2.0 * a - b - c) / (3.0 * rho), (b - c) / (2.0 * _SINE * rho)
        q = math.sqrt(1.0 + gx * gx + gy * gy)
        w1, w2, w3 = _weights(a, b, c, rho, q)
        total = w1 + w2 + w3
        x[i] = rho * (w1 - 0.5 * (w2 + w3)) / total - height * gx / q
        y[i] = rho * _SINE * (w2 - w3) / total - height * gy / q
        z[i] = (w1 * a + w2 * b + w3 * c) / total + height * (1.0 / q - 1.0)


@njit(cache=True, error_model="numpy")
def _derivatives(
    a: float, b: float, c: float, rho: float, height: float, jac: FloatArray
) -> tuple[float, float, float]:
    """Tip for axis positions a, b, c; fills d tip / d axis (3, 3)."""
    gx, gy = (2.0 * a - b - c) / (3.0 * rho), (b - c) / (2.0 * _SINE * rho)
    q = math.sqrt(1.0 + gx * gx + gy * gy)
    w1, w2, w3 = _weights(a, b, c, rho, q)
    total = w1 + w2 + w3
    cx, cy = rho * (w1 - 0.5 * (w2 + w3)) / total, rho * _SINE * (w2 - w3) / total
    cz = (w1 * a + w2 * b + w3 * c) / total
    for m in range(3):
        hx = (2.0 if m == 0 else -1.0) / (3.0 * rho)
        hy = (0.0 if m == 0 else (1.0 if m == 1 else -1.0)) / (2.0 * _SINE * rho)
        dq = (gx * hx + gy * hy) / q
        dk = 1.5 * rho * rho * dq
        d1 = -w1 * w1 * (dk + (2.0 * a - b - c if m == 0 else (c - a if m == 1 else b - a)))
        d2 = -w2 * w2 * (dk + (2.0 * b - c - a if m == 1 else (a - b if m == 2 else c - b)))
        d3 = -w3 * w3 * (dk + (2.0 * c - a - b if m == 2 else (b - c if m == 0 else a - c)))
        own = w1 if m == 0 else (w2 if m == 1 else w3)
        jac[0, m] = (d1 * (rho - cx) + (d2 + d3) * (-0.5 * rho - cx)) / total - height * (hx - gx * dq / q) / q
        jac[1, m] = (-d1 * cy + d2 * (_SINE * rho - cy) - d3 * (_SINE * rho + cy)) / total - height * (
            hy - gy * dq / q
        ) / q
        jac[2, m] = (own + d1 * (a - cz) + d2 * (b - cz) + d3 * (c - cz)) / total - height * dq / (q * q)
    return cx - height * gx / q, cy - height * gy / q, cz + height * (1.0 / q - 1.0)


@njit(cache=True, error_model="numpy")
def _jacobian_into(z1: FloatArray, z2: FloatArray, z3: FloatArray, rho: float, height: float, out: FloatArray) -> None:
    for i in range(z1.size):
        _derivatives(z1[i], z2[i], z3[i], rho, height, out[i])


@njit(cache=True, error_model="numpy")
def inverse_into(
    x: FloatArray,
    y: FloatArray,
    z: FloatArray,
    rho: float,
    height: float,
    z1: FloatArray,
    z2: FloatArray,
    z3: FloatArray,
) -> None:
    """``inverse`` on separate arrays (n,), into ``z1``, ``z2``, ``z3``."""
    jac = np.empty((3, 3))
    for i in range(x.size):
        if i > 0 and x[i] == x[i - 1] and y[i] == y[i - 1]:  # at rest, or along the normal: the same slopes
            lift = z[i] - z[i - 1]
            z1[i], z2[i], z3[i] = z1[i - 1] + lift, z2[i - 1] + lift, z3[i - 1] + lift
            continue
        nx, ny = x[i] / height, y[i] / height
        lean = math.sqrt(1.0 - nx * nx - ny * ny)  # NaN where the tip cannot lean that far
        gx, gy, tz = -nx / lean, -ny / lean, 0.0
        error = np.inf
        for _ in range(_NEWTON):
            a, b, c = rho * gx, rho * (-0.5 * gx + _SINE * gy), rho * (-0.5 * gx - _SINE * gy)
            tx, ty, tz = _derivatives(a, b, c, rho, height, jac)
            ex, ey = x[i] - tx, y[i] - ty
            xx = rho * (jac[0, 0] - 0.5 * (jac[0, 1] + jac[0, 2]))
            xy = rho * _SINE * (jac[0, 1] - jac[0, 2])
            yx = rho * (jac[1, 0] - 0.5 * (jac[1, 1] + jac[1, 2]))
            yy = rho * _SINE * (jac[1, 1] - jac[1, 2])
            det = xx * yy - xy * yx
            dx, dy = (yy * ex - xy * ey) / det, (xx * ey - yx * ex) / det
            gx += dx
            gy += dy
            error = abs(dx) + abs(dy)
            if not error > 1e-6:  # convergence is quadratic: the rest is about error²
                tz += rho * ((jac[2, 0] - 0.5 * (jac[2, 1] + jac[2, 2])) * dx + _SINE * (jac[2, 1] - jac[2, 2]) * dy)
                break
        if not error <= 1e-6:
            gx = gy = np.nan
        lift = z[i] - tz
        z1[i] = lift + rho * gx
        z2[i] = lift + rho * (-0.5 * gx + _SINE * gy)
        z3[i] = lift + rho * (-0.5 * gx - _SINE * gy)
