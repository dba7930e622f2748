"""Nine-node quadrilateral meshes, and what of them the kernels need at the Gauss points."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..api import Array

Index = NDArray[np.int64]
GAUSS3 = np.array([-np.sqrt(0.6), 0.0, np.sqrt(0.6)])
WEIGHT3 = np.array([5.0, 8.0, 5.0]) / 9.0
GAUSS2 = np.array([-1.0, 1.0]) / np.sqrt(3.0)


def line_shapes(x: Array) -> tuple[Array, Array]:
    """Quadratic shape functions on nodes −1, 0, 1 and their derivatives: (len(x), 3) each."""
    values = np.stack([0.5 * x * (x - 1.0), 1.0 - x * x, 0.5 * x * (x + 1.0)], axis=-1)
    slopes = np.stack([x - 0.5, -2.0 * x, x + 0.5], axis=-1)
    return values, slopes


def point_shapes(xi: Array, eta: Array) -> tuple[Array, Array]:
    """Biquadratic shape functions (k, 9) and local derivatives (k, 9, 2); node 3 j + i sits at (i − 1, j − 1)."""
    (a, da), (b, db) = line_shapes(xi), line_shapes(eta)
    values = np.einsum("kj,ki->kji", b, a).reshape(-1, 9)
    gradients = np.stack([np.einsum("kj,ki->kji", b, da), np.einsum("kj,ki->kji", db, a)], axis=-1).reshape(-1, 9, 2)
    return values, gradients


@dataclass(frozen=True)
class Mesh:
    """Nodes and elements, elements sorted by layer.

    ``nodes`` (N, 2) reference positions (r, z) or (x, y) [m]; ``elements`` (E, 9) in the order of `point_shapes`;
    ``layer`` (E,) non-decreasing; ``layer_names``; ``edges`` name -> (k, 3) node triples along the boundary, ordered so
    that the body lies to the right; ``axisymmetric`` or plane strain (unit thickness).
    """

    nodes: Array
    elements: Index
    layer: Index
    layer_names: tuple[str, ...]
    edges: dict[str, Index]
    axisymmetric: bool

    @cached_property
    def points(self) -> MeshPoints:
        return MeshPoints.of(self)

    @cached_property
    def layer_points(self) -> list[tuple[int, int]]:
        """First and one-past-last Gauss point of each layer."""
        bounds = np.searchsorted(self.layer, np.arange(len(self.layer_names) + 1)) * 9
        return [(int(a), int(b)) for a, b in pairwise(bounds)]


@dataclass(frozen=True)
class MeshPoints:
    """Per Gauss point (9 an element): ``gradients`` (E, 3, 9, 9) = ∂N/∂r, ∂N/∂z, N/r by point and node; ``weights``
    (E, 9) volumes [m³] (area per unit thickness in plane strain); ``linear`` (9, 3) the discontinuous linear basis
    1, ξ, η; ``inverse_mass`` (E, 3, 3) of that basis."""

    gradients: Array
    weights: Array
    linear: Array
    inverse_mass: Array

    @staticmethod
    def of(mesh: Mesh) -> MeshPoints:
        eta, xi = (g.ravel() for g in np.meshgrid(GAUSS3, GAUSS3, indexing="ij"))
        shapes, local = point_shapes(xi, eta)
        corners = mesh.nodes[mesh.elements]
        jacobian = np.einsum("qad,eac->eqcd", local, corners)
        area = np.linalg.det(jacobian)
        if np.any(area <= 0):
            raise ValueError(f"mesh: element {int(np.argwhere(area <= 0)[0, 0])} is folded or clockwise")
        gradients = np.einsum("qad,eqdc->eqac", local, np.linalg.inv(jacobian))
        weights = area * np.outer(WEIGHT3, WEIGHT3).ravel()
        hoop = np.zeros_like(gradients[..., :1])
        if mesh.axisymmetric:
            radius = np.einsum("qa,ea->eq", shapes, corners[..., 0])
            hoop = (shapes[None] / radius[..., None])[..., None]
            weights = weights * 2.0 * np.pi * radius
        linear = np.stack([np.ones_like(xi), xi, eta], axis=-1)
        mass = np.einsum("eq,qi,qj->eij", weights, linear, linear)
        return MeshPoints(
            np.ascontiguousarray(np.moveaxis(np.concatenate([gradients, hoop], axis=-1), -1, 1)),
            np.ascontiguousarray(weights),
            linear,
            np.linalg.inv(mass),
        )


def graded(start: float, stop: float, first: float, ratio: float) -> Array:
    """Breakpoints from start to stop whose cells grow by about ``ratio`` from about ``first`` [m]."""
    length = abs(stop - start)
    count = max(
        1, round(np.log1p(length / first * (ratio - 1.0)) / np.log(ratio)) if ratio > 1.0 else round(length / first)
    )
    sizes = ratio ** np.arange(count)
    return start + (stop - start) * np.concatenate([[0.0], np.cumsum(sizes) / sizes.sum()])


def block(r: Array, z: Array, layer_of_row: Index, layer_names: tuple[str, ...], axisymmetric: bool) -> Mesh:
    """A rectangular grid with cell breakpoints r (increasing) and z (decreasing from the top surface).

    Rows are numbered from the top; ``layer_of_row`` (len(z) − 1,) is non-decreasing. Edges: top (left to right),
    bottom, left, right.
    """
    columns, rows = len(r) - 1, len(z) - 1
    fine_r, fine_z = (np.insert(v, np.arange(1, len(v)), 0.5 * (v[1:] + v[:-1])) for v in (r, z))
    nr = 2 * columns + 1
    nodes = np.stack(np.meshgrid(fine_r, fine_z, indexing="xy"), axis=-1).reshape(-1, 2)
    row, column = (v.ravel() for v in np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij"))
    corner = (2 * row + 2) * nr + 2 * column  # bottom left: z decreases with the row
    offsets = np.array([[-j * nr + i for i in range(3)] for j in range(3)]).ravel()

    def strip(first: Index, step: int) -> Index:
        return first[:, None] + step * np.arange(3)

    across, down = 2 * np.arange(columns), 2 * nr * np.arange(rows)
    edges = {
        "top": strip(across, 1),
        "bottom": strip(across + 2 * rows * nr, 1),
        "left": strip(down, nr),
        "right": strip(down + nr - 1, nr),
    }
    return Mesh(nodes, corner[:, None] + offsets, np.repeat(layer_of_row, columns), layer_names, edges, axisymmetric)
