"""Yeoh: W = sum_i c_i0 (I1_bar - 3)^i, i = 1..3 (Yeoh 1993; paper F's law), initial shear modulus 2 c10."""

from __future__ import annotations

from math import log

import numpy as np
from numba import njit

from ..api import Parameter
from .law import BULK, Law, compiled
from .tensors import Array, add_isochoric, add_volumetric, determinant, inverse, isochoric_stress


@njit(cache=True, error_model="numpy")
def energy(C: Array, p: Array) -> float:
    """W [Pa] of C (6,) and p = (c10, c20, c30, B)."""
    det = determinant(C)
    x = det ** (-1.0 / 3.0) * (C[0] + C[1] + C[2]) - 3.0
    return float(p[0] * x + p[1] * x**2 + p[2] * x**3 + 0.125 * p[3] * log(det) ** 2)


@compiled
def point(C: Array, p: Array, derivatives: bool, S: Array, D: Array, dS: Array) -> None:
    ci = np.empty(6)
    det = inverse(C, ci)
    x = det ** (-1.0 / 3.0) * (C[0] + C[1] + C[2]) - 3.0
    slope = p[0] + 2.0 * p[1] * x + 3.0 * p[2] * x * x
    curvature = 2.0 * p[1] + 6.0 * p[2] * x
    S_bar = np.zeros(6)
    D_bar = np.zeros((6, 6))
    S[:] = 0.0
    D[:] = 0.0
    for m in range(3):
        S_bar[m] = 2.0 * slope
        for n in range(3):
            D_bar[m, n] = 4.0 * curvature
    add_isochoric(C, det, ci, S_bar, D_bar, S, D)
    add_volumetric(det, ci, p[3], S, D)
    if derivatives:
        for i in range(3):
            S_bar[:3] = 2.0 * (i + 1) * x**i
            isochoric_stress(C, det, ci, S_bar, dS[i])
        dS[3] = 0.5 * log(det) * ci


YEOH = Law(
    "yeoh",
    (
        Parameter("c10", "Pa", 1.0, 1e7, 15e3, "half the initial shear modulus", "assumed", "log"),
        Parameter("c20", "Pa", 0.0, 1e9, 5e3, "second coefficient", "assumed"),
        Parameter("c30", "Pa", 0.0, 1e10, 20e3, "third coefficient", "assumed"),
        BULK,
    ),
    energy,
    point,
    "F, eq. 1",
    (40e3, 30e3),
)
