"""Prony terms as their relaxation function: derivatives, ties, and what it spares an emulator."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from skinrig_solver import models
from skinrig_solver.api import Array
from skinrig_solver.emulator import Region, Solve, train
from skinrig_solver.fit import read_spec
from skinrig_solver.fit.features import exchanges, features, relaxes_wholly, series
from skinrig_solver.fit.variables import Variables

YEOH = models()["suction_yeoh_qlv"].info
TIME = np.linspace(0.05, 30.0, 300)
CASE: Any = SimpleNamespace(experiment=SimpleNamespace(time=TIME))


def variables(**parameters: Any) -> Variables:
    return read_spec({"model": YEOH.name, "parameters": parameters}, YEOH).variables(YEOH)


FREE = variables(G={"start": 2e4}, g1={"start": 0.2}, tau1={"start": 0.5}, g2={"tied": "g1", "factor": 0.5}, tau2=20.0)


def test_rates_are_the_derivatives() -> None:
    own = features(FREE, [CASE])
    assert own is not None
    z = FREE.start + 0.3 * np.random.default_rng(0).standard_normal((5, 3))
    rates = own.rates(z)
    for k, step in enumerate(1e-6 * np.eye(3)):
        assert rates[:, :, k] == pytest.approx((own.values(z + step) - own.values(z - step)) / 2e-6, abs=1e-7)


def test_without_a_free_prony_term_there_are_none() -> None:
    assert features(variables(G="free", g1=0.2), [CASE]) is None


def test_terms_that_leave_no_stress_are_refused() -> None:
    wide = variables(g1={"start": 0.6}, g2={"start": 0.3})
    z = np.array([wide.start, [f.coordinate(v) for f, v in zip(wide.free, (0.6, 0.5), strict=True)]])
    assert list(relaxes_wholly(series(wide), z)) == [False, True]


def test_two_relaxations_need_few_solves_over_a_wide_range_of_time_constants() -> None:
    """Polynomials of the parameters do not follow time constants over a factor of a hundred, those of features do."""
    free = variables(G={"start": 2e4}, g1={"start": 0.2}, tau1={"start": 0.7}, g2={"start": 0.25}, tau2={"start": 13.0})
    own = features(free, [CASE])
    region = Region(free.start, np.diag([0.15, 0.2, 0.6, 0.3, 0.8]), 3.0, *free.bounds)

    def curve(z: Array) -> Array:
        """A creeping height, stiffening, in deviations of a noise of 1 %."""
        p = free.values(z)
        left = 1.0 - sum(p[f"g{i}"] * (1.0 - np.exp(-TIME / p[f"tau{i}"])) for i in (1, 2))
        return np.asarray(100.0 * (2e4 / (p["G"] * left)) ** 0.7)

    def solve(z: Array) -> Solve:
        steps = 1e-6 * np.eye(z.size)
        return Solve(z, curve(z), np.stack([(curve(z + s) - curve(z - s)) / 2e-6 for s in steps], axis=1))

    random = np.random.default_rng(1)

    def points(count: int) -> Array:
        u = random.standard_normal((count, 5))
        return region.points(u / np.maximum(np.linalg.norm(u, axis=1, keepdims=True), 3.0))

    solves = [solve(z) for z in points(40)]
    held_out = [solve(z) for z in points(40)]
    off = [
        np.median([np.abs(e.curves(s.z[None])[0] - s.curve).max() for s in held_out])
        for e in (train(solves, region), train(solves, region, features=own))
    ]
    assert off[1] < 0.1 * off[0]


def test_terms_with_the_same_priors_are_told_apart_by_their_time_constants() -> None:
    """Sorted points have the same relaxation, the weights' units being different ones."""
    free = variables(g1={"start": 0.2}, tau1={"start": 0.7}, g2={"start": 0.3}, tau2={"start": 13.0})
    (exchange,) = exchanges(free)
    z = free.start + np.random.default_rng(0).standard_normal((40, 4)) * [0.2, 3.0, 0.2, 3.0]
    found = exchange.sorted(z)
    assert exchange.in_order(found).all()
    assert 5 < exchange.in_order(z).sum() < 35
    own = features(free, [CASE])
    assert own is not None
    assert own.values(found) == pytest.approx(own.values(z), rel=1e-12)


def test_terms_with_priors_or_ties_of_their_own_keep_their_places() -> None:
    assert exchanges(FREE) == []  # the second weight is tied to the first
    narrow = {"start": 0.7, "upper": 2.0}
    apart = variables(g1={"start": 0.2}, tau1=narrow, g2={"start": 0.3}, tau2={"start": 13.0})
    assert exchanges(apart) == []
