"""Compiled element loops of the sheet, for every law: a membrane in space (plane stress) or a solid.

Deformation at a Gauss point is F = F0 + sum_a u_a g_a, with the homogeneous pre-deformation F0 (3, d), d = 2 or 3,
nodal displacements u since then, and the shape functions' gradients g_a with respect to the stress-free state.
The stress that acts is S = scale S_e + extra: the law's instantaneous elastic stress, weighted by the viscoelastic
step, plus what its history or an initial stress adds (history.py, equilibrium.py).
"""

from __future__ import annotations

import numpy as np
from numba import float64, int32, int64, njit, types

from ..laws.law import FUNCTION, SIGNATURE

_PLACE = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2]])


@njit(cache=True)
def _flatten(derivatives, S, D, dS):  # type: ignore[no-untyped-def]
    """Condense D and dS to S33 = 0."""
    for m in range(dS.shape[0] if derivatives else 0):
        for i in range(6):
            if i != 2:
                dS[m, i] -= D[i, 2] / D[2, 2] * dS[m, 2]
        dS[m, 2] = 0.0
    for i in range(6):
        if i != 2:
            for j in range(6):
                if j != 2:
                    D[i, j] -= D[i, 2] * D[2, j] / D[2, 2]
    D[2, :] = 0.0
    D[:, 2] = 0.0
    S[2] = 0.0


@njit(types.float64(FUNCTION, *SIGNATURE.args), cache=True)
def plane_stress(law, C, p, derivatives, S, D, dS):  # type: ignore[no-untyped-def]
    """Find C33 with S33 = 0, starting from ``C[2]`` and leaving it there; condense D and dS accordingly.

    C, S, D, dS as in laws/law.py, with C13 = C23 = 0 and z an axis of material symmetry. Returns |S33| relative to the
    stiffness, or NaN where no thickness balances.
    """
    error = np.inf
    good = 0.0  # the last thickness that had a stress
    for _ in range(80):
        law(C, p, derivatives, S, D, dS)
        before, error = error, abs(S[2]) / abs(D[2, 2])
        if not np.isfinite(error):  # beyond a chain's length, say: go back towards the last value, or thinner
            C[2] = 0.5 * (good + C[2]) if good > 0.0 else 0.95 * C[2]
            continue
        if error <= 1e-15 * C[2] or (error <= 1e-11 * C[2] and error >= 0.5 * before):  # exact, or at rounding
            break
        good = C[2]
        C[2] += max(-0.5 * C[2], min(-2.0 * S[2] / abs(D[2, 2]), C[2]))
    else:
        return np.nan
    _flatten(derivatives, S, D, dS)
    return error


@njit(cache=True, error_model="numpy")
def _deformation(F0, u, nodes, g, F, C):  # type: ignore[no-untyped-def]
    """F (3, d) and C = F^T F (6,) of one Gauss point; a membrane keeps the C33 it finds in ``C``."""
    d = F.shape[1]
    for i in range(3):
        for j in range(d):
            F[i, j] = F0[i, j]
    for a in range(nodes.size):
        for i in range(3):
            for j in range(d):
                F[i, j] += u[nodes[a], i] * g[a, j]
    for i in range(d):
        for j in range(i, d):
            C[_PLACE[i, j]] = F[0, i] * F[0, j] + F[1, i] * F[1, j] + F[2, i] * F[2, j]


@njit(cache=True, error_model="numpy")
def _nominal(F, S, D, scale, P, A):  # type: ignore[no-untyped-def]
    """Nominal stress P = F S (3, d) and A = dP/dF (3 d, 3 d), component iJ at i d + J; S total, D still unscaled."""
    d = F.shape[1]
    for i in range(3):
        for j in range(d):
            P[i, j] = 0.0
            for k in range(d):
                P[i, j] += F[i, k] * S[_PLACE[k, j]]
    for j in range(d):
        for l in range(d):
            for i in range(3):
                for k in range(3):
                    value = 0.0
                    for m in range(d):
                        for n in range(d):
                            value += F[i, m] * D[_PLACE[m, j], _PLACE[n, l]] * F[k, n]
                    A[i * d + j, k * d + l] = scale * value + (S[_PLACE[j, l]] if i == k else 0.0)


@njit(cache=True, error_model="numpy")
def _add_point(w, g, nodes, P, A, row, f, stiffness):  # type: ignore[no-untyped-def]
    """Add a Gauss point's forces to f (n, 3) and its tangent to the upper node pairs of ``stiffness``."""
    d, count = g.shape[1], nodes.size
    for a in range(count):
        for i in range(3):
            for j in range(d):
                f[nodes[a], i] += w * P[i, j] * g[a, j]
            for m in range(3 * d):
                value = 0.0
                for j in range(d):
                    value += g[a, j] * A[i * d + j, m]
                row[i, m] = w * value
        for b in range(a, count):
            for i in range(3):
                for k in range(3):
                    value = 0.0
                    for l in range(d):
                        value += row[i, k * d + l] * g[b, l]
                    stiffness[3 * a + i, 3 * b + k] += value


@njit(cache=True, error_model="numpy")
def _scatter(nodes, equations, places, stiffness, K, Kp, Kpp):  # type: ignore[no-untyped-def]
    """Add an element's tangent, of which the upper node pairs are known; arguments as in `assemble`."""
    count = nodes.size
    for m in range(3 * count):
        for n in range(3 * count):
            value = stiffness[m, n] if m // 3 <= n // 3 else stiffness[n, m]
            r, c = equations[nodes[m // 3], m % 3], equations[nodes[n // 3], n % 3]
            if r >= 0 and c >= 0:
                K[places[m, n]] += value
            elif r >= 0 and c <= -2:
                Kp[r, -2 - c] += value
            elif r <= -2 and c <= -2:
                Kpp[-2 - r, -2 - c] += value


@njit(cache=True, error_model="numpy")
def _changed(F, F0, P, S, A, scale, dS, dF0, L, dextra, dF, total):  # type: ignore[no-untyped-def]
    """total (3, d): a parameter's derivative of P at fixed u, with the gradients' own change; dF (3 d,) is scratch."""
    d = F.shape[1]
    trace = 0.0
    for j in range(d):
        trace += L[j, j]
    for i in range(3):
        for j in range(d):
            value = dF0[i, j]
            for k in range(d):
                value += (F[i, k] - F0[i, k]) * L[k, j]
            dF[i * d + j] = value
    for i in range(3):
        for j in range(d):
            value = -trace * P[i, j]
            for k in range(3 * d):
                value += A[i * d + j, k] * dF[k]
            for k in range(d):
                # P Lᵀ g: the gradients' own change
                value += F[i, k] * (dextra[_PLACE[k, j]] + scale * dS[_PLACE[k, j]]) + P[i, k] * L[j, k]
            total[i, j] = value


@njit(
    int64(
        FUNCTION, float64[::1], float64[:, :, :, ::1], float64[:, ::1], int32[:, ::1], int32[:, ::1], int32[:, :, ::1],
        float64[:, ::1], float64[:, ::1], float64, float64[:, :, ::1],
        float64[:, ::1], float64[:, :, ::1], float64[:, ::1], float64[::1], float64[:, ::1], float64[:, ::1],
    ),
    cache=True,
    error_model="numpy",
)  # fmt: skip
def assemble(  # type: ignore[no-untyped-def]
    law, p, gradients, weights, cells, equations, places, F0, u, scale, extra, thickness, elastic, f, K, Kp, Kpp
):
    """Internal forces and tangent of the whole mesh; returns the first element without a value, or -1.

    equations (n, 3) : number of each displacement's equation, -1 held, -2 - i moved by the probe in direction i
    places (e, 3 a, 3 a) : where an entry of an element's tangent lies in ``K``, the data of the free block
    scale, extra (e, q, 6) : the acting stress (module docstring) [-, Pa]
    thickness (e, q) : C33 of a membrane, start and result
    Written: elastic (e, q, 6) S_e [Pa]; f (n, 3) [N]; K, Kp (free, 3), Kpp (3, 3) [N/m].
    """
    d = gradients.shape[3]
    count = cells.shape[1]
    F, P, A = np.empty((3, d)), np.empty((3, d)), np.empty((3 * d, 3 * d))
    C, S, D, none = np.zeros(6), np.empty(6), np.empty((6, 6)), np.empty((p.size, 6))
    stiffness = np.empty((3 * count, 3 * count))
    row = np.empty((3, 3 * d))
    f[:] = 0.0
    K[:] = 0.0
    Kp[:] = 0.0
    Kpp[:] = 0.0
    for e in range(cells.shape[0]):
        nodes = cells[e]
        stiffness[:] = 0.0
        for q in range(weights.shape[1]):
            g = gradients[e, q]
            w = weights[e, q]
            C[2] = thickness[e, q]
            _deformation(F0, u, nodes, g, F, C)
            if d == 2:
                if not plane_stress(law, C, p, False, S, D, none) >= 0.0:
                    return e
                thickness[e, q] = C[2]
            else:
                law(C, p, False, S, D, none)
            for i in range(6):
                elastic[e, q, i] = S[i]
                S[i] = scale * S[i] + extra[e, q, i]
            if not np.isfinite(S.sum()):
                return e
            _nominal(F, S, D, scale, P, A)
            _add_point(w, g, nodes, P, A, row, f, stiffness)
        _scatter(nodes, equations, places[e], stiffness, K, Kp, Kpp)
    return -1


@njit(
    types.void(
        FUNCTION, float64[::1], float64[:, :, :, ::1], float64[:, ::1], int32[:, ::1],
        float64[:, ::1], float64[:, ::1], float64, float64[:, :, ::1],
        float64[:, ::1], float64[:, :, ::1], float64[:, :, ::1], float64[:, ::1], float64[:, :, ::1],
    ),
    cache=True,
)  # fmt: skip
def differentiate(law, p, gradients, weights, cells, F0, u, scale, extra, thickness, dF0, frame, dextra, df):  # type: ignore[no-untyped-def]
    """df (m, n, 3): internal forces' derivatives at fixed u, with respect to the law's parameters, then further ones.

    dF0 (m, 3, d) : derivative of the pre-deformation; frame (m, d, d) : L = G^-1 dG of a mesh that rides on the
    pre-deformed sheet (g_a = G^T dN_a), zero for a mesh on the stress-free sheet; dextra (m, 6) : of the extra stress.
    """
    d = gradients.shape[3]
    many = df.shape[0]
    F, P, A = np.empty((3, d)), np.empty((3, d)), np.empty((3 * d, 3 * d))
    C, S, D, dS = np.zeros(6), np.empty(6), np.empty((6, 6)), np.empty((p.size, 6))
    dF, total, none = np.empty(3 * d), np.empty((3, d)), np.zeros(6)
    df[:] = 0.0
    for e in range(cells.shape[0]):
        nodes = cells[e]
        for q in range(weights.shape[1]):
            g = gradients[e, q]
            C[2] = thickness[e, q]
            _deformation(F0, u, nodes, g, F, C)
            if d == 2:
                plane_stress(law, C, p, True, S, D, dS)
            else:
                law(C, p, True, S, D, dS)
            for i in range(6):
                S[i] = scale * S[i] + extra[e, q, i]
            _nominal(F, S, D, scale, P, A)
            for m in range(many):
                own = dS[m] if m < p.size else none
                _changed(F, F0, P, S, A, scale, own, dF0[m], frame[m], dextra[m], dF, total)
                for a in range(nodes.size):
                    for i in range(3):
                        for j in range(d):
                            df[m, nodes[a], i] += weights[e, q] * total[i, j] * g[a, j]


@njit(
    types.float64(
        FUNCTION, float64[::1], float64[:, ::1], float64, float64[::1], float64,
        float64[::1], float64[:, ::1], float64[:, ::1], float64[:, ::1],
    ),
    cache=True,
)  # fmt: skip
def membrane_point(law, p, F, scale, extra, c33, elastic, P, A, dS):  # type: ignore[no-untyped-def]
    """One membrane point under F (3, 2): writes S_e (6,), P (3, 2), A (6, 6), dS_e/dp (m, 6); returns C33 or NaN."""
    C, D = np.zeros(6), np.empty((6, 6))
    for i in range(3):
        C[0] += F[i, 0] ** 2
        C[1] += F[i, 1] ** 2
        C[3] += F[i, 0] * F[i, 1]
    C[2] = c33
    if not plane_stress(law, C, p, True, elastic, D, dS) >= 0.0:
        return np.nan
    _nominal(F, scale * elastic + extra, D, scale, P, A)
    return C[2]
