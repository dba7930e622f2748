"""Bischoff, Arruda and Grosh (2002): orthotropic eight-chain network.

W = (n k theta / 4) (P^2 sum_i [rho_i beta_i / P^2 + ln(beta_i / sinh beta_i)]
                     - (beta_P / P) ln(l_a^(a^2) l_b^(b^2) l_c^(c^2)))
with the unit cell's half diagonals P_i = (a, +-b, +-c)/2, P = |P_i|, rho_i^2 = P_i . C P_i, N = P^2 links a chain,
beta_i = L^-1(rho_i / N), beta_P = L^-1(1 / P), L(x) = coth x - 1/x, l_a^2 = C11, …; dW/drho_i = n k theta beta_i / 4.
A chain drawn to its length (rho_i >= N) has no energy: the point function writes NaN.
"""

from __future__ import annotations

from math import exp, expm1, inf, log, log1p, nan, sqrt, tanh

import numpy as np
from numba import njit

from ..api import Parameter
from .law import BULK, Law, compiled
from .tensors import COLUMN, ROW, Array, add_volumetric, determinant, inverse

BOLTZMANN = 1.38e-23  # J/K, as paper M prints it
TEMPERATURE = 298.0  # K, assumed: only n k theta enters
_SIGNS = np.array([[1.0, 1.0, 1.0], [1.0, 1.0, -1.0], [1.0, -1.0, 1.0], [1.0, -1.0, -1.0]])


@njit(cache=True, error_model="numpy")
def langevin(x: float) -> float:
    """L(x) = coth x - 1/x, x >= 0."""
    return x / 3.0 * (1.0 - x * x / 15.0) if x < 1e-3 else 1.0 / tanh(x) - 1.0 / x


@njit(cache=True, error_model="numpy")
def langevin_slope(x: float) -> float:
    """dL/dx."""
    if x < 1e-2:
        return 1.0 / 3.0 - x * x / 15.0
    e = exp(-x) / (-expm1(-2.0 * x))  # 1 / (2 sinh x)
    return 1.0 / (x * x) - 4.0 * e * e


@njit(cache=True, error_model="numpy")
def inverse_langevin(y: float) -> float:
    """x with L(x) = y for 0 <= y < 1 to rounding: Newton from Cohen's rational start; NaN from y = 1 on."""
    if not 0.0 <= y < 1.0:
        return nan
    x = y * (3.0 - y * y) / (1.0 - y * y)
    for _ in range(30):
        # Newton on 1/(1 - L): nearly linear in x, also close to locking
        gap = 1.0 - langevin(x)
        step = gap * (1.0 - gap / (1.0 - y)) / langevin_slope(x)
        x -= step
        if abs(step) <= 1e-14 * x:
            break
    return x


@njit(cache=True, error_model="numpy")
def _chain_energy(rho: float, N: float) -> float:
    if rho >= N:
        return inf
    b = inverse_langevin(rho / N)
    return rho * b + N * (log(2.0 * b) - b - log1p(-exp(-2.0 * b)))


@njit(cache=True, error_model="numpy")
def energy(C: Array, p: Array) -> float:
    """W [Pa] of C (6,) and p = (n, a, b, c, B), less its value at C = I."""
    sides = p[1:4]
    P = 0.5 * sqrt(sides[0] ** 2 + sides[1] ** 2 + sides[2] ** 2)
    w = -4.0 * _chain_energy(P, P * P)
    for i in range(4):
        v = 0.5 * sides * _SIGNS[i]
        square = v[0] ** 2 * C[0] + v[1] ** 2 * C[1] + v[2] ** 2 * C[2]
        square += 2.0 * (v[0] * v[1] * C[3] + v[1] * v[2] * C[4] + v[0] * v[2] * C[5])
        w += _chain_energy(sqrt(square), P * P)
    rest = inverse_langevin(1.0 / P) / P
    for i in range(3):
        w -= rest * 0.5 * sides[i] ** 2 * log(C[i])
    return float(0.25 * p[0] * BOLTZMANN * TEMPERATURE * w + 0.125 * p[4] * log(determinant(C)) ** 2)


@njit(cache=True, error_model="numpy")
def _add_chain_slopes(
    factor: float,
    first: float,
    beta: float,
    slope: float,
    rho: float,
    N: float,
    signs: Array,
    sides: Array,
    Cv: Array,
    cell: Array,
    dS: Array,
) -> None:
    """Add one chain's part of dS by the cell's sides; names as in `point`."""
    for k in range(3):
        drho = 0.5 * signs[k] * Cv[k] / rho
        dN = 0.5 * sides[k]
        dbeta = slope * (drho - rho * dN / N) / N
        change = factor * (dbeta - beta * drho / rho) / rho
        for m in range(6):
            dS[k + 1, m] += change * cell[m]
            # each factor of v_k in the cell tensor carries one power of the side
            times = (1 if ROW[m] == k else 0) + (1 if COLUMN[m] == k else 0)
            dS[k + 1, m] += first * cell[m] * times / sides[k]


@compiled
def point(C: Array, p: Array, derivatives: bool, S: Array, D: Array, dS: Array) -> None:
    factor = 0.25 * p[0] * BOLTZMANN * TEMPERATURE
    sides = p[1:4]
    N = 0.25 * (sides[0] ** 2 + sides[1] ** 2 + sides[2] ** 2)
    P = sqrt(N)
    beta_rest = inverse_langevin(1.0 / P)
    rest = beta_rest / P
    S[:] = 0.0
    D[:] = 0.0
    dS[:] = 0.0
    cell = np.empty(6)
    v, Cv = np.empty(3), np.empty(3)
    for i in range(4):
        for k in range(3):
            v[k] = 0.5 * sides[k] * _SIGNS[i, k]
        Cv[0] = C[0] * v[0] + C[3] * v[1] + C[5] * v[2]
        Cv[1] = C[3] * v[0] + C[1] * v[1] + C[4] * v[2]
        Cv[2] = C[5] * v[0] + C[4] * v[1] + C[2] * v[2]
        rho = sqrt(v[0] * Cv[0] + v[1] * Cv[1] + v[2] * Cv[2])
        beta = inverse_langevin(rho / N)
        slope = 1.0 / langevin_slope(beta)  # d beta / d (rho/N)
        first = factor * beta / rho
        second = factor * (slope / N - beta / rho) / (rho * rho)
        for m in range(6):
            cell[m] = v[ROW[m]] * v[COLUMN[m]]
        for m in range(6):
            S[m] += first * cell[m]
            for n in range(6):
                D[m, n] += second * cell[m] * cell[n]
        if derivatives:
            _add_chain_slopes(factor, first, beta, slope, rho, N, _SIGNS[i], sides, Cv, cell, dS)
    for k in range(3):
        S[k] -= factor * rest * sides[k] ** 2 / C[k]
        D[k, k] += 2.0 * factor * rest * sides[k] ** 2 / C[k] ** 2
    ci = np.empty(6)
    det = inverse(C, ci)
    if derivatives:
        for m in range(6):
            dS[0, m] = S[m] / p[0]
        for k in range(3):
            dP = 0.25 * sides[k] / P
            drest = -dP / N * (beta_rest + 1.0 / (P * langevin_slope(beta_rest)))
            for j in range(3):
                dS[k + 1, j] -= factor * drest * sides[j] ** 2 / C[j]
            dS[k + 1, k] -= factor * rest * 2.0 * sides[k] / C[k]
        dS[4] = 0.5 * log(det) * ci
    add_volumetric(det, ci, p[4], S, D)


BISCHOFF = Law(
    "bischoff",
    (
        Parameter(
            "n",
            "1/m^3",
            1e16,
            1e28,
            6.632e23,
            "chain density",
            "M, forehead, times 1000 (docs/validation/sheet.md)",
            "log",
        ),
        Parameter("a", "", 0.3, 3.0, 0.8529, "unit cell's side along x", "M, forehead"),
        Parameter("b", "", 0.3, 3.0, 1.272, "unit cell's side along y", "M, forehead"),
        Parameter("c", "", 0.3, 3.0, 1.386, "unit cell's side along z", "M, forehead"),
        BULK,
    ),
    energy,
    point,
    "M, table of face parameters; temperature 298 K assumed",
    (25e3, 23e3),
    domain="a^2 + b^2 + c^2 must exceed 4, or the chains at rest are longer than their links",
)
