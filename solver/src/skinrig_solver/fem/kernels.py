"""Element kernels: biquadratic displacement u, discontinuous linear dilatation θ and pressure p (Q2/P1/P1).

The functional is ∫ W(F, θ) + p (J − θ) dV (Simo, Taylor and Pister 1985). θ and p stay independent unknowns that each
Newton step updates linearly; their increments are eliminated element by element:

    Θ = M⁻¹ Gᵀ,  δθ = Θ δu + θ0,  δp = Π δu + π0,  Π = M⁻¹ (K_θu + K_θθ Θ),
    K = K_uu + K_uθ Θ + Θᵀ (K_θu + K_θθ Θ),  R = R_u + K_uθ θ0 + Θᵀ (K_θθ θ0 + R_θ).

An element's 18 unknowns are its nodes' displacements along r, then those along z: rows that vectors fill. Those of the
node in its middle (i), which only its own element knows, are eliminated likewise:

    K_bb − C K_ib,  R_b − C R_i,  C = K_bi K_ii⁻¹,  δu_i = −K_ii⁻¹ R_i − L δu_b,  L = K_ii⁻¹ K_ib.

A residual alone, with the rest as it was at the last tangent, makes an iteration with that tangent: `residual`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit, uint64

from ..api import Array
from .mesh import Index
from .products import add_product, set_product, subtract_product

FLAGS = {"contract", "reassoc", "arcp", "nsz"}
# of F_rr, F_rz, F_zr, F_zz, F_tt: the displacement (r or z) that moves them, and which of a node's gradients
PARTS = ((0, 0), (0, 1), (1, 0), (1, 1), (0, 2))
MIDDLE, MIDDLE_Z = 4, 13  # the two unknowns of an element's middle node


class Eliminated(NamedTuple):
    """Operators that recover the eliminated unknowns.

    Theta, Pi (E, 3, 18), theta0, pi0 (E, 3) give θ and p; Kut (E, 3, 18) and Ktt (E, 3, 3) = K_θθ further residuals;
    C (E, 18, 2), L (E, 2, 18) and inverse (E, 2, 2) are the middle node's.
    """

    Theta: Array
    Pi: Array
    theta0: Array
    pi0: Array
    Kut: Array
    Ktt: Array
    C: Array
    L: Array
    inverse: Array

    @staticmethod
    def of(elements: int) -> Eliminated:
        shapes = [(3, 18), (3, 18), (3,), (3,), (3, 18), (3, 3), (18, 2), (2, 18), (2, 2)]
        return Eliminated(*(np.zeros((elements, *shape)) for shape in shapes))


@njit(cache=True, fastmath=FLAGS)
def kinematics(elements: Index, gradients: Array, linear: Array, u: Array, theta: Array, kin: Array) -> int:
    """kin (9 E, 6) = F_rr, F_rz, F_zr, F_zz, F_tt, θ. Returns the first element with J or θ <= 0 or NaN, else −1."""
    own, F = np.empty((9, 2)), np.empty((3, 9, 2))
    for e in range(elements.shape[0]):
        for a in range(9):
            node = uint64(elements[e, a])
            own[a, 0], own[a, 1] = u[node, 0], u[node, 1]
        set_product(gradients, 243 * e, 9, 1, own, 0, 2, F, 0, 2, 27, 9, 2)
        for k in range(9):
            rr, rz, zr, zz, tt = 1.0 + F[0, k, 0], F[1, k, 0], F[0, k, 1], 1.0 + F[1, k, 1], 1.0 + F[2, k, 0]
            t = theta[e, 0] + linear[k, 1] * theta[e, 1] + linear[k, 2] * theta[e, 2]
            g = 9 * e + k
            kin[g, 0], kin[g, 1], kin[g, 2], kin[g, 3], kin[g, 4], kin[g, 5] = rr, rz, zr, zz, tt, t
            if not ((rr * zz - rz * zr) * tt > 1e-3 and tt > 0.0 and t > 1e-3):
                return e
    return -1


@njit(cache=True, fastmath=FLAGS)
def assemble(
    gradients: Array,
    weights: Array,
    linear: Array,
    inverse_mass: Array,
    kin: Array,
    stress: Array,
    tangent: Array,
    pressure: Array,
    scatter: Index,
    equations: Index,
    values: Array,
    residual: Array,
    out: Eliminated,
) -> None:
    """Add the condensed tangent to ``values`` (CSR data) and the condensed residual to ``residual``.

    ``scatter`` (E, 18, 18) positions in ``values``, −1 where fixed or eliminated, and ``equations`` (E, 18) rows of
    ``residual``, −1 where fixed; the middle nodes' rows get their residual as it is.
    """
    K, AB = np.empty((18, 18)), np.empty((8, 9, 18))
    S, factors = np.empty((5, 9)), np.empty((8, 5))
    G, Ktu = np.empty((3, 18)), np.empty((3, 18))
    R, Rt, Rp = np.empty(18), np.empty(3), np.empty(3)
    for e in range(weights.shape[0]):
        out.Ktt[e] = 0.0
        _forces(e, weights, linear, kin, stress, pressure, gradients, S, R, Rt, Rp)
        for k in range(9):
            g, w = 9 * e + k, weights[e, k]
            p = pressure[e, 0] + linear[k, 1] * pressure[e, 1] + linear[k, 2] * pressure[e, 2]
            _point(g, w, p, kin, tangent, factors)
            set_product(factors, 0, 5, 1, gradients, 243 * e + 9 * k, 81, AB, 18 * k, 162, 8, 3, 9)
            set_product(factors, 3, 5, 1, gradients, 243 * e + 9 * k, 81, AB, 18 * k + 9, 162, 8, 2, 9)
            for i in range(3):
                ni = w * tangent[g, 5, 5] * linear[k, i]
                for j in range(3):
                    out.Ktt[e, i, j] += ni * linear[k, j]
        # sums over points: rows of the nodes' r and z by gradients, those of θ and p by the linear basis
        set_product(gradients, 243 * e, 1, 9, AB, 0, 18, K, 0, 18, 9, 27, 18)
        set_product(gradients, 243 * e, 1, 9, AB, 486, 18, K, 162, 18, 9, 18, 18)
        set_product(linear, 0, 1, 3, AB, 810, 18, G, 0, 18, 3, 9, 18)
        set_product(linear, 0, 1, 3, AB, 972, 18, out.Kut, 54 * e, 18, 3, 9, 18)
        set_product(linear, 0, 1, 3, AB, 1134, 18, Ktu, 0, 18, 3, 9, 18)
        _condense(e, inverse_mass, G, Ktu, Rt, Rp, K, R, out)
        if equations[e, MIDDLE] >= 0 and equations[e, MIDDLE_Z] >= 0:
            _without_middle(e, K, out.C, out.L, out.inverse)
            _residual_without_middle(e, out.C, R)
        _scatter(e, equations, scatter, R, K, residual, values)


@njit(cache=True, fastmath=FLAGS)
def _forces(
    e: int,
    weights: Array,
    linear: Array,
    kin: Array,
    stress: Array,
    pressure: Array,
    gradients: Array,
    S: Array,
    R: Array,
    Rt: Array,
    Rp: Array,
) -> None:
    """Residuals of an element before any is eliminated; ``S`` (5, 9) takes its stress."""
    Rt[:] = 0.0
    Rp[:] = 0.0
    for k in range(9):
        g, w = 9 * e + k, weights[e, k]
        a, b, c, d, t, theta = kin[g, 0], kin[g, 1], kin[g, 2], kin[g, 3], kin[g, 4], kin[g, 5]
        p = pressure[e, 0] + linear[k, 1] * pressure[e, 1] + linear[k, 2] * pressure[e, 2]
        plane = a * d - b * c
        S[0, k], S[1, k] = w * (stress[g, 0] + p * d * t), w * (stress[g, 1] - p * c * t)
        S[2, k] = w * (stress[g, 4] + p * plane)
        S[3, k], S[4, k] = w * (stress[g, 2] - p * b * t), w * (stress[g, 3] + p * a * t)
        rt, rp = w * (stress[g, 5] - p), w * (plane * t - theta)
        for i in range(3):
            Rt[i] += linear[k, i] * rt
            Rp[i] += linear[k, i] * rp
    set_product(S, 0, 27, 1, gradients, 243 * e, 9, R, 0, 9, 1, 27, 9)
    set_product(S, 27, 18, 1, gradients, 243 * e, 9, R, 9, 9, 1, 18, 9)


@njit(cache=True, fastmath=FLAGS)
def _point(g: int, w: float, p: float, kin: Array, tangent: Array, out: Array) -> None:
    """out (8, 5): by what a node's gradients r, z, t (for its displacement along r) and r, z (along z) are multiplied.

    They give a point's A + p ∂cof(F)/∂F in rows rr, rz, tt, zr, zz, then cof(F), and the derivatives by θ and of the
    pressure law.
    """
    a, b, c, d, t = w * kin[g, 0], w * kin[g, 1], w * kin[g, 2], w * kin[g, 3], kin[g, 4]
    pt, pa, pb, pc, pd = w * p * t, p * a, p * b, p * c, p * d
    _row(g, 0, w, tangent, 0, out, 0.0, 0.0, pd, 0.0, pt)
    _row(g, 1, w, tangent, 1, out, 0.0, 0.0, -pc, -pt, 0.0)
    _row(g, 4, w, tangent, 2, out, pd, -pc, 0.0, -pb, pa)
    _row(g, 2, w, tangent, 3, out, 0.0, -pt, -pb, 0.0, 0.0)
    _row(g, 3, w, tangent, 4, out, pt, 0.0, pa, 0.0, 0.0)
    out[5, 0], out[5, 1], out[5, 2], out[5, 3], out[5, 4] = d * t, -c * t, a * kin[g, 3] - b * kin[g, 2], -b * t, a * t
    out[6, 0], out[6, 1], out[6, 2] = w * tangent[g, 0, 5], w * tangent[g, 1, 5], w * tangent[g, 4, 5]
    out[6, 3], out[6, 4] = w * tangent[g, 2, 5], w * tangent[g, 3, 5]
    _row(g, 5, w, tangent, 7, out, 0.0, 0.0, 0.0, 0.0, 0.0)


@njit(cache=True, fastmath=FLAGS)
def _row(
    g: int, i: int, w: float, tangent: Array, row: int, out: Array, r: float, z: float, t: float, zr: float, zz: float
) -> None:
    out[row, 0], out[row, 1], out[row, 2] = w * tangent[g, i, 0] + r, w * tangent[g, i, 1] + z, w * tangent[g, i, 4] + t
    out[row, 3], out[row, 4] = w * tangent[g, i, 2] + zr, w * tangent[g, i, 3] + zz


@njit(cache=True, fastmath=FLAGS)
def _scatter(e: int, equations: Index, places: Index, R: Array, K: Array, residual: Array, values: Array) -> None:
    for i in range(18):
        row = equations[e, i]
        if row >= 0:
            residual[uint64(row)] += R[i]
            for j in range(18):
                at = places[e, i, j]
                if at >= 0:
                    values[uint64(at)] += K[i, j]  # a place that may be negative takes twice as long


@njit(cache=True, fastmath=FLAGS)
def _condense(
    e: int, inverse_mass: Array, G: Array, Ktu: Array, Rt: Array, Rp: Array, K: Array, R: Array, out: Eliminated
) -> None:
    """Eliminate θ and p: Ktu becomes K_θu + K_θθ Θ."""
    set_product(inverse_mass, 9 * e, 3, 1, G, 0, 18, out.Theta, 54 * e, 18, 3, 3, 18)
    add_product(out.Ktt, 9 * e, 3, 1, out.Theta, 54 * e, 18, Ktu, 0, 18, 3, 3, 18)
    set_product(inverse_mass, 9 * e, 3, 1, Ktu, 0, 18, out.Pi, 54 * e, 18, 3, 3, 18)
    add_product(out.Kut, 54 * e, 1, 18, out.Theta, 54 * e, 18, K, 0, 18, 18, 3, 18)
    add_product(out.Theta, 54 * e, 1, 18, Ktu, 0, 18, K, 0, 18, 18, 3, 18)
    _condense_residual(e, inverse_mass, Rt, Rp, R, out)


@njit(cache=True, fastmath=FLAGS)
def _condense_residual(e: int, inverse_mass: Array, Rt: Array, Rp: Array, R: Array, out: Eliminated) -> None:
    """With the matrices of `_condense`; Rt becomes K_θθ θ0 + R_θ."""
    set_product(inverse_mass, 9 * e, 3, 1, Rp, 0, 1, out.theta0, 3 * e, 1, 3, 3, 1)
    add_product(out.Ktt, 9 * e, 3, 1, out.theta0, 3 * e, 1, Rt, 0, 1, 3, 3, 1)
    set_product(inverse_mass, 9 * e, 3, 1, Rt, 0, 1, out.pi0, 3 * e, 1, 3, 3, 1)
    add_product(out.theta0, 3 * e, 0, 1, out.Kut, 54 * e, 18, R, 0, 18, 1, 3, 18)
    add_product(Rt, 0, 0, 1, out.Theta, 54 * e, 18, R, 0, 18, 1, 3, 18)


@njit(cache=True, fastmath=FLAGS)
def _without_middle(e: int, K: Array, C: Array, L: Array, inverse: Array) -> None:
    m, n = MIDDLE, MIDDLE_Z
    det = K[m, m] * K[n, n] - K[m, n] * K[n, m]
    inverse[e, 0, 0], inverse[e, 0, 1] = K[n, n] / det, -K[m, n] / det
    inverse[e, 1, 0], inverse[e, 1, 1] = -K[n, m] / det, K[m, m] / det
    set_product(inverse, 4 * e, 2, 1, K, 18 * m, 18 * (n - m), L, 36 * e, 18, 2, 2, 18)
    set_product(K, m, 18, n - m, inverse, 4 * e, 2, C, 36 * e, 2, 18, 2, 2)
    for j in (m, n):  # the two rows stay as they are, and nobody reads the two columns
        for i in range(2):
            C[e, j, i] = L[e, i, j] = 0.0
    subtract_product(C, 36 * e, 2, 1, K, 18 * m, 18 * (n - m), K, 0, 18, 18, 2, 18)


@njit(cache=True, fastmath=FLAGS)
def _residual_without_middle(e: int, C: Array, R: Array) -> None:
    for i in range(18):
        R[i] -= C[e, i, 0] * R[MIDDLE] + C[e, i, 1] * R[MIDDLE_Z]


@njit(cache=True, fastmath=FLAGS)
def residual(
    gradients: Array,
    weights: Array,
    linear: Array,
    inverse_mass: Array,
    kin: Array,
    stress: Array,
    pressure: Array,
    equations: Index,
    out: Array,
    old: Eliminated,
) -> None:
    """Add the condensed residual to ``out``, with the element matrices of the last `assemble`."""
    S, R, Rt, Rp = np.empty((5, 9)), np.empty(18), np.empty(3), np.empty(3)
    for e in range(weights.shape[0]):
        _forces(e, weights, linear, kin, stress, pressure, gradients, S, R, Rt, Rp)
        _condense_residual(e, inverse_mass, Rt, Rp, R, old)
        _residual_without_middle(e, old.C, R)
        for i in range(18):
            if equations[e, i] >= 0:
                out[equations[e, i]] += R[i]


@njit(cache=True, fastmath=FLAGS)
def condense(equations: Index, C: Array, force: Array) -> None:
    """Carry the middle nodes' part of right-hand sides ``force`` (equations, m) to the other nodes."""
    for e in range(equations.shape[0]):
        m0, m1 = equations[e, MIDDLE], equations[e, MIDDLE_Z]
        if m0 < 0 or m1 < 0:
            continue
        for i in range(18):
            row = equations[e, i]
            if row >= 0 and row != m0 and row != m1:
                for j in range(force.shape[1]):
                    force[row, j] -= C[e, i, 0] * force[m0, j] + C[e, i, 1] * force[m1, j]


@njit(cache=True, fastmath=FLAGS)
def expand(equations: Index, L: Array, inverse: Array, force: Array, delta: Array) -> None:
    """Fill in the middle nodes' part of solutions ``delta`` of K δ = −force, both (equations, m)."""
    for e in range(equations.shape[0]):
        m0, m1 = equations[e, MIDDLE], equations[e, MIDDLE_Z]
        if m0 < 0 or m1 < 0:
            continue
        for j in range(force.shape[1]):
            delta[m0, j] = -(inverse[e, 0, 0] * force[m0, j] + inverse[e, 0, 1] * force[m1, j])
            delta[m1, j] = -(inverse[e, 1, 0] * force[m0, j] + inverse[e, 1, 1] * force[m1, j])
        for i in range(18):
            row = equations[e, i]
            if row >= 0 and row != m0 and row != m1:
                for j in range(force.shape[1]):
                    delta[m0, j] -= L[e, 0, i] * delta[row, j]
                    delta[m1, j] -= L[e, 1, i] * delta[row, j]


@njit(cache=True)
def largest(delta: Array) -> float:
    """The largest absolute value of (n, 1), NaN where there is one."""
    size = 0.0
    for i in range(delta.shape[0]):
        x = abs(delta[i, 0])
        if not x <= size:
            size = x
            if np.isnan(x):
                break
    return size


@njit(cache=True, fastmath=FLAGS)
def advance(
    number: Index,
    elements: Index,
    delta: Array,
    factor: float,
    Theta: Array,
    theta0: Array,
    Pi: Array,
    pi0: Array,
    du: Array,
    u: Array,
    theta: Array,
    pressure: Array,
) -> None:
    """du (N, 2) = ``factor`` times the entries of delta (equations, 1), 0 where number is −1; u += du.

    θ and p (E, 3) advance by the increments that belong to it where ``factor`` is 1.
    """
    for n in range(number.shape[0]):
        for c in range(2):
            du[n, c] = factor * delta[number[n, c], 0] if number[n, c] >= 0 else 0.0
            u[n, c] += du[n, c]
    if factor < 1.0:
        return
    own = np.empty(18)
    for e in range(elements.shape[0]):
        for a in range(9):
            node = uint64(elements[e, a])
            own[a], own[9 + a] = du[node, 0], du[node, 1]
        for i in range(3):
            dt, dp = theta0[e, i], pi0[e, i]
            for a in range(18):
                dt += Theta[e, i, a] * own[a]
                dp += Pi[e, i, a] * own[a]
            theta[e, i] += dt
            pressure[e, i] += dp
