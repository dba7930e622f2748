"""Meshes refined towards one stretch of the surface: a fine core, rings of growing cells around it, a grid beyond.

A grid alone carries its finest columns down to the bottom. Where strain concentrates at the edge of an opening, rings
reach the same accuracy with a third of the unknowns.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from skinrig_solver.api import Array
from skinrig_solver.fem.mesh import Index, Mesh

_SIDES = np.array([[0, 1, 2], [2, 5, 8], [6, 7, 8], [0, 3, 6]])  # nodes of an element's four sides


def around(core_r: Array, core_depth: Array, r: Array, z: Array, rings: int) -> Array:
    """Corners (E, 4, 2), counterclockwise, of the cells between the axis and r[-1], the surface and z[-1].

    ``core_r`` increasing and ``core_depth`` decreasing from 0: grid lines of the core. ``rings`` of cells lead from the
    core to the axis, to r[0] and to z[0], where grid lines r (increasing) and z (decreasing) take over.
    """
    inner = _border(core_r, core_depth)
    size = np.array([[core_r[0], r[0] - core_r[-1]], [0.0, z[0] - core_depth[-1]]])
    outer_r = r[0] * (core_r - core_r[0]) / (core_r[-1] - core_r[0])
    outer_z = z[0] * core_depth / core_depth[-1]
    outer = _border(outer_r, outer_z)
    # the rings' widths grow as the distance from the core's middle does
    reach = max(abs(float(size[0, 0])), abs(float(size[0, 1])), abs(float(size[1, 1])))
    half = 0.5 * float(core_r[-1] - core_r[0])
    growth = (1.0 + reach / half) ** (np.arange(rings + 1) / rings)
    parts = (growth - 1.0) / (growth[-1] - 1.0)
    lines = [inner + part * (outer - inner) for part in parts]
    cells = [_grid(core_r, core_depth)]
    cells += [np.stack([b[:-1], b[1:], a[1:], a[:-1]], axis=1) for a, b in pairwise(lines)]
    cells.append(_grid(r, outer_z))
    cells.append(_grid(np.concatenate([outer_r, r[1:]]), z))
    return np.concatenate(cells)


def _border(r: Array, z: Array) -> Array:
    """Points down the left side of a grid, along its bottom and up its right side."""
    left = np.stack([np.full(len(z), r[0]), z], axis=1)
    bottom = np.stack([r, np.full(len(r), z[-1])], axis=1)
    right = np.stack([np.full(len(z), r[-1]), z[::-1]], axis=1)
    return np.concatenate([left, bottom[1:], right[1:]])


def _grid(r: Array, z: Array) -> Array:
    a, b = np.meshgrid(np.arange(len(r) - 1), np.arange(len(z) - 1))
    a, b = a.ravel(), b.ravel()
    corners = [(r[a], z[b + 1]), (r[a + 1], z[b + 1]), (r[a + 1], z[b]), (r[a], z[b])]
    return np.stack([np.stack(c, axis=-1) for c in corners], axis=1)


def mesh_of(cells: Array) -> Mesh:
    """The axisymmetric mesh of straight-sided ``cells`` (E, 4, 2) in one layer, 'tissue'; edges as of a block."""
    eta, xi = (g.ravel() for g in np.meshgrid([-1.0, 0.0, 1.0], [-1.0, 0.0, 1.0], indexing="ij"))
    bilinear = 0.25 * np.stack([(1 + s * xi) * (1 + t * eta) for s, t in ((-1, -1), (1, -1), (1, 1), (-1, 1))], axis=1)
    points = np.einsum("nc,ecd->end", bilinear, cells)
    extent = float(np.abs(points).max())
    keys = np.round(points.reshape(-1, 2) / extent * 1e9).astype(np.int64)
    _, at, number = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    nodes, elements = points.reshape(-1, 2)[at], number.reshape(-1, 9)
    sides = elements[:, _SIDES].reshape(-1, 3)

    def along(axis: int, value: float) -> Index:
        on = sides[(np.abs(nodes[sides][:, :, axis] - value) <= 1e-8 * extent).all(axis=1)]
        other = nodes[on][:, :, 1 - axis] * (1.0 if axis == 1 else -1.0)
        on = np.where((other[:, 0] > other[:, 2])[:, None], on[:, ::-1], on)
        found: Index = on[np.argsort(other[:, 1])]
        return found

    edges = {
        "top": along(1, float(nodes[:, 1].max())),
        "bottom": along(1, float(nodes[:, 1].min())),
        "left": along(0, float(nodes[:, 0].min())),
        "right": along(0, float(nodes[:, 0].max())),
    }
    return Mesh(nodes, elements, np.zeros(len(elements), dtype=np.int64), ("tissue",), edges, axisymmetric=True)
