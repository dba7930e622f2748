"""Ogden, two terms: W = sum_i mu_i / alpha_i (l1_bar^alpha_i + l2_bar^alpha_i + l3_bar^alpha_i - 3).

The stretches are isochoric, l_bar = J^(-1/3) l: paper M prints no bar, but with U(J) alone the law would not be
stress-free at F = I. The initial shear modulus is sum_i mu_i alpha_i / 2. Stress and tangent are assembled in principal
axes (Ogden, Non-linear Elastic Deformations, 1984, section 6.1), with the limit of equal stretches taken analytically.
"""

from __future__ import annotations

from math import exp, log

import numpy as np
from numba import njit

from ..api import Parameter
from .law import BULK, Law, compiled
from .tensors import COLUMN, ROW, Array, eigen


@njit(cache=True, error_model="numpy")
def energy(C: Array, p: Array) -> float:
    """W [Pa] of C (6,) and p = (mu1, alpha1, mu2, alpha2, B)."""
    squares, axes = np.empty(3), np.empty((3, 3))
    eigen(C, squares, axes)
    logs = 0.5 * np.log(squares)
    volume = logs.sum()
    w = 0.5 * p[4] * volume**2
    for i in range(2):
        w += p[2 * i] / p[2 * i + 1] * (np.exp(p[2 * i + 1] * (logs - volume / 3.0)).sum() - 3.0)
    return float(w)


@njit(cache=True, error_model="numpy")
def _spread(values: Array, axes: Array, S: Array) -> None:
    """S = sum_a values_a n_a n_a."""
    for m in range(6):
        S[m] = 0.0
        for a in range(3):
            S[m] += values[a] * axes[a, ROW[m]] * axes[a, COLUMN[m]]


@njit(cache=True, error_model="numpy")
def _dyad(x: Array, y: Array, out: Array) -> None:
    """out = (x y + y x) / 2."""
    for m in range(6):
        out[m] = 0.5 * (x[ROW[m]] * y[COLUMN[m]] + x[COLUMN[m]] * y[ROW[m]])


@njit(cache=True, error_model="numpy")
def _normal(rate: Array, tau: Array, squares: Array, a: int, b: int) -> float:
    """2 d(tau_a / l_a^2)/d(l_b^2), the tangent of principal stresses."""
    return float((rate[a, b] - (2.0 * tau[a] if a == b else 0.0)) / (squares[a] * squares[b]))


@njit(cache=True, error_model="numpy")
def _shear(principal: Array, rate: Array, tau: Array, squares: Array, a: int, b: int) -> float:
    """The tangent of the shear between two principal directions."""
    gap = squares[b] - squares[a]
    if abs(gap) > 1e-6 * (squares[a] + squares[b]):
        return float((principal[b] - principal[a]) / gap)
    # equal stretches
    shear = 0.25 * (_normal(rate, tau, squares, a, a) + _normal(rate, tau, squares, b, b))
    return float(shear - 0.25 * (_normal(rate, tau, squares, a, b) + _normal(rate, tau, squares, b, a)))


@njit(cache=True, error_model="numpy")
def _tangent(principal: Array, rate: Array, tau: Array, squares: Array, axes: Array, D: Array) -> None:
    """D (6, 6) from the principal stresses and their rates."""
    D[:] = 0.0
    left, right = np.empty(6), np.empty(6)
    for a in range(3):
        _dyad(axes[a], axes[a], left)
        for b in range(3):
            _dyad(axes[b], axes[b], right)
            normal = _normal(rate, tau, squares, a, b)
            for m in range(6):
                for n in range(6):
                    D[m, n] += normal * left[m] * right[n]
        b = (a + 1) % 3
        _dyad(axes[a], axes[b], left)
        shear = _shear(principal, rate, tau, squares, a, b)
        for m in range(6):
            for n in range(6):
                D[m, n] += 4.0 * shear * left[m] * left[n]


@njit(cache=True, error_model="numpy")
def _slopes(p: Array, power: Array, logs: Array, squares: Array, axes: Array, dS: Array) -> None:
    """dS (5, 6) by the law's parameters."""
    volume = logs[0] + logs[1] + logs[2]
    dtau, slope = np.empty(3), np.empty(3)
    for i in range(2):
        mean = (power[i, 0] + power[i, 1] + power[i, 2]) / 3.0
        for a in range(3):
            dtau[a] = (power[i, a] - mean) / squares[a]
        _spread(dtau, axes, dS[2 * i])
        for a in range(3):
            slope[a] = power[i, a] * (logs[a] - volume / 3.0)
        mean = (slope[0] + slope[1] + slope[2]) / 3.0
        for a in range(3):
            dtau[a] = p[2 * i] * (slope[a] - mean) / squares[a]
        _spread(dtau, axes, dS[2 * i + 1])
    for a in range(3):
        dtau[a] = volume / squares[a]
    _spread(dtau, axes, dS[4])


@compiled
def point(C: Array, p: Array, derivatives: bool, S: Array, D: Array, dS: Array) -> None:
    squares, axes = np.empty(3), np.empty((3, 3))
    eigen(C, squares, axes)
    logs = np.empty(3)
    for a in range(3):
        logs[a] = 0.5 * log(squares[a])
    volume = logs[0] + logs[1] + logs[2]

    power = np.empty((2, 3))  # l_bar^alpha
    tau = np.full(3, p[4] * volume)  # principal Kirchhoff stresses dW/d ln l
    rate = np.full((3, 3), p[4])  # their derivatives with respect to ln l
    for i in range(2):
        mu, alpha = p[2 * i], p[2 * i + 1]
        for a in range(3):
            power[i, a] = exp(alpha * (logs[a] - volume / 3.0))
        mean = (power[i, 0] + power[i, 1] + power[i, 2]) / 3.0
        for a in range(3):
            tau[a] += mu * (power[i, a] - mean)
            rate[a, a] += mu * alpha * power[i, a]
            for b in range(3):
                rate[a, b] += mu * alpha / 3.0 * (mean - power[i, a] - power[i, b])

    principal = tau / squares
    _spread(principal, axes, S)
    _tangent(principal, rate, tau, squares, axes, D)
    if derivatives:
        _slopes(p, power, logs, squares, axes, dS)


OGDEN = Law(
    "ogden",
    (
        Parameter("mu1", "Pa", 1.0, 1e7, 29.16e3, "first modulus", "M, forearm stiff", "log"),
        Parameter("alpha1", "", 0.1, 30.0, 1.71, "first exponent", "M, forearm stiff"),
        Parameter("mu2", "Pa", 1e-6, 1e6, 2.15, "second modulus", "M, forearm stiff", "log"),
        Parameter("alpha2", "", 1.0, 120.0, 40.09, "second exponent", "M, forearm stiff"),
        BULK,
    ),
    energy,
    point,
    "M, table of Ogden parameters; isochoric stretches assumed",
    (84e3, 61e3),
)
