"""Element kernels: biquadratic displacement u, discontinuous linear dilatation θ and pressure p (Q2/P1/P1).

The functional is ∫ W(F, θ) + p (J − θ) dV (Simo, Taylor and Pister 1985). θ and p stay independent unknowns that each
Newton step updates linearly; their increments are eliminated element by element:

    Θ = M⁻¹ Gᵀ,  δθ = Θ δu + θ0,  δp = Π δu + π0,  Π = M⁻¹ (K_θu + K_θθ Θ),
    K = K_uu + K_uθ Θ + Θᵀ (K_θu + K_θθ Θ),  R = R_u + K_uθ θ0 + Θᵀ (K_θθ θ0 + R_θ).

So are those of the node in the element's middle (unknowns 8 and 9 of its 18, i), which only its own element knows:

    K_bb − C K_ib,  R_b − C R_i,  C = K_bi K_ii⁻¹,  δu_i = −K_ii⁻¹ R_i − L δu_b,  L = K_ii⁻¹ K_ib.

A residual alone, with the rest as it was at the last tangent, makes an iteration with that tangent: `residual`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from ..api import Array
from .mesh import Index
from .products import add_product, subtract_product

FLAGS = {"contract", "reassoc", "arcp", "nsz"}
# of F_rr, F_rz, F_zr, F_zz, F_tt: the displacement (r or z) that moves them, and which of a node's gradients
PARTS = ((0, 0), (0, 1), (1, 0), (1, 1), (0, 2))
MIDDLE = 8  # first of the two unknowns of an element's middle node


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
    for e in range(elements.shape[0]):
        for k in range(9):
            rr, rz, zr, zz, tt = 1.0, 0.0, 0.0, 1.0, 1.0
            for a in range(9):
                ur, uz = u[elements[e, a], 0], u[elements[e, a], 1]
                gr, gz = gradients[e, k, a, 0], gradients[e, k, a, 1]
                rr += gr * ur
                rz += gz * ur
                zr += gr * uz
                zz += gz * uz
                tt += gradients[e, k, a, 2] * ur
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
    K, AB = np.empty((18, 18)), np.empty((9, 8, 18))
    G, Ktu = np.empty((3, 18)), np.empty((3, 18))
    R, Rt, Rp = np.empty(18), np.empty(3), np.empty(3)
    for e in range(weights.shape[0]):
        Kut, Ktt = out.Kut[e], out.Ktt[e]
        R[:] = 0.0
        Rt[:] = 0.0
        Rp[:] = 0.0
        Ktt[:] = 0.0
        for k in range(9):
            g, w = 9 * e + k, weights[e, k]
            a, b, c, d, t, theta = kin[g, 0], kin[g, 1], kin[g, 2], kin[g, 3], kin[g, 4], kin[g, 5]
            p = pressure[e, 0] + linear[k, 1] * pressure[e, 1] + linear[k, 2] * pressure[e, 2]
            plane = a * d - b * c
            _point(gradients[e, k], w, a, b, c, d, t, plane, p, stress[g], tangent[g], AB[k], R)
            rt, rp, ktt = w * (stress[g, 5] - p), w * (plane * t - theta), w * tangent[g, 5, 5]
            for i in range(3):
                ni = linear[k, i]
                Rt[i] += ni * rt
                Rp[i] += ni * rp
                for j in range(3):
                    Ktt[i, j] += ni * linear[k, j] * ktt
        # sums over points: rows of nodes 2 a and 2 a + 1 by gradients, those of θ and p by the linear basis
        K[:] = 0.0
        for i in range(5):
            component, direction = PARTS[i]
            first = 243 * e + direction
            add_product(gradients, first, 3, 27, AB, 18 * i, 144, K, 18 * component, 36, 9, 9, 18)
        for i, matrix in ((5, G), (6, Kut), (7, Ktu)):
            matrix[:] = 0.0
            add_product(linear, 0, 1, 3, AB, 18 * i, 144, matrix, 0, 18, 3, 9, 18)
        _condense(e, inverse_mass, G, Ktu, Rt, Rp, K, R, out)
        if equations[e, MIDDLE] >= 0 and equations[e, MIDDLE + 1] >= 0:
            _without_middle(e, K, out.C, out.L, out.inverse[e])
            _residual_without_middle(out.C[e], R)
        _scatter(e, equations, scatter, R, K, residual, values)


@njit(cache=True, fastmath=FLAGS)
def _point(
    gradients: Array,
    w: float,
    a: float,
    b: float,
    c: float,
    d: float,
    t: float,
    plane: float,
    p: float,
    stress: Array,
    A: Array,
    AB: Array,
    R: Array,
) -> None:
    """AB (8, 18): a point's A + p ∂cof(F)/∂F, cof(F), and the derivatives by θ and of the pressure law, contracted with
    the gradients of the nodes; its stress is added to R."""
    crr, crz, czr, czz = d * t, -c * t, -b * t, a * t
    s0, s1, s2 = w * (stress[0] + p * crr), w * (stress[1] + p * crz), w * (stress[2] + p * czr)
    s3, s4 = w * (stress[3] + p * czz), w * (stress[4] + p * plane)
    pt, pa, pb, pc, pd = p * t, p * a, p * b, p * c, p * d
    for i in range(9):
        gr, gz, gt = gradients[i, 0], gradients[i, 1], gradients[i, 2]
        j = 2 * i
        AB[0, j] = w * (A[0, 0] * gr + A[0, 1] * gz + (A[0, 4] + pd) * gt)
        AB[1, j] = w * (A[1, 0] * gr + A[1, 1] * gz + (A[1, 4] - pc) * gt)
        AB[2, j] = w * (A[2, 0] * gr + (A[2, 1] - pt) * gz + (A[2, 4] - pb) * gt)
        AB[3, j] = w * ((A[3, 0] + pt) * gr + A[3, 1] * gz + (A[3, 4] + pa) * gt)
        AB[4, j] = w * ((A[4, 0] + pd) * gr + (A[4, 1] - pc) * gz + A[4, 4] * gt)
        AB[0, j + 1] = w * (A[0, 2] * gr + (A[0, 3] + pt) * gz)
        AB[1, j + 1] = w * ((A[1, 2] - pt) * gr + A[1, 3] * gz)
        AB[2, j + 1] = w * (A[2, 2] * gr + A[2, 3] * gz)
        AB[3, j + 1] = w * (A[3, 2] * gr + A[3, 3] * gz)
        AB[4, j + 1] = w * ((A[4, 2] - pb) * gr + (A[4, 3] + pa) * gz)
        AB[5, j], AB[5, j + 1] = w * (crr * gr + crz * gz + plane * gt), w * (czr * gr + czz * gz)
        AB[6, j] = w * (A[0, 5] * gr + A[1, 5] * gz + A[4, 5] * gt)
        AB[6, j + 1] = w * (A[2, 5] * gr + A[3, 5] * gz)
        AB[7, j] = w * (A[5, 0] * gr + A[5, 1] * gz + A[5, 4] * gt)
        AB[7, j + 1] = w * (A[5, 2] * gr + A[5, 3] * gz)
        R[j] += s0 * gr + s1 * gz + s4 * gt
        R[j + 1] += s2 * gr + s3 * gz


@njit(cache=True, fastmath=FLAGS)
def _scatter(e: int, equations: Index, places: Index, R: Array, K: Array, residual: Array, values: Array) -> None:
    for i in range(18):
        row = equations[e, i]
        if row >= 0:
            residual[row] += R[i]
            for j in range(18):
                if places[e, i, j] >= 0:
                    values[places[e, i, j]] += K[i, j]


@njit(cache=True, fastmath=FLAGS)
def _condense(
    e: int, inverse_mass: Array, G: Array, Ktu: Array, Rt: Array, Rp: Array, K: Array, R: Array, out: Eliminated
) -> None:
    """Eliminate θ and p: Ktu becomes K_θu + K_θθ Θ, Rt becomes K_θθ θ0 + R_θ."""
    inverse, Kut, Theta, theta0, pi0 = inverse_mass[e], out.Kut[e], out.Theta[e], out.theta0[e], out.pi0[e]
    Theta[:] = 0.0
    out.Pi[e] = 0.0
    add_product(inverse_mass, 9 * e, 3, 1, G, 0, 18, out.Theta, 54 * e, 18, 3, 3, 18)
    add_product(out.Ktt, 9 * e, 3, 1, out.Theta, 54 * e, 18, Ktu, 0, 18, 3, 3, 18)
    add_product(inverse_mass, 9 * e, 3, 1, Ktu, 0, 18, out.Pi, 54 * e, 18, 3, 3, 18)
    for i in range(3):
        theta0[i] = inverse[i, 0] * Rp[0] + inverse[i, 1] * Rp[1] + inverse[i, 2] * Rp[2]
    for i in range(3):
        Rt[i] += out.Ktt[e, i, 0] * theta0[0] + out.Ktt[e, i, 1] * theta0[1] + out.Ktt[e, i, 2] * theta0[2]
    for i in range(3):
        pi0[i] = inverse[i, 0] * Rt[0] + inverse[i, 1] * Rt[1] + inverse[i, 2] * Rt[2]
        for j in range(18):
            R[j] += Kut[i, j] * theta0[i] + Theta[i, j] * Rt[i]
    add_product(out.Kut, 54 * e, 1, 18, out.Theta, 54 * e, 18, K, 0, 18, 18, 3, 18)
    add_product(out.Theta, 54 * e, 1, 18, Ktu, 0, 18, K, 0, 18, 18, 3, 18)


@njit(cache=True, fastmath=FLAGS)
def _without_middle(e: int, K: Array, every_C: Array, every_L: Array, inverse: Array) -> None:
    m, C, L = MIDDLE, every_C[e], every_L[e]
    det = K[m, m] * K[m + 1, m + 1] - K[m, m + 1] * K[m + 1, m]
    inverse[0, 0], inverse[0, 1] = K[m + 1, m + 1] / det, -K[m, m + 1] / det
    inverse[1, 0], inverse[1, 1] = -K[m + 1, m] / det, K[m, m] / det
    for j in range(18):
        L[0, j] = inverse[0, 0] * K[m, j] + inverse[0, 1] * K[m + 1, j]
        L[1, j] = inverse[1, 0] * K[m, j] + inverse[1, 1] * K[m + 1, j]
        C[j, 0] = K[j, m] * inverse[0, 0] + K[j, m + 1] * inverse[1, 0]
        C[j, 1] = K[j, m] * inverse[0, 1] + K[j, m + 1] * inverse[1, 1]
    for j in (m, m + 1):
        C[j, :] = 0.0
        L[:, j] = 0.0
    subtract_product(every_C, 36 * e, 2, 1, K, 18 * m, 18, K, 0, 18, m, 2, 18)
    beyond = m + 2
    subtract_product(every_C, 36 * e + 2 * beyond, 2, 1, K, 18 * m, 18, K, 18 * beyond, 18, 18 - beyond, 2, 18)


@njit(cache=True, fastmath=FLAGS)
def _residual_without_middle(C: Array, R: Array) -> None:
    for i in range(18):
        R[i] -= C[i, 0] * R[MIDDLE] + C[i, 1] * R[MIDDLE + 1]


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
    R, Rt, Rp, rest = np.empty(18), np.empty(3), np.empty(3), np.empty(3)
    for e in range(weights.shape[0]):
        R[:] = 0.0
        Rt[:] = 0.0
        Rp[:] = 0.0
        for k in range(9):
            g, w = 9 * e + k, weights[e, k]
            a, b, c, d, t, theta = kin[g, 0], kin[g, 1], kin[g, 2], kin[g, 3], kin[g, 4], kin[g, 5]
            p = pressure[e, 0] + linear[k, 1] * pressure[e, 1] + linear[k, 2] * pressure[e, 2]
            plane = a * d - b * c
            s0, s1 = w * (stress[g, 0] + p * d * t), w * (stress[g, 1] - p * c * t)
            s2, s3 = w * (stress[g, 2] - p * b * t), w * (stress[g, 3] + p * a * t)
            s4 = w * (stress[g, 4] + p * plane)
            for i in range(9):
                gr, gz, gt = gradients[e, k, i, 0], gradients[e, k, i, 1], gradients[e, k, i, 2]
                R[2 * i] += s0 * gr + s1 * gz + s4 * gt
                R[2 * i + 1] += s2 * gr + s3 * gz
            rt, rp = w * (stress[g, 5] - p), w * (plane * t - theta)
            for i in range(3):
                Rt[i] += linear[k, i] * rt
                Rp[i] += linear[k, i] * rp
        theta0, pi0, inverse, Ktt = old.theta0[e], old.pi0[e], inverse_mass[e], old.Ktt[e]
        for i in range(3):
            theta0[i] = inverse[i, 0] * Rp[0] + inverse[i, 1] * Rp[1] + inverse[i, 2] * Rp[2]
        for i in range(3):
            rest[i] = Rt[i] + Ktt[i, 0] * theta0[0] + Ktt[i, 1] * theta0[1] + Ktt[i, 2] * theta0[2]
        for i in range(3):
            pi0[i] = inverse[i, 0] * rest[0] + inverse[i, 1] * rest[1] + inverse[i, 2] * rest[2]
            for j in range(18):
                R[j] += old.Kut[e, i, j] * theta0[i] + old.Theta[e, i, j] * rest[i]
        _residual_without_middle(old.C[e], R)
        for i in range(18):
            if equations[e, i] >= 0:
                out[equations[e, i]] += R[i]


@njit(cache=True, fastmath=FLAGS)
def condense(equations: Index, C: Array, force: Array) -> None:
    """Carry the middle nodes' part of right-hand sides ``force`` (equations, m) to the other nodes."""
    for e in range(equations.shape[0]):
        m0, m1 = equations[e, MIDDLE], equations[e, MIDDLE + 1]
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
        m0, m1 = equations[e, MIDDLE], equations[e, MIDDLE + 1]
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
def move(number: Index, delta: Array, factor: float, du: Array, u: Array) -> None:
    """du (N, 2) = ``factor`` times the entries of delta (equations, 1), 0 where number is −1; u += du."""
    for n in range(number.shape[0]):
        for c in range(2):
            du[n, c] = factor * delta[number[n, c], 0] if number[n, c] >= 0 else 0.0
            u[n, c] += du[n, c]


@njit(cache=True, fastmath=FLAGS)
def update(
    elements: Index, du: Array, Theta: Array, theta0: Array, Pi: Array, pi0: Array, theta: Array, pressure: Array
) -> None:
    """Advance θ and p (E, 3) by the increments that belong to du (N, 2)."""
    for e in range(elements.shape[0]):
        for i in range(3):
            dt, dp = theta0[e, i], pi0[e, i]
            for a in range(9):
                ur, uz = du[elements[e, a], 0], du[elements[e, a], 1]
                dt += Theta[e, i, 2 * a] * ur + Theta[e, i, 2 * a + 1] * uz
                dp += Pi[e, i, 2 * a] * ur + Pi[e, i, 2 * a + 1] * uz
            theta[e, i] += dt
            pressure[e, i] += dp
