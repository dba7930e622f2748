"""Equation numbers and the sparse pattern of a ring mesh: support held, probe moved as one, the rest free."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

from .mesh import Index, Mesh


@dataclass(frozen=True, eq=False)
class System:
    """Numbering of the displacements of a mesh; the codes are explained at kernels.assemble.

    equations (n, 3); places (e, 3 a, 3 a); indptr, indices: the free block's compressed columns; size: free equations.
    """

    equations: Index
    places: NDArray[np.int32]
    indptr: Index
    indices: Index
    size: int


@lru_cache(maxsize=32)
def system(mesh: Mesh, plane: bool = False) -> System:
    """Number the mesh's free displacements; ``plane`` holds the third direction (a membrane moved in its plane)."""
    equations = np.zeros((len(mesh.nodes), 3), dtype=np.int32)
    equations[mesh.support] = -1
    equations[mesh.probe] = [-2, -3, -4]
    if plane:
        equations[:, 2] = -1
    free = equations == 0
    equations[free] = np.arange(free.sum())
    size = int(free.sum())

    numbers = equations[mesh.cells].reshape(len(mesh.cells), -1).astype(np.int64)
    row, column = np.broadcast_arrays(numbers[:, :, None], numbers[:, None, :])
    inside = (row >= 0) & (column >= 0)
    keys, entry = np.unique(column[inside] * size + row[inside], return_inverse=True)
    places = np.full(row.shape, -1, dtype=np.int32)
    places[inside] = entry
    indptr = np.searchsorted(keys, np.arange(size + 1) * size).astype(np.int32)
    return System(equations, places, indptr, (keys % size).astype(np.int32), size)


def matrix(system: System, data: NDArray[np.float64]) -> csc_matrix:
    """The free block as a sparse matrix sharing ``data``."""
    return csc_matrix((data, system.indices, system.indptr), shape=(system.size, system.size))
