"""The emulator: exact where it can be, honest about where it was trained, quick."""

from __future__ import annotations

from time import perf_counter

import numpy as np
import pytest

from skinrig_solver.api import Array
from skinrig_solver.emulator import Basis, Emulator, Region, Solve, train

TIME = np.linspace(0.0, 4.0, 600)
BOX = Region(np.array([0.5, -1.0, 2.0]), np.diag([0.3, 0.2, 0.4]), 2.0, np.full(3, -9.0), np.full(3, 9.0))


def decay(z: Array) -> Solve:
    """A relaxing curve exp(z0) (1 − z1 exp(−t exp(−z2))) with its exact slopes."""
    size, rate = np.exp(z[0]), np.exp(-z[2])
    fading = np.exp(-TIME * rate)
    slopes = np.stack([size * (1 - z[1] * fading), -size * fading, -size * z[1] * fading * TIME * rate], axis=1)
    return Solve(z, size * (1 - z[1] * fading), slopes)


def scattered(count: int, seed: int, radius: float = 1.0) -> Array:
    u = np.random.default_rng(seed).standard_normal((count, 3))
    return BOX.points(radius * u / np.linalg.norm(u, axis=1, keepdims=True) * np.linspace(0.2, 1.0, count)[:, None])


@pytest.fixture(scope="module")
def emulator() -> Emulator:
    return train([decay(z) for z in scattered(45, 0)], BOX)


def test_a_cubic_is_met_exactly_with_fewer_solves_than_terms() -> None:
    basis = Basis.of(3, 3)
    weights = np.random.default_rng(1).standard_normal((len(basis.orders), 4))

    def cubic(z: Array) -> Solve:
        u = BOX.units(z[None])
        by_unit = basis.gradients(u)[0] @ weights
        return Solve(z, basis.values(u)[0] @ weights, np.linalg.solve(BOX.shape.T, by_unit).T / BOX.radius)

    found = train([cubic(z) for z in scattered(12, 2)], BOX)  # 20 terms
    assert found.degree == 3
    for z in scattered(5, 3):
        assert found.curves(z[None])[0] == pytest.approx(cubic(z).curve, abs=1e-8)
        assert found.modes @ found.slopes(z) == pytest.approx(cubic(z).slopes, abs=1e-7)


def test_a_curve_is_met_between_training_points_and_more_of_them_help(emulator: Emulator) -> None:
    few = train([decay(z) for z in scattered(9, 0)], BOX)
    points = scattered(20, 5, 0.9)
    error = [max(np.abs(e.curves(z[None])[0] - decay(z).curve).max() for z in points) for e in (emulator, few)]
    assert error[0] < 0.3 * error[1]
    assert error[0] < 5e-3
    slopes = emulator.modes @ emulator.slopes(points[0])
    assert slopes == pytest.approx(decay(points[0]).slopes, abs=0.1)


def test_it_says_where_it_was_trained(emulator: Emulator) -> None:
    assert emulator.inside(scattered(10, 6, 0.99)).all()
    assert not emulator.inside(BOX.centre + np.array([[0.7, 0.0, 0.0]])).any()
    boxed = Region(BOX.centre, BOX.shape, 2.0, BOX.centre - 0.1, BOX.centre + 0.1)
    assert not boxed.holds(BOX.centre[None] + 0.15).any()
    with pytest.raises(ValueError, match="at least two full solves"):
        train([decay(BOX.centre)], BOX)


def test_a_curve_takes_less_than_a_millisecond(emulator: Emulator) -> None:
    points = scattered(20, 7)
    took = []
    for z in points:
        began = perf_counter()
        emulator.curves(z[None])
        took.append(perf_counter() - began)
    assert min(took) < 1e-3  # the quickest: others share the machine
