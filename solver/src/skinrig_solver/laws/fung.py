"""Fung, frame invariant and orthotropic (Ateshian and Costa 2009): W = c/2 (e^Q - 1),

Q = (1/c) sum_a [2 mu_a (a a : E_bar^2) + sum_b lambda_ab (a a : E_bar)(b b : E_bar)], E_bar = (C_bar - I)/2,

with paper M's ties lambda12 = lambda23 = lambda31 = lambda11, lambda33 = lambda22 and mu3 = mu2; a, b = x, y, z.
"""

from __future__ import annotations

from math import exp, log

import numpy as np
from numba import njit

from ..api import Parameter
from .law import BULK, Law, compiled
from .tensors import Array, add_isochoric, add_volumetric, contract, determinant, inverse, isochoric_stress


@njit(cache=True, error_model="numpy")
def _moduli(l11: float, l22: float, mu1: float, mu2: float, K: Array) -> None:
    """The 6x6 stiffness K with c Q = E_bar : K : E_bar; linear in its four arguments."""
    K[:] = 0.0
    K[:3, :3] = l11
    K[0, 0] = 2.0 * mu1 + l11
    K[1, 1] = K[2, 2] = 2.0 * mu2 + l22
    K[3, 3] = K[5, 5] = 0.5 * (mu1 + mu2)
    K[4, 4] = mu2


@njit(cache=True, error_model="numpy")
def _apply(K: Array, E: Array, T: Array) -> None:
    for m in range(6):
        T[m] = 0.0
        for n in range(6):
            T[m] += K[m, n] * E[n] * (1.0 if n < 3 else 2.0)


@njit(cache=True, error_model="numpy")
def _strain(C: Array, det: float, E: Array) -> None:
    a = det ** (-1.0 / 3.0)
    for m in range(6):
        E[m] = 0.5 * (a * C[m] - (1.0 if m < 3 else 0.0))


@njit(cache=True, error_model="numpy")
def energy(C: Array, p: Array) -> float:
    """W [Pa] of C (6,) and p = (c, lambda11, lambda22, mu1, mu2, B)."""
    det = determinant(C)
    E, T, K = np.empty(6), np.empty(6), np.empty((6, 6))
    _strain(C, det, E)
    _moduli(p[1], p[2], p[3], p[4], K)
    _apply(K, E, T)
    return float(0.5 * p[0] * (exp(contract(T, E) / p[0]) - 1.0) + 0.125 * p[5] * log(det) ** 2)


@compiled
def point(C: Array, p: Array, derivatives: bool, S: Array, D: Array, dS: Array) -> None:
    c = p[0]
    ci = np.empty(6)
    det = inverse(C, ci)
    E, T, K = np.empty(6), np.empty(6), np.empty((6, 6))
    _strain(C, det, E)
    _moduli(p[1], p[2], p[3], p[4], K)
    _apply(K, E, T)
    Q = contract(T, E) / c
    growth = exp(Q)
    S_bar = growth * T
    D_bar = np.empty((6, 6))
    for m in range(6):
        for n in range(6):
            D_bar[m, n] = growth * (K[m, n] + 2.0 / c * T[m] * T[n])
    S[:] = 0.0
    D[:] = 0.0
    add_isochoric(C, det, ci, S_bar, D_bar, S, D)
    add_volumetric(det, ci, p[5], S, D)
    if derivatives:
        dT = np.empty(6)
        dT[:] = -growth * Q / c * T
        isochoric_stress(C, det, ci, dT, dS[0])
        for i in range(4):
            _moduli(1.0 * (i == 0), 1.0 * (i == 1), 1.0 * (i == 2), 1.0 * (i == 3), K)
            _apply(K, E, dT)
            dQ = contract(dT, E) / c
            for m in range(6):
                dT[m] = growth * (dT[m] + dQ * T[m])
            isochoric_stress(C, det, ci, dT, dS[i + 1])
        dS[5] = 0.5 * log(det) * ci


FUNG = Law(
    "fung",
    (
        Parameter("c", "Pa", 1e-2, 1e7, 311.8, "factor of the exponential", "M, forehead", "log"),
        Parameter("lambda11", "Pa", 0.0, 1e7, 998.2, "normal moduli 11, 12, 23, 31", "M, forehead"),
        Parameter("lambda22", "Pa", 0.0, 1e7, 1005.0, "normal moduli 22, 33", "M, forehead"),
        Parameter("mu1", "Pa", 1.0, 1e7, 7.169e3, "shear modulus of axis x", "M, forehead", "log"),
        Parameter("mu2", "Pa", 1.0, 1e7, 7.142e3, "shear moduli of axes y and z", "M, forehead", "log"),
        BULK,
    ),
    energy,
    point,
    "M, table of face parameters with c and lambda taken as kPa",
    (7e3, 3e3),
)
