"""Ring meshes between the probe patch and the support's hole: quadratic, graded towards the probe.

What lies under the probe moves with it and what lies under the support is held, so only the ring between them deforms.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ..api import Array

Index = NDArray[np.int32]

_GAUSS = np.array([-np.sqrt(0.6), 0.0, np.sqrt(0.6)])
_GAUSS_WEIGHT = np.array([5.0, 8.0, 5.0]) / 9.0


def _quadratic(x: Array) -> tuple[Array, Array]:
    """Values and slopes (points, 3) of the quadratic Lagrange functions at nodes -1, 0, 1."""
    values = np.stack([0.5 * x * (x - 1.0), 1.0 - x**2, 0.5 * x * (x + 1.0)], axis=1)
    return values, np.stack([x - 0.5, -2.0 * x, x + 0.5], axis=1)


def _lagrange(dimension: int) -> tuple[Array, Array]:
    """Gradients (q, a, dimension) and weights (q,) of the reference element at its 3^dimension Gauss points."""
    values, slopes = _quadratic(_GAUSS)
    letters = "ijk"[:dimension], "abc"[:dimension]
    product = ",".join(q + a for q, a in zip(*letters, strict=True)) + "->" + letters[0] + letters[1]
    points = 3**dimension
    gradients = [
        np.einsum(product, *[slopes if axis == d else values for axis in range(dimension)]).reshape(points, points)
        for d in range(dimension)
    ]
    weights = _GAUSS_WEIGHT
    for _ in range(dimension - 1):
        weights = np.multiply.outer(weights, _GAUSS_WEIGHT)
    return np.stack(gradients, axis=2), weights.ravel()


@dataclass(frozen=True, eq=False)
class Mesh:
    """A ring of quadratic elements.

    Attributes
    ----------
    nodes : (n, 2 or 3) positions [m]; the third coordinate runs through the thickness, zero on the mid-plane
    cells : (e, 9 or 27) nodes of each element
    gradients : (e, q, a, 2 or 3) shape function gradients [1/m] at the Gauss points
    weights : (e, q) area [m^2] or volume [m^3] of each Gauss point
    probe, support : (n,) masks of the nodes under the probe's edge and on the hole's edge
    surface : (c, 9) mid-plane nodes of each element; node 3 j + i has i along the radius and j around
    """

    nodes: Array
    cells: Index
    gradients: Array
    weights: Array
    probe: NDArray[np.bool_]
    support: NDArray[np.bool_]
    surface: NDArray[np.int64]

    @property
    def dimension(self) -> int:
        return int(self.nodes.shape[1])


def radii(inner: float, outer: float, elements: int) -> Array:
    """Radii (2 elements + 1,) of node circles: geometric element edges, midside circles half-way."""
    edges = inner * (outer / inner) ** (np.arange(elements + 1) / elements)
    circles = np.empty(2 * elements + 1)
    circles[::2] = edges
    circles[1::2] = 0.5 * (edges[1:] + edges[:-1])
    return circles


@lru_cache(maxsize=32)
def ring(inner: float, outer: float, radial: int, around: int, layers: int = 0, thickness: float = 0.0) -> Mesh:
    """Mesh the ring inner <= r <= outer [m] with radial x around elements.

    ``layers`` > 0 makes a solid of that many elements through ``thickness`` [m]; 0 makes a membrane.
    """
    circles = radii(inner, outer, radial)
    angle = np.arange(2 * around) * (np.pi / around)
    grid = np.arange(circles.size * angle.size).reshape(circles.size, angle.size)
    plane = np.stack([np.outer(circles, np.cos(angle)), np.outer(circles, np.sin(angle))], axis=2).reshape(-1, 2)
    on_probe = np.repeat(np.arange(circles.size) == 0, angle.size)
    on_support = np.repeat(np.arange(circles.size) == circles.size - 1, angle.size)

    i, j = (x.ravel() for x in np.meshgrid(2 * np.arange(radial), 2 * np.arange(around), indexing="ij"))
    patches = np.stack(
        [grid[i + a, (j + b) % angle.size] for a in range(3) for b in range(3)], axis=1
    )  # local node 3 a + b: a radial, b around
    surface = patches.reshape(-1, 3, 3).transpose(0, 2, 1).reshape(-1, 9).astype(np.int64)
    if layers == 0:
        nodes, cells = plane, patches
    else:
        levels = 2 * layers + 1
        height = np.linspace(-0.5, 0.5, levels) * thickness
        nodes = np.concatenate([np.tile(plane, (levels, 1)), np.repeat(height, len(plane))[:, None]], axis=1)
        cells = np.concatenate(
            [
                np.stack([patches + (2 * k + c) * len(plane) for c in range(3)], axis=2).reshape(len(patches), 27)
                for k in range(layers)
            ]
        )
        on_probe, on_support = np.tile(on_probe, levels), np.tile(on_support, levels)
        surface = surface + layers * len(plane)

    local, weights = _lagrange(nodes.shape[1])
    jacobian = np.einsum("ead,qal->eqdl", nodes[cells], local)
    determinant = np.linalg.det(jacobian)
    gradients = np.einsum("qal,eqld->eqad", local, np.linalg.inv(jacobian))
    return Mesh(
        nodes,
        cells.astype(np.int32),
        np.ascontiguousarray(gradients),
        np.abs(determinant) * weights,
        on_probe,
        on_support,
        surface,
    )
