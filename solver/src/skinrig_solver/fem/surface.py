"""Loads on the top surface: follower suction, and unilateral contact with a rigid profile, with Coulomb friction.

Contact pressure λ >= 0 and shear t (per reference area, two Gauss points an edge) are independent unknowns like the
element pressure. λ = s(λ (1 − ε) − c g), s the softplus of width w, smooths the complementarity of λ and gap g; the
Newton path is that of a primal–dual active set (Hintermüller, Ito and Kunisch 2003) without its chatter, and the
penetration ε λ/c vanishes in practice. Coulomb friction likewise: t = clamp(t (1 − ε) − c Δs) to ± μ λ, with slip Δs
along the profile since the last converged step and the clamp made of two softplus.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ..api import Array
from .mesh import Index

FLAGS = {"contract", "nsz"}
COMPLIANCE = 1e-4  # ε


@njit(cache=True)
def rim(r: float, z: float, height: float, opening: float, fillet: float, out: Array) -> None:
    """Gap and arc length to a flat annulus at ``height`` with a rounded inner edge and a vertical bore.

    out = g, ∂g/∂r, ∂g/∂z, ∂²g/∂r², ∂²g/∂r∂z, ∂²g/∂z², then the same six of the arc length s (0 where the flat begins,
    increasing outwards) [m]. The signed distance is exact outside the probe.
    """
    u, v = opening + fillet - r, height + fillet - z  # from the fillet's centre, towards the axis and downwards
    out[:] = 0.0
    if u <= 0.0:
        out[0], out[2] = v - fillet, -1.0
        out[6], out[7] = -u, 1.0
    elif v <= 0.0:
        out[0], out[1] = u - fillet, -1.0
        out[6], out[8] = v - 0.5 * np.pi * fillet, -1.0
    else:
        d2 = u * u + v * v
        d = np.sqrt(d2)
        nr, nz = -u / d, -v / d
        out[0], out[1], out[2] = d - fillet, nr, nz
        out[3], out[4], out[5] = (1.0 - nr * nr) / d, -nr * nz / d, (1.0 - nz * nz) / d
        out[6] = -fillet * np.arctan2(u, v)
        scale = fillet / d2
        out[7], out[8] = scale * v, -scale * u
        out[9], out[10], out[11] = scale * 2.0 * u * v / d2, scale * (v * v - u * u) / d2, -scale * 2.0 * u * v / d2


@njit(cache=True)
def contact_points(
    edges: Index, positions: Array, shapes: Array, height: float, opening: float, fillet: float, out: Array
) -> None:
    """out (points, 12): `rim` at every contact point; positions (N, 2) current, shapes (2, 3)."""
    for e in range(edges.shape[0]):
        for k in range(2):
            r, z = 0.0, 0.0
            for a in range(3):
                r += shapes[k, a] * positions[edges[e, a], 0]
                z += shapes[k, a] * positions[edges[e, a], 1]
            rim(r, z, height, opening, fillet, out[2 * e + k])


@njit(cache=True)
def _softplus(x: float) -> tuple[float, float]:
    """log(1 + exp(x)) and its slope."""
    e = np.exp(-abs(x))
    return np.log1p(e) + max(x, 0.0), (1.0 if x > 0.0 else e) / (1.0 + e)


@njit(cache=True)
def contact(
    shapes: Array,
    weights: Array,
    gap: Array,
    lam: Array,
    shear: Array,
    slip0: Array,
    stiffness: float,
    width: float,
    friction: float,
    scatter: Index,
    equations: Index,
    values: Array,
    residual: Array,
    work: Array,
) -> None:
    """Add contact to the system.

    ``equations`` (edges, 7): three nodes' r, z and the probe's height (−1 fixed); ``scatter`` (edges, 7, 7);
    ``work`` (points, 6): the linearised laws dλ = work0 − work1 dg and dt = work2 − work3 ds + work4 dλ, and
    work5 = ∂t/∂μ at fixed positions and λ.
    """
    b, tang = np.empty(7), np.empty(7)
    for e in range(equations.shape[0]):
        for k in range(2):
            i = 2 * e + k
            G, w = gap[i], weights[i]
            soft, slope = _softplus((lam[i] * (1.0 - COMPLIANCE) - stiffness * G[0]) / width)
            inverse = 1.0 / (1.0 - slope * (1.0 - COMPLIANCE))
            work[i, 0], work[i, 1] = (width * soft - lam[i]) * inverse, stiffness * slope * inverse
            if friction > 0.0:
                trial, limit = shear[i] * (1.0 - COMPLIANCE) - stiffness * (G[6] - slip0[i]), friction * lam[i]
                up, up_slope = _softplus((trial + limit) / width)
                down, down_slope = _softplus((trial - limit) / width)
                stick = up_slope - down_slope
                inverse = 1.0 / (1.0 - stick * (1.0 - COMPLIANCE))
                work[i, 2] = (width * (up - down) - limit - shear[i]) * inverse
                work[i, 3] = stiffness * stick * inverse
                work[i, 5] = (up_slope + down_slope - 1.0) * inverse * lam[i]
                work[i, 4] = (up_slope + down_slope - 1.0) * inverse * friction
            else:
                work[i, 2:6] = 0.0
            for a in range(3):
                n = shapes[k, a]
                b[2 * a], b[2 * a + 1] = n * G[1], n * G[2]
                tang[2 * a], tang[2 * a + 1] = n * G[7], n * G[8]
            b[6], tang[6] = -G[2], -G[8]
            lam_star = lam[i] + work[i, 0]
            shear_star = shear[i] + work[i, 2] + work[i, 4] * work[i, 0]
            for p in range(7):
                row = equations[e, p]
                if row < 0:
                    continue
                residual[row] -= w * (lam_star * b[p] + shear_star * tang[p])
                np_, sp = _second(shapes, k, p)
                for q in range(7):
                    at = scatter[e, p, q]
                    if at < 0:
                        continue
                    nq, sq = _second(shapes, k, q)
                    m = sp + sq  # 0: rr, 1: rz, 2: zz
                    values[at] += w * (
                        work[i, 1] * b[p] * b[q]
                        + tang[p] * (work[i, 3] * tang[q] + work[i, 4] * work[i, 1] * b[q])
                        - np_ * nq * (lam[i] * G[3 + m] + shear[i] * G[9 + m])
                    )


@njit(cache=True)
def _second(shapes: Array, k: int, p: int) -> tuple[float, int]:
    """Factor and direction (0 r, 1 z) of unknown p in the position relative to the probe."""
    return (-1.0, 1) if p == 6 else (shapes[k, p // 2], p % 2)


@njit(cache=True)
def advance(shapes: Array, gap: Array, work: Array, equations: Index, delta: Array, lam: Array, shear: Array) -> None:
    """Advance λ and the shear by the linearised laws for the increment ``delta`` (equations,) of the unknowns."""
    for e in range(equations.shape[0]):
        for k in range(2):
            i = 2 * e + k
            dg, ds = 0.0, 0.0
            for p in range(7):
                if equations[e, p] >= 0:
                    n, direction = _second(shapes, k, p)
                    dg += n * gap[i, 1 + direction] * delta[equations[e, p]]
                    ds += n * gap[i, 7 + direction] * delta[equations[e, p]]
            dlam = work[i, 0] - work[i, 1] * dg
            lam[i] += dlam
            shear[i] += work[i, 2] - work[i, 3] * ds + work[i, 4] * dlam


@njit(cache=True)
def friction_partials(
    shapes: Array,
    weights: Array,
    gap: Array,
    work: Array,
    dfriction: Array,
    dslip0: Array,
    equations: Index,
    force: Array,
) -> None:
    """Add ∂R/∂parameter at fixed unknowns, through μ and the slip at the step's start, to ``force`` (equations, m)."""
    for e in range(equations.shape[0]):
        for k in range(2):
            i = 2 * e + k
            for p in range(7):
                row = equations[e, p]
                if row >= 0:
                    n, direction = _second(shapes, k, p)
                    tang = weights[i] * n * gap[i, 7 + direction]
                    for j in range(force.shape[1]):
                        force[row, j] -= tang * (work[i, 5] * dfriction[j] + work[i, 3] * dslip0[i, j])


@njit(cache=True)
def slip_derivatives(shapes: Array, gap: Array, equations: Index, du: Array, dslip: Array) -> None:
    """dslip (points, m) of the solution derivatives du (equations, m)."""
    dslip[:] = 0.0
    for e in range(equations.shape[0]):
        for k in range(2):
            for p in range(7):
                if equations[e, p] >= 0:
                    n, direction = _second(shapes, k, p)
                    for j in range(du.shape[1]):
                        dslip[2 * e + k, j] += n * gap[2 * e + k, 7 + direction] * du[equations[e, p], j]


@njit(cache=True)
def follower(
    edges: Index,
    nodes: Array,
    u: Array,
    shapes: Array,
    slopes: Array,
    weights: Array,
    pressure: float,
    axisymmetric: bool,
    scatter: Index,
    equations: Index,
    values: Array,
    residual: Array,
) -> None:
    """Add the load of a gauge pressure on the current surface (edges with the body to the right), and its tangent.

    ``equations`` (edges, 6) and ``scatter`` (edges, 6, 6) of the three nodes' r, z; shapes, slopes (3, 3) at the three
    Gauss points with ``weights`` (3,).
    """
    for e in range(edges.shape[0]):
        for k in range(3):
            r, dr, dz = 0.0, 0.0, 0.0
            for a in range(3):
                node = edges[e, a]
                at = nodes[node, 0] + u[node, 0]
                r += shapes[k, a] * at
                dr += slopes[k, a] * at
                dz += slopes[k, a] * (nodes[node, 1] + u[node, 1])
            ring = 2.0 * np.pi * r if axisymmetric else 1.0
            dring = 2.0 * np.pi if axisymmetric else 0.0
            w = weights[k] * pressure
            for a in range(3):
                n = shapes[k, a] * w
                for c in range(2):
                    row = equations[e, 2 * a + c]
                    if row < 0:
                        continue
                    normal = -dz if c == 0 else dr  # outward normal times line element
                    residual[row] += n * ring * normal
                    # normal and ring move with the nodes: dz with z, dr and the ring with r
                    turns_r, turns_z = (0.0, -n * ring) if c == 0 else (n * ring, 0.0)
                    for b in range(3):
                        at_r, at_z = scatter[e, 2 * a + c, 2 * b], scatter[e, 2 * a + c, 2 * b + 1]
                        if at_r >= 0:
                            values[at_r] += n * dring * shapes[k, b] * normal + turns_r * slopes[k, b]
                        if at_z >= 0:
                            values[at_z] += turns_z * slopes[k, b]
