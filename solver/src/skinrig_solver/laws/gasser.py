"""Gasser: W = mu/2 (I1_bar - 3) + (k1/k2) (exp(k2 (In_bar - 1)^2) - 1), n = (cos theta, sin theta, 0).

Paper M prints I1_bar - 1, which adds a constant only. As printed there, the one family of fibres also resists
shortening (no bracket), and there is no factor 1/2 before k1/k2.
"""

from __future__ import annotations

from math import cos, exp, log, pi, radians, sin

import numpy as np
from numba import njit

from ..api import Parameter
from .law import BULK, Law, compiled
from .tensors import Array, add_isochoric, add_volumetric, determinant, inverse, isochoric_stress


@njit(cache=True, error_model="numpy")
def energy(C: Array, p: Array) -> float:
    """W [Pa] of C (6,) and p = (mu, k1, k2, theta, B)."""
    det = determinant(C)
    a = det ** (-1.0 / 3.0)
    x, y = cos(p[3]), sin(p[3])
    stretch = a * (x * x * C[0] + 2.0 * x * y * C[3] + y * y * C[1]) - 1.0
    w = 0.5 * p[0] * (a * (C[0] + C[1] + C[2]) - 3.0) + p[1] / p[2] * (exp(p[2] * stretch**2) - 1.0)
    return float(w + 0.125 * p[4] * log(det) ** 2)


@compiled
def point(C: Array, p: Array, derivatives: bool, S: Array, D: Array, dS: Array) -> None:
    mu, k1, k2 = p[0], p[1], p[2]
    ci = np.empty(6)
    det = inverse(C, ci)
    x, y = cos(p[3]), sin(p[3])
    fibre = np.zeros(6)  # n n
    fibre[0], fibre[1], fibre[3] = x * x, y * y, x * y
    a = det ** (-1.0 / 3.0)
    e = a * (fibre[0] * C[0] + 2.0 * fibre[3] * C[3] + fibre[1] * C[1]) - 1.0
    growth = exp(k2 * e * e)
    slope = 2.0 * k1 * e * growth  # dW/dIn
    curvature = 2.0 * k1 * growth * (1.0 + 2.0 * k2 * e * e)
    S_bar = 2.0 * slope * fibre
    D_bar = np.empty((6, 6))
    for m in range(6):
        if m < 3:
            S_bar[m] += mu
        for n in range(6):
            D_bar[m, n] = 4.0 * curvature * fibre[m] * fibre[n]
    S[:] = 0.0
    D[:] = 0.0
    add_isochoric(C, det, ci, S_bar, D_bar, S, D)
    add_volumetric(det, ci, p[4], S, D)
    if derivatives:
        S_bar[:] = 0.0
        S_bar[:3] = 1.0
        isochoric_stress(C, det, ci, S_bar, dS[0])
        S_bar[:] = 4.0 * e * growth * fibre
        isochoric_stress(C, det, ci, S_bar, dS[1])
        S_bar[:] = 4.0 * k1 * e**3 * growth * fibre
        isochoric_stress(C, det, ci, S_bar, dS[2])
        turned = np.zeros(6)  # d(n n)/d theta
        turned[0], turned[1], turned[3] = -2.0 * x * y, 2.0 * x * y, x * x - y * y
        de = a * (turned[0] * C[0] + 2.0 * turned[3] * C[3] + turned[1] * C[1])
        S_bar[:] = 2.0 * (curvature * de * fibre + slope * turned)
        isochoric_stress(C, det, ci, S_bar, dS[3])
        dS[4] = 0.5 * log(det) * ci


GASSER = Law(
    "gasser",
    (
        Parameter("mu", "Pa", 1.0, 1e7, 14.08e3, "shear modulus of the matrix", "M, forehead", "log"),
        Parameter("k1", "Pa", 0.0, 1e7, 11.01e3, "fibre modulus", "M, forehead"),
        Parameter("k2", "", 1e-6, 200.0, 0.09188, "fibre stiffening", "M, forehead"),
        Parameter("theta", "rad", -pi, pi, radians(30.82), "fibre angle from x", "M, forehead"),
        BULK,
    ),
    energy,
    point,
    "M, table of face parameters",
    (26e3, 18e3),
    aligned=False,
)
