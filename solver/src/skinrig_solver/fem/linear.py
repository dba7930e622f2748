"""The sparse linear systems of one mesh: pattern and symbolic factorisation once, numbers many times.

MKL PARDISO through pypardiso where it is installed (structurally symmetric, symbolic phase reused), SciPy's SuperLU
else (column ordering reused).
"""

from __future__ import annotations

import os
import weakref
from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from ..api import Array
from .mesh import Index


class Pattern:
    """The CSR pattern that groups of coupled unknowns make, and where each group's entries lie in it.

    ``groups``: arrays (count, size) of equation numbers, −1 for fixed unknowns.
    """

    def __init__(self, size: int, groups: Sequence[Index]) -> None:
        keys = [np.arange(size, dtype=np.int64) * (size + 1)]  # the diagonal
        pairs = []
        for group in groups:
            rows, columns = group[:, :, None], group[:, None, :]
            key = np.where((rows >= 0) & (columns >= 0), rows * size + columns, -1)
            pairs.append(key)
            keys.append(np.unique(key[key >= 0]))
        unique = np.unique(np.concatenate(keys))
        self.size = size
        self.indices = (unique % size).astype(np.int32)
        self.indptr = np.searchsorted(unique, np.arange(size + 1) * size).astype(np.int32)
        self.scatter = [np.where(key >= 0, np.searchsorted(unique, key), -1) for key in pairs]
        self.diagonal = np.searchsorted(unique, keys[0])

    @property
    def nnz(self) -> int:
        return len(self.indices)


class Factor:
    """LU factors of matrices with one pattern. ``backend``: 'pardiso', 'superlu' or None for the best installed."""

    def __init__(self, pattern: Pattern, backend: str | None = None) -> None:
        self.pattern = pattern
        self._matrix: sp.csr_matrix | None = None
        self._pardiso: Any = None
        self._lu: Any = None
        self._order: Index | None = None
        if backend != "superlu":
            self._pardiso = _pardiso()
            if self._pardiso is None and backend == "pardiso":
                raise ImportError("backend 'pardiso' asked for, but pypardiso is not installed")
        if self._pardiso is not None:
            weakref.finalize(self, self._pardiso.free_memory, everything=True)
        self.backend = "superlu" if self._pardiso is None else "pardiso"

    def update(self, values: Array) -> None:
        """Factorise. Raises ``np.linalg.LinAlgError`` for a singular or non-finite matrix."""
        if not np.isfinite(values.sum()):
            raise np.linalg.LinAlgError("the tangent holds numbers that are not finite")
        pattern = self.pattern
        if self._pardiso is not None:
            first = self._matrix is None
            self._matrix = sp.csr_matrix(
                (values, pattern.indices, pattern.indptr), shape=(pattern.size,) * 2, copy=False
            )
            self._call(12 if first else 22, np.zeros(pattern.size))
            return
        matrix = sp.csr_matrix((values, pattern.indices, pattern.indptr), shape=(pattern.size,) * 2).tocsc()
        try:
            if self._order is None:
                self._order = np.argsort(splu(matrix, permc_spec="COLAMD").perm_c)
            self._lu = splu(matrix[:, self._order], permc_spec="NATURAL")
        except RuntimeError as error:
            raise np.linalg.LinAlgError(str(error)) from error

    def solve(self, right: Array) -> Array:
        """K⁻¹ right for right (n,) or (n, m)."""
        if self._pardiso is not None:
            return self._call(33, np.asfortranarray(right))
        assert self._order is not None
        solution = np.empty_like(right)
        solution[self._order] = self._lu.solve(np.ascontiguousarray(right))
        return solution

    def _call(self, phase: int, right: Array) -> Array:
        self._pardiso.set_phase(phase)
        try:
            solution: Array = self._pardiso._call_pardiso(self._matrix, right)
        except Exception as error:  # pypardiso raises its own class with the MKL code
            raise np.linalg.LinAlgError(f"PARDISO phase {phase}: {error}") from error
        return solution


def _pardiso() -> Any:
    os.environ.setdefault("MKL_NUM_THREADS", "1")  # threaded BLAS makes systems this small many times slower
    try:
        import pypardiso
    except (ImportError, OSError):
        return None
    # pypardiso searches the disk for the library for every solver: tell it what it found the first time
    os.environ.setdefault("PYPARDISO_MKL_RT", pypardiso.ps.libmkl._name)
    solver = pypardiso.PyPardisoSolver(mtype=1)  # real, structurally symmetric
    solver.set_iparm(1, 1)
    solver.set_iparm(2, 2)  # nested dissection
    solver.set_iparm(8, 1)  # at most one refinement, and only where pivots were perturbed
    solver.set_iparm(10, 10)  # perturb pivots below 1e-10
    return solver
