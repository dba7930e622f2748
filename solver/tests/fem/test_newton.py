"""What Newton's method decides from the sizes of its corrections, in units of the length scale."""

from __future__ import annotations

from math import inf, isnan, nan

import numpy as np
import pytest

from skinrig_solver.fem.kernels import largest
from skinrig_solver.fem.newton import MAX_NEWTON, Newton


def iterations(newton: Newton, sizes: list[float]) -> list[tuple[bool, bool]]:
    """After each correction: whether it was the last, and whether the next one needs a tangent of its own."""
    found = []
    for size in sizes:
        assert newton.begins()
        found.append((newton.converges(size), newton.renew))
    return found


def test_tangents_of_the_step_end_where_correction_times_contraction_is_small() -> None:
    assert iterations(Newton(1.0, False), [1e-2, 9e-5]) == [(False, True), (True, True)]
    assert iterations(Newton(1.0, False), [1e-3, 9e-5]) == [(False, True), (False, True)]


def test_a_first_correction_counts_as_one_that_does_not_contract() -> None:
    assert iterations(Newton(1.0, False), [9e-7]) == [(True, True)]
    assert iterations(Newton(1.0, False), [2e-6]) == [(False, True)]


def test_an_old_tangent_serves_while_few_iterations_are_left_and_is_believed_less() -> None:
    newton = Newton(1.0, True)
    assert iterations(newton, [5e-4, 5e-6]) == [(False, False), (False, False)]
    assert iterations(newton, [4e-7]) == [(True, False)]
    assert newton.tangents == 0
    assert iterations(Newton(1.0, True), [5e-3]) == [(False, True)]


def test_an_old_tangent_whose_corrections_grow_is_given_up() -> None:
    newton = Newton(1.0, True)
    iterations(newton, [1e-4])
    assert newton.begins()
    assert newton.strays(2e-4)
    assert newton.renew
    assert newton.previous == inf
    assert not newton.strays(1.0)  # tangents of the step may begin far away


def test_tangents_are_counted() -> None:
    newton = Newton(1.0, False)
    iterations(newton, [1.0] * MAX_NEWTON)
    assert not newton.begins()
    assert newton.diverges(2.1)
    assert not newton.diverges(1.9)


def test_a_correction_moves_no_node_beyond_half_the_scale() -> None:
    newton = Newton(2.0, False)
    assert newton.share(4.0) == pytest.approx(0.25)
    assert newton.share(0.5) == newton.share(0.0) == 1.0


def test_the_largest_correction_is_nan_where_one_is() -> None:
    delta = np.array([[1.0], [-3.0], [2.0]])
    assert largest(delta) == 3.0
    for i in range(3):
        with_nan = delta.copy()
        with_nan[i] = nan
        assert isnan(largest(with_nan))
