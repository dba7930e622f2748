"""Kernels of derivatives by parameters: forces and kinematics in m directions at once, unknowns as in `kernels`."""

from __future__ import annotations

import numpy as np
from numba import njit

from ..api import Array
from .kernels import FLAGS, PARTS
from .mesh import Index
from .products import add_product


@njit(cache=True, fastmath=FLAGS)
def partial_forces(
    gradients: Array, weights: Array, linear: Array, Theta: Array, dstress: Array, equations: Index, force: Array
) -> None:
    """Add the condensed ∂R/∂parameter at fixed unknowns to ``force`` (equations, m) from dstress (9 E, 6, m)."""
    m = dstress.shape[2]
    R, Rt = np.empty((18, m)), np.empty((3, m))
    heavy, heavy_linear = np.empty((3, 9, 9)), np.empty((9, 3))
    for e in range(weights.shape[0]):
        R[:] = 0.0
        Rt[:] = 0.0
        for k in range(9):
            for i in range(3):
                heavy_linear[k, i] = weights[e, k] * linear[k, i]
                for a in range(9):
                    heavy[i, k, a] = weights[e, k] * gradients[e, i, k, a]
        first = 54 * e * m
        for i in range(5):
            c, d = PARTS[i]
            add_product(heavy, 81 * d, 1, 9, dstress, first + i * m, 6 * m, R, 9 * c * m, m, 9, 9, m)
        add_product(heavy_linear, 0, 1, 3, dstress, first + 5 * m, 6 * m, Rt, 0, m, 3, 9, m)
        add_product(Theta, 54 * e, 1, 18, Rt, 0, m, R, 0, m, 18, 3, m)
        for a in range(18):
            row = equations[e, a]
            if row >= 0:
                for j in range(m):
                    force[row, j] += R[a, j]


@njit(cache=True, fastmath=FLAGS)
def partial_kinematics(gradients: Array, linear: Array, Theta: Array, equations: Index, du: Array, dkin: Array) -> None:
    """dkin (9 E, 6, m) of the solution derivatives du (equations, m)."""
    m = du.shape[1]
    own, dtheta = np.empty((18, m)), np.empty((3, m))
    dkin[:] = 0.0
    for e in range(equations.shape[0]):
        for a in range(18):
            row = equations[e, a]
            for j in range(m):
                own[a, j] = du[row, j] if row >= 0 else 0.0
        dtheta[:] = 0.0
        add_product(Theta, 54 * e, 18, 1, own, 0, m, dtheta, 0, m, 3, 18, m)
        first = 54 * e * m
        for i in range(5):
            c, d = PARTS[i]
            add_product(gradients, 243 * e + 81 * d, 9, 1, own, 9 * c * m, m, dkin, first + i * m, 6 * m, 9, 9, m)
        add_product(linear, 0, 3, 1, dtheta, 0, m, dkin, first + 5 * m, 6 * m, 9, 3, m)


@njit(cache=True, fastmath=FLAGS)
def add_products(matrices: Array, vectors: Array, out: Array) -> None:
    """out (points, rows, m) += matrices (points, rows, columns) @ vectors (points, columns, m)."""
    points, rows, columns = matrices.shape
    m = out.shape[2]
    for g in range(points):
        add_product(
            matrices, g * rows * columns, columns, 1, vectors, g * columns * m, m, out, g * rows * m, m,
            rows, columns, m,
        )  # fmt: skip
