"""Products of small matrices against numpy, for numbers of columns that fill vectors and such that do not."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit

from skinrig_solver.api import Array
from skinrig_solver.fem.products import add_product, set_product, subtract_product


@njit
def added(A: Array, B: Array, C: Array) -> None:
    (rows, inner), columns = A.shape, B.shape[1]
    add_product(A, 0, inner, 1, B, 0, columns, C, 0, columns, rows, inner, columns)


@njit
def written(A: Array, B: Array, C: Array) -> None:
    (rows, inner), columns = A.shape, B.shape[1]
    set_product(A, 0, inner, 1, B, 0, columns, C, 0, columns, rows, inner, columns)


@njit
def subtracted_inside(A: Array, start: int, stop: int) -> None:
    """The part of A right of and below ``stop`` less the product of the two parts beside it: a step of elimination."""
    n = A.shape[0]
    left, above, own = stop * n + start, start * n + stop, stop * n + stop
    subtract_product(A, left, n, 1, A, above, n, A, own, n, n - stop, stop - start, n - stop)


@njit
def transposed(A: Array, B: Array, C: Array) -> None:
    (inner, rows), columns = A.shape, B.shape[1]
    add_product(A, 0, 1, rows, B, 0, columns, C, 0, columns, rows, inner, columns)


@pytest.mark.parametrize("columns", [0, 1, 2, 3, 4, 5, 6, 7, 11, 12, 13, 16, 18, 31])
@pytest.mark.parametrize(("rows", "inner"), [(1, 1), (3, 5), (4, 2), (9, 0), (0, 4), (11, 3)])
def test_products_are_those_of_numpy(rows: int, inner: int, columns: int) -> None:
    random = np.random.default_rng(rows + inner + columns)
    A, B, C = (random.standard_normal(shape) for shape in ((rows, inner), (inner, columns), (rows, columns)))
    expected = C + A @ B
    again, alone = C.copy(), np.full_like(C, np.nan)
    added(A, B, C)
    transposed(A.T.copy(), B, again)
    np.testing.assert_allclose(C, expected, atol=1e-13)
    written(A, B, alone)
    np.testing.assert_allclose(again, expected, atol=1e-13)
    np.testing.assert_allclose(alone, A @ B, atol=1e-13)


@pytest.mark.parametrize(("start", "stop"), [(0, 4), (3, 7), (8, 10)])
def test_parts_of_one_matrix_may_be_multiplied(start: int, stop: int) -> None:
    A = np.random.default_rng(0).standard_normal((21, 21))
    expected = A.copy()
    expected[stop:, stop:] -= A[stop:, start:stop] @ A[start:stop, stop:]
    subtracted_inside(A, start, stop)
    np.testing.assert_allclose(A, expected, atol=1e-13)


def test_matrices_whose_numbers_do_not_lie_together_are_refused() -> None:
    A = np.zeros((4, 4))
    with pytest.raises(TypeError, match="contiguous arrays of doubles"):
        added(A[:, ::2], A[:2], A)
