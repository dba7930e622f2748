"""The sparse linear systems of one mesh: pattern, ordering and fronts once, numbers many times.

Multifrontal LU factors (Duff and Reid, ACM Trans. Math. Softw. 9, 1983) on nested dissection of the cells that couple
the unknowns. Systems here have some hundred unknowns: calls into a general library would cost as much as the numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit, uint64

from ..api import Array
from .mesh import Index
from .products import subtract_product

LEAF = 2  # cells of a part that is not divided further
PANEL = 4  # unknowns eliminated together
EXCHANGE = 10.0  # rows are exchanged for a pivot larger by this
FLAGS = {"contract", "reassoc", "nsz"}


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
            keys.append(key[key >= 0])
        unique = np.sort(np.concatenate(keys))
        unique = unique[np.concatenate([[True], unique[1:] != unique[:-1]])]
        self.size = size
        self.indices = (unique % size).astype(np.int32)
        self.indptr = np.searchsorted(unique, np.arange(size + 1) * size).astype(np.int32)
        self.scatter = [np.where(key >= 0, np.searchsorted(unique, key), -1) for key in pairs]
        self.diagonal = np.searchsorted(unique, keys[0])

    @property
    def nnz(self) -> int:
        return len(self.indices)


@dataclass(frozen=True)
class Fronts:
    """The dense fronts in the order of their elimination.

    ``unknowns`` of front f: ``unknowns[first[f]:first[f + 1]]``, its ``pivots[f]`` pivots ahead; its square matrix
    begins at ``begin[f]`` of the storage; ``into[first[f] + i]`` is the place of unknown i in the front ``parent[f]``
    (−1: none).
    ``where`` (nnz,): the places of the pattern's entries in the storage.
    """

    unknowns: Index
    first: Index
    pivots: Index
    begin: Index
    into: Index
    parent: Index
    where: Index

    @staticmethod
    def of(pattern: Pattern, cells: Index, places: Array) -> Fronts:
        """From ``cells`` (count, size) of coupled unknowns, −1 for none, and their ``places`` (count, 2).

        Raises ValueError where an unknown belongs to no cell.
        """
        needed = np.bincount(cells[cells >= 0], minlength=pattern.size)
        if not needed.all():
            raise ValueError(f"unknown {int(np.argmin(needed))} belongs to no cell")
        found: list[tuple[Index, int, list[int]]] = []  # unknowns, pivots, children
        _dissect(cells, places, needed, np.arange(len(cells)), found)
        sizes = np.array([len(unknowns) for unknowns, _, _ in found])
        first, begin = np.concatenate([[0], np.cumsum(sizes)]), np.concatenate([[0], np.cumsum(sizes**2)])
        parent, into = np.full(len(found), -1), np.full(first[-1], -1)
        place, owner = np.empty(pattern.size, dtype=np.int64), np.empty(pattern.size, dtype=np.int64)
        for f, (unknowns, pivots, children) in enumerate(found):
            place[unknowns] = np.arange(len(unknowns))
            owner[unknowns[:pivots]] = f
            for child in children:
                border = found[child][0][found[child][1] :]
                parent[child] = f
                into[first[child + 1] - len(border) : first[child + 1]] = place[border]
        where = np.empty(pattern.nnz, dtype=np.int64)
        rows = np.repeat(np.arange(pattern.size), np.diff(pattern.indptr))
        of_entry = np.minimum(owner[rows], owner[pattern.indices])  # where the first of the two is eliminated
        order = np.argsort(of_entry, kind="stable")
        bounds = np.searchsorted(of_entry[order], np.arange(len(found) + 1))
        for f, (unknowns, _, _) in enumerate(found):
            place[unknowns] = np.arange(len(unknowns))
            own = order[bounds[f] : bounds[f + 1]]
            where[own] = begin[f] + place[rows[own]] * sizes[f] + place[pattern.indices[own]]
        counts: Index = np.array([pivots for _, pivots, _ in found])
        return Fronts(np.concatenate([u for u, _, _ in found]), first, counts, begin, into, parent, where)


def _dissect(
    cells: Index, places: Array, needed: Index, part: Index, found: list[tuple[Index, int, list[int]]]
) -> Index:
    """Append the fronts of the cells ``part``, children before parents; returns the unknowns left to the outside."""
    flat = cells[part].ravel()
    unknowns, counts = np.unique(flat[flat >= 0], return_counts=True)
    children: list[int] = []
    if len(part) > LEAF:
        left = np.zeros(0, dtype=np.int64)
        for half in _halves(cells, places, part):
            left = np.union1d(left, _dissect(cells, places, needed, half, found))
            children.append(len(found) - 1)
        inside = np.isin(unknowns, left)
        unknowns, counts = unknowns[inside], counts[inside]
    whole = counts == needed[unknowns]
    found.append((np.concatenate([unknowns[whole], unknowns[~whole]]), int(whole.sum()), children))
    outside: Index = unknowns[~whole]
    return outside


def _halves(cells: Index, places: Array, part: Index) -> tuple[Index, Index]:
    """Two parts of similar size that share few unknowns, cut across one of the two directions."""
    best, halves = np.inf, (part, part)
    for axis in (0, 1):
        order = part[np.argsort(places[part, axis], kind="stable")]
        flat = cells[order]
        position = np.broadcast_to(np.arange(len(order))[:, None], flat.shape)[flat >= 0]
        _, number = np.unique(flat[flat >= 0], return_inverse=True)
        low, high = np.full(number.max() + 1, len(order)), np.zeros(number.max() + 1, dtype=np.int64)
        np.minimum.at(low, number, position)
        np.maximum.at(high, number, position)
        # a cut at c parts positions below c from the others: unknowns with low < c <= high belong to both
        begins, ends = (np.bincount(x + 1, minlength=len(order) + 2) for x in (low, high))
        shared = np.cumsum(begins - ends)
        cuts = np.arange(max(1, len(order) // 3), max(2, len(order) - len(order) // 3 + 1))
        cuts = cuts[cuts < len(order)]
        cut = int(cuts[np.argmin(shared[cuts])])
        if shared[cut] < best:
            best, halves = float(shared[cut]), (order[:cut], order[cut:])
    return halves


class Factor:
    """LU factors of matrices with one pattern.

    ``groups``: arrays (count, size) of coupled unknowns, −1 for none; ``places`` (count, 2) of each.
    """

    def __init__(self, pattern: Pattern, groups: Sequence[Index], places: Sequence[Array]) -> None:
        width = max(group.shape[1] for group in groups)
        cells = [np.pad(g, ((0, 0), (0, width - g.shape[1])), constant_values=-1) for g in groups]
        self.fronts = Fronts.of(pattern, np.concatenate(cells), np.concatenate(places))
        self.storage = np.empty(self.fronts.begin[-1])
        self.rows = np.empty(len(self.fronts.unknowns), dtype=np.int64)

    def update(self, values: Array) -> None:
        """Factorise the matrix of CSR data ``values``. Raises ``np.linalg.LinAlgError`` where a pivot is zero or
        not finite."""
        f = self.fronts
        if not _factorise(f.first, f.pivots, f.begin, f.into, f.parent, f.where, values, self.storage, self.rows):
            raise np.linalg.LinAlgError("the tangent is singular or holds numbers that are not finite")

    def solve(self, right: Array) -> Array:
        """K⁻¹ right for right (n,) or (n, m)."""
        solution = np.array(right, order="C")
        self.substitute(solution.reshape(len(solution), -1))
        return solution

    def substitute(self, right: Array) -> None:
        """The same in place, for contiguous (n, m)."""
        f = self.fronts
        _substitute(f.unknowns, f.first, f.pivots, f.begin, self.storage, self.rows, right)


@njit(cache=True, fastmath=FLAGS)
def _factorise(
    first: Index,
    pivots: Index,
    begin: Index,
    into: Index,
    parent: Index,
    where: Index,
    values: Array,
    storage: Array,
    rows: Index,
) -> bool:
    """Eliminate front by front; ``rows[first[f] + k]`` the row of front f that became its k-th pivot."""
    storage[:] = 0.0
    for t in range(where.size):
        storage[where[t]] = values[t]
    for f in range(pivots.size):
        n, m = first[f + 1] - first[f], pivots[f]
        A = storage[begin[f] : begin[f + 1]].reshape(n, n)
        if not _eliminate(A, m, rows[first[f] : first[f] + m]):
            return False
        if parent[f] >= 0:
            g = parent[f]
            size = first[g + 1] - first[g]
            B = storage[begin[g] : begin[g + 1]].reshape(size, size)
            border = into[first[f] + m : first[f + 1]]
            for i in range(border.size):
                row, own = B[border[i]], A[m + i, m:]
                for j in range(border.size):
                    row[uint64(border[j])] += own[j]  # a place that may be negative takes twice as long
    return True


@njit(cache=True, fastmath=FLAGS, error_model="numpy")
def _eliminate(A: Array, m: int, rows: Index) -> bool:
    """Eliminate the first m unknowns of a front, with row exchanges among their rows, four at a time."""
    for start in range(0, m, PANEL):
        stop = min(start + PANEL, m)
        for k in range(start, stop):
            if not _exchange(A, k, m, rows):
                return False
            _within_panel(A, k, stop)
        _beyond_panel(A, start, stop)
    return True


@njit(cache=True, fastmath=FLAGS)
def _exchange(A: Array, k: int, m: int, rows: Index) -> bool:
    """Bring a pivot to row k where its own is far smaller than another; false where there is none."""
    best, at = abs(A[k, k]), k
    for i in range(k + 1, m):
        if abs(A[i, k]) > EXCHANGE * best:
            best, at = abs(A[i, k]), i
    rows[k] = at
    if at != k:
        for j in range(A.shape[0]):
            A[k, j], A[at, j] = A[at, j], A[k, j]
    return bool(0.0 < best < np.inf)


@njit(cache=True, fastmath=FLAGS, error_model="numpy")
def _within_panel(A: Array, k: int, stop: int) -> None:
    pivot, below = A[k], A[k + 1 :]
    inverse = 1.0 / pivot[k]
    for i in range(below.shape[0]):
        row = below[i]
        factor = row[k] * inverse
        row[k] = factor
        for j in range(k + 1, stop):
            row[j] -= factor * pivot[j]


@njit(cache=True, fastmath=FLAGS)
def _beyond_panel(A: Array, start: int, stop: int) -> None:
    n = A.shape[0]
    right = start * n + stop  # the panel's rows beyond its columns
    for k in range(start + 1, stop):
        subtract_product(A, k * n + start, n, 1, A, right, n, A, k * n + stop, n, 1, k - start, n - stop)
    below = stop * n
    subtract_product(A, below + start, n, 1, A, right, n, A, below + stop, n, n - stop, stop - start, n - stop)


@njit(cache=True, fastmath=FLAGS, error_model="numpy")
def _substitute(
    unknowns: Index, first: Index, pivots: Index, begin: Index, storage: Array, rows: Index, x: Array
) -> None:
    """x (n, m) becomes the solution for the right-hand sides it held."""
    m, largest = x.shape[1], 0
    for f in range(pivots.size):
        largest = max(largest, first[f + 1] - first[f])
    y = np.empty((largest, m))
    for f in range(pivots.size):
        n, p, own = first[f + 1] - first[f], pivots[f], unknowns[first[f] : first[f + 1]]
        A = storage[begin[f] : begin[f + 1]].reshape(n, n)
        for k in range(p):
            at = rows[first[f] + k]
            if at != k:
                for j in range(m):
                    x[own[k], j], x[own[at], j] = x[own[at], j], x[own[k], j]
        _gather(x, own, y)
        _forward(A, p, y)
        _spread(y, own, n, x)
    for f in range(pivots.size - 1, -1, -1):
        n, p, own = first[f + 1] - first[f], pivots[f], unknowns[first[f] : first[f + 1]]
        A = storage[begin[f] : begin[f + 1]].reshape(n, n)
        _gather(x, own, y)
        _backward(A, p, y)
        _spread(y, own, p, x)


@njit(cache=True, fastmath=FLAGS)
def _gather(x: Array, own: Index, y: Array) -> None:
    for i in range(own.size):
        for j in range(x.shape[1]):
            y[i, j] = x[own[i], j]


@njit(cache=True, fastmath=FLAGS)
def _spread(y: Array, own: Index, count: int, x: Array) -> None:
    for i in range(count):
        for j in range(x.shape[1]):
            x[own[i], j] = y[i, j]


@njit(cache=True, fastmath=FLAGS)
def _forward(A: Array, p: int, y: Array) -> None:
    n, m = A.shape[0], y.shape[1]
    if m == 1:
        for i in range(n):
            s = y[i, 0]
            for k in range(min(i, p)):
                s -= A[i, k] * y[k, 0]
            y[i, 0] = s
        return
    for i in range(1, p):
        subtract_product(A, i * n, n, 1, y, 0, m, y, i * m, m, 1, i, m)
    subtract_product(A, p * n, n, 1, y, 0, m, y, p * m, m, n - p, p, m)


@njit(cache=True, fastmath=FLAGS, error_model="numpy")
def _backward(A: Array, p: int, y: Array) -> None:
    n, m = A.shape[0], y.shape[1]
    if m == 1:
        for k in range(p - 1, -1, -1):
            s = y[k, 0]
            for i in range(k + 1, n):
                s -= A[k, i] * y[i, 0]
            y[k, 0] = s / A[k, k]
        return
    subtract_product(A, p, n, 1, y, p * m, m, y, 0, m, p, n - p, m)
    for k in range(p - 1, -1, -1):
        subtract_product(A, k * n + k + 1, n, 1, y, (k + 1) * m, m, y, k * m, m, 1, p - 1 - k, m)
        inverse = 1.0 / A[k, k]
        for j in range(m):
            y[k, j] *= inverse
