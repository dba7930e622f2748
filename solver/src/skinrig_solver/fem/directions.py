"""Kernels of derivatives by parameters: forces and kinematics in m directions at once, unknowns as in `kernels`."""

from __future__ import annotations

import numpy as np
from numba import njit

from ..api import Array
from .kernels import FLAGS
from .mesh import Index


@njit(cache=True, fastmath=FLAGS)
def partial_forces(
    gradients: Array, weights: Array, linear: Array, Theta: Array, dstress: Array, equations: Index, force: Array
) -> None:
    """Add the condensed ∂R/∂parameter at fixed unknowns to ``force`` (equations, m) from dstress (9 E, 6, m)."""
    m = dstress.shape[2]
    Rt = np.empty((3, m))
    R = np.empty((18, m))
    for e in range(weights.shape[0]):
        Rt[:] = 0.0
        R[:] = 0.0
        for k in range(9):
            S, w = dstress[9 * e + k], weights[e, k]
            for a in range(9):
                gr, gz, gt = w * gradients[e, k, a, 0], w * gradients[e, k, a, 1], w * gradients[e, k, a, 2]
                for j in range(m):
                    R[2 * a, j] += gr * S[0, j] + gz * S[1, j] + gt * S[4, j]
                    R[2 * a + 1, j] += gr * S[2, j] + gz * S[3, j]
            for i in range(3):
                for j in range(m):
                    Rt[i, j] += w * linear[k, i] * S[5, j]
        for a in range(18):
            row = equations[e, a]
            if row >= 0:
                for j in range(m):
                    force[row, j] += (
                        R[a, j] + Theta[e, 0, a] * Rt[0, j] + Theta[e, 1, a] * Rt[1, j] + Theta[e, 2, a] * Rt[2, j]
                    )


@njit(cache=True, fastmath=FLAGS)
def partial_kinematics(gradients: Array, linear: Array, Theta: Array, equations: Index, du: Array, dkin: Array) -> None:
    """dkin (9 E, 6, m) of the solution derivatives du (equations, m)."""
    m = du.shape[1]
    dtheta = np.empty((3, m))
    for e in range(equations.shape[0]):
        dtheta[:] = 0.0
        dkin[9 * e : 9 * e + 9] = 0.0
        for a in range(18):
            row = equations[e, a]
            if row < 0:
                continue
            for i in range(3):
                for j in range(m):
                    dtheta[i, j] += Theta[e, i, a] * du[row, j]
            first = 2 * (a % 2)  # r displacements move F_rr, F_rz, F_tt; z displacements F_zr, F_zz
            for k in range(9):
                out = dkin[9 * e + k]
                gr, gz, gt = gradients[e, k, a // 2, 0], gradients[e, k, a // 2, 1], gradients[e, k, a // 2, 2]
                for j in range(m):
                    out[first, j] += gr * du[row, j]
                    out[first + 1, j] += gz * du[row, j]
                if first == 0:
                    for j in range(m):
                        out[4, j] += gt * du[row, j]
        for k in range(9):
            for j in range(m):
                dkin[9 * e + k, 5, j] = dtheta[0, j] + linear[k, 1] * dtheta[1, j] + linear[k, 2] * dtheta[2, j]


@njit(cache=True, fastmath=FLAGS)
def add_products(matrices: Array, vectors: Array, out: Array) -> None:
    """out (points, rows, m) += matrices (points, rows, columns) @ vectors (points, columns, m)."""
    for g in range(out.shape[0]):
        for i in range(out.shape[1]):
            for c in range(matrices.shape[2]):
                factor = matrices[g, i, c]
                if factor != 0.0:
                    for j in range(out.shape[2]):
                        out[g, i, j] += factor * vectors[g, c, j]
