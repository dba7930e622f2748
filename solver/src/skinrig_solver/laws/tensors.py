"""Symmetric tensors as six numbers, in the order 11, 22, 33, 12, 23, 13 (components, never doubled).

A tangent ``D`` is 6x6 with ``dS = D @ (dE11, dE22, dE33, 2 dE12, 2 dE23, 2 dE13)``: its entries are the components
``D_ijkl`` themselves, so that a double contraction with a six-number tensor doubles the last three.
Everything here is compiled and allocation-free; outputs are written into the arrays passed.
"""

from __future__ import annotations

from math import log, sqrt

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

ROW = np.array([0, 1, 2, 0, 1, 0])
COLUMN = np.array([0, 1, 2, 1, 2, 2])
_PLACE = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2]])


@njit(cache=True, error_model="numpy")
def determinant(c: Array) -> float:
    """det of a symmetric tensor (6,)."""
    cofactors = c[0] * (c[1] * c[2] - c[4] * c[4]) - c[3] * (c[3] * c[2] - c[4] * c[5])
    return float(cofactors + c[5] * (c[3] * c[4] - c[1] * c[5]))


@njit(cache=True, error_model="numpy")
def inverse(c: Array, out: Array) -> float:
    """Write the inverse of a symmetric tensor (6,) and return its determinant."""
    det = determinant(c)
    out[0] = (c[1] * c[2] - c[4] * c[4]) / det
    out[1] = (c[0] * c[2] - c[5] * c[5]) / det
    out[2] = (c[0] * c[1] - c[3] * c[3]) / det
    out[3] = (c[5] * c[4] - c[3] * c[2]) / det
    out[4] = (c[5] * c[3] - c[0] * c[4]) / det
    out[5] = (c[3] * c[4] - c[5] * c[1]) / det
    return det


@njit(cache=True, error_model="numpy")
def contract(a: Array, b: Array) -> float:
    """a : b of two symmetric tensors (6,)."""
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + 2.0 * (a[3] * b[3] + a[4] * b[4] + a[5] * b[5]))


@njit(cache=True, error_model="numpy")
def add_inverse_rate(ci: Array, factor: float, D: Array) -> None:
    """D -= factor dC^-1/dE, that is D_ijkl += factor (Ci_ik Ci_jl + Ci_il Ci_jk)."""
    for m in range(6):
        i, j = ROW[m], COLUMN[m]
        for n in range(6):
            k, l = ROW[n], COLUMN[n]
            D[m, n] += factor * (ci[_PLACE[i, k]] * ci[_PLACE[j, l]] + ci[_PLACE[i, l]] * ci[_PLACE[j, k]])


@njit(cache=True, error_model="numpy")
def add_volumetric(det_c: float, ci: Array, bulk: float, S: Array, D: Array) -> None:
    """Add stress and tangent of U(J) = B/2 (ln J)^2, with det C = J^2 and the inverse of C."""
    p = 0.5 * bulk * log(det_c)
    for m in range(6):
        S[m] += p * ci[m]
        for n in range(6):
            D[m, n] += bulk * ci[m] * ci[n]
    add_inverse_rate(ci, -p, D)


@njit(cache=True, error_model="numpy")
def add_isochoric(C: Array, det_c: float, ci: Array, S_bar: Array, D_bar: Array, S: Array, D: Array) -> None:
    """Add stress and tangent of W(C_bar), C_bar = J^(-2/3) C, from S_bar = 2 dW/dC_bar and D_bar = 2 dS_bar/dC_bar.

    Holzapfel, Nonlinear Solid Mechanics (2000), eqs 6.90 and 6.168, written out for six-number tensors.
    """
    a = det_c ** (-1.0 / 3.0)
    p = a * contract(S_bar, C) / 3.0
    rate = np.empty(6)  # C : dS_tilde/dE, one entry per strain component
    M = np.empty((6, 6))  # dS_tilde/dE with S_tilde = a S_bar
    for n in range(6):
        rate[n] = 0.0
    for m in range(6):
        row = 0.0
        for n in range(6):
            row += D_bar[m, n] * C[n] * (1.0 if n < 3 else 2.0)
        for n in range(6):
            M[m, n] = a * a * (D_bar[m, n] - row * ci[n] / 3.0) - 2.0 / 3.0 * a * S_bar[m] * ci[n]
            rate[n] += (1.0 if m < 3 else 2.0) * C[m] * M[m, n]
    for m in range(6):
        S[m] += a * S_bar[m] - p * ci[m]
        for n in range(6):
            D[m, n] += M[m, n] - ci[m] * (rate[n] + 2.0 * a * S_bar[n]) / 3.0
    add_inverse_rate(ci, p, D)


@njit(cache=True, error_model="numpy")
def isochoric_stress(C: Array, det_c: float, ci: Array, S_bar: Array, S: Array) -> None:
    """S = J^(-2/3) (S_bar - (S_bar : C) C^-1 / 3): the stress alone, used for derivatives linear in S_bar."""
    a = det_c ** (-1.0 / 3.0)
    p = contract(S_bar, C) / 3.0
    for m in range(6):
        S[m] = a * (S_bar[m] - p * ci[m])


@njit(cache=True, error_model="numpy")
def eigen(c: Array, values: Array, vectors: Array) -> None:
    """Eigenvalues (3,) and eigenvectors (3, 3, one per row) of a symmetric tensor (6,), by cyclic Jacobi rotations."""
    a = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            a[i, j] = c[_PLACE[i, j]]
            vectors[i, j] = 1.0 if i == j else 0.0
    for _ in range(30):
        off = abs(a[0, 1]) + abs(a[0, 2]) + abs(a[1, 2])
        if off <= 1e-17 * (abs(a[0, 0]) + abs(a[1, 1]) + abs(a[2, 2])):
            break
        for i in range(2):
            for j in range(i + 1, 3):
                if a[i, j] == 0.0:
                    continue
                theta = 0.5 * (a[j, j] - a[i, i]) / a[i, j]
                t = 1.0 / (abs(theta) + sqrt(theta * theta + 1.0))
                if theta < 0.0:
                    t = -t
                cos = 1.0 / sqrt(t * t + 1.0)
                sin = t * cos
                for k in range(3):
                    x, y = a[k, i], a[k, j]
                    a[k, i], a[k, j] = cos * x - sin * y, sin * x + cos * y
                for k in range(3):
                    x, y = a[i, k], a[j, k]
                    a[i, k], a[j, k] = cos * x - sin * y, sin * x + cos * y
                    x, y = vectors[i, k], vectors[j, k]
                    vectors[i, k], vectors[j, k] = cos * x - sin * y, sin * x + cos * y
                a[i, j] = a[j, i] = 0.0
    for i in range(3):
        values[i] = a[i, i]
