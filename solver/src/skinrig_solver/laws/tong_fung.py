"""Tong-Fung: W = a1 E11^2 + a2 E22^2 + a3 E11 E22 + c (exp(A1 E11^2 + A2 E22^2) - 1), in the sheet's own axes.

As paper M prints it there is no shear term and no thickness term: shear is carried by the pre-stress alone, and in a
membrane S33 = 0 gives J = 1, so U(J) does not enter. The -1 (not printed) only makes the energy vanish at F = I.
"""

from __future__ import annotations

from math import exp, log

import numpy as np
from numba import njit

from ..api import Parameter
from .law import BULK, Law, compiled
from .tensors import Array, add_volumetric, determinant, inverse


@njit(cache=True, error_model="numpy")
def energy(C: Array, p: Array) -> float:
    """W [Pa] of C (6,) and p = (c, A1, A2, a1, a2, a3, B)."""
    x, y = 0.5 * (C[0] - 1.0), 0.5 * (C[1] - 1.0)
    polynomial = p[3] * x**2 + p[4] * y**2 + p[5] * x * y
    growth = exp(p[1] * x**2 + p[2] * y**2) - 1.0
    return float(polynomial + p[0] * growth + 0.125 * p[6] * log(determinant(C)) ** 2)


@compiled
def point(C: Array, p: Array, derivatives: bool, S: Array, D: Array, dS: Array) -> None:
    c, A1, A2, a1, a2, a3 = p[0], p[1], p[2], p[3], p[4], p[5]
    x, y = 0.5 * (C[0] - 1.0), 0.5 * (C[1] - 1.0)
    growth = exp(A1 * x * x + A2 * y * y)
    S[:] = 0.0
    D[:] = 0.0
    S[0] = 2.0 * a1 * x + a3 * y + 2.0 * c * A1 * x * growth
    S[1] = 2.0 * a2 * y + a3 * x + 2.0 * c * A2 * y * growth
    D[0, 0] = 2.0 * a1 + 2.0 * c * A1 * growth * (1.0 + 2.0 * A1 * x * x)
    D[1, 1] = 2.0 * a2 + 2.0 * c * A2 * growth * (1.0 + 2.0 * A2 * y * y)
    D[0, 1] = D[1, 0] = a3 + 4.0 * c * A1 * A2 * x * y * growth
    ci = np.empty(6)
    det = inverse(C, ci)
    add_volumetric(det, ci, p[6], S, D)
    if derivatives:
        dS[:] = 0.0
        dS[0, 0], dS[0, 1] = 2.0 * A1 * x * growth, 2.0 * A2 * y * growth
        dS[1, 0], dS[1, 1] = 2.0 * c * x * growth * (1.0 + A1 * x * x), 2.0 * c * A2 * y * growth * x * x
        dS[2, 0], dS[2, 1] = 2.0 * c * A1 * x * growth * y * y, 2.0 * c * y * growth * (1.0 + A2 * y * y)
        dS[3, 0] = 2.0 * x
        dS[4, 1] = 2.0 * y
        dS[5, 0], dS[5, 1] = y, x
        dS[6] = 0.5 * log(det) * ci


TONG_FUNG = Law(
    "tong_fung",
    (
        Parameter("c", "Pa", 1e-8, 1e5, 0.0107, "factor of the exponential", "M, forearm stiff", "log"),
        Parameter("A1", "", 0.0, 200.0, 40.636, "growth along x", "M, forearm stiff"),
        Parameter("A2", "", 0.0, 200.0, 21.837, "growth along y", "M, forearm stiff"),
        Parameter("a1", "Pa", 0.0, 1e6, 12.754e3, "quadratic coefficient of E11", "M, forearm stiff"),
        Parameter("a2", "Pa", 0.0, 1e6, 6.057, "quadratic coefficient of E22", "M, forearm stiff"),
        Parameter("a3", "Pa", 0.0, 1e6, 38.046e3, "coefficient of E11 E22", "M, forearm stiff"),
        BULK,
    ),
    energy,
    point,
    "M, table of Tong-Fung parameters",
    (92e3, 49e3),
)
