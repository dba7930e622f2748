"""Values at Gauss points brought to the nodes of biquadratic quadrilaterals, for pictures and exports.

Elements number their nodes 3 j + i (i fastest) and their nine Gauss points likewise; VTK numbers corners, mid-sides and
centre.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .api import Array

Index = NDArray[np.int64]
VTK = np.array([0, 2, 8, 6, 1, 5, 7, 3, 4])  # of nodes 3 j + i, counterclockwise
_GAUSS = np.array([-np.sqrt(0.6), 0.0, np.sqrt(0.6)])
_LINE = np.linalg.inv(np.stack([0.5 * _GAUSS * (_GAUSS - 1), 1 - _GAUSS**2, 0.5 * _GAUSS * (_GAUSS + 1)], axis=1))
_TO_NODES = np.kron(_LINE, _LINE)  # (9 nodes, 9 points): the biquadratic function through the points, at the nodes


@dataclass(frozen=True, eq=False)
class Split:
    """The nodes of a mesh once for every layer that they touch.

    ``source`` (k,) node of the mesh behind each node of the split one; ``elements`` (e, 9) in the new numbers;
    ``shared`` (k,) how many elements of its layer meet at a node.
    """

    source: Index
    elements: Index
    shared: Array

    @staticmethod
    def of(elements: NDArray[np.integer], layer: Index) -> Split:
        """Of the elements (e, 9) with their layers (e,)."""
        count = int(elements.max()) + 1
        keys, inverse = np.unique(elements + count * layer[:, None], return_inverse=True)
        own = inverse.reshape(elements.shape)
        return Split(keys % count, own, np.bincount(own.ravel(), minlength=keys.size).astype(np.float64))

    @property
    def cells(self) -> Index:
        """(e, 9) in VTK's order."""
        return self.elements[:, VTK]

    def at_nodes(self, points: Array) -> Array:
        """Values (k, c) at the nodes from values (9 e, c) at the Gauss points.

        Each element's are extrapolated by its own shape functions; where elements of one layer meet, their mean.
        """
        own = np.einsum("np,epc->enc", _TO_NODES, points.reshape(len(self.elements), 9, -1)).reshape(
            self.elements.size, -1
        )
        where = self.elements.ravel()
        sums = [np.bincount(where, column, self.source.size) for column in own.T]
        return np.asarray(np.stack(sums, axis=1) / self.shared[:, None])


def quantities(F: Array, cauchy: Array) -> dict[str, Array]:
    """The stress and stretches that people look at, from nodal F (k, 9) and Cauchy stress (k, 6: xx … xz) [Pa].

    They are derived at the nodes, where a von Mises stress cannot fall below zero as an extrapolated one could.
    """
    gradient, stress = F.reshape(-1, 3, 3), cauchy[:, _FULL]
    stretch = np.linalg.svd(gradient, compute_uv=False)
    mean = np.trace(stress, axis1=1, axis2=2) / 3.0
    deviator = stress - mean[:, None, None] * np.eye(3)
    return {
        "cauchy_stress": cauchy,
        "stress_max": np.linalg.eigvalsh(stress)[:, -1],
        "stress_von_mises": np.sqrt(1.5 * np.einsum("nij,nij->n", deviator, deviator)),
        "pressure": -mean,
        "stretch_max": stretch[:, 0],
        "stretch_min": stretch[:, -1],
        "volume_ratio": np.linalg.det(gradient),
    }


_FULL = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2]])


def six(tensors: Array) -> Array:
    """Symmetric tensors (n, 3, 3) as (n, 6) in the order xx, yy, zz, xy, yz, xz."""
    return tensors[:, [0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2]]
