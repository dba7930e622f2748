"""Errors of the others where a parameter ends on a bound at which no curve feels it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest
from recovery import distance

from skinrig_solver import Parameter
from skinrig_solver.fit import FitResult
from skinrig_solver.fit import run as run_module

TRUTH = {"k": 1.0, "b": 0.05}


def backed(p: Mapping[str, float], s: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """(k + 10 b²) s + b cos(9 s) / 50: near b = 0 nothing tells that more of b would take from k."""
    height = (p["k"] + 10.0 * p["b"] ** 2) * s + 0.02 * p["b"] * np.cos(9.0 * s)
    return height, {"k": s, "b": 20.0 * p["b"] * s + 0.02 * np.cos(9.0 * s)}


@pytest.fixture
def fitted(curve: Callable[..., Any]) -> Callable[[int], FitResult]:
    model = curve(
        backed,
        Parameter("k", "m", 0.1, 10.0, 1.0, "slope", "test"),
        Parameter("b", "m", 0.0, 1.0, 0.05, "backing", "test"),
    )
    return lambda seed: model.fit(TRUTH, 0.02, seed, parameters={"k": "free", "b": "free"})


def off(result: FitResult) -> float:
    return abs(distance(result.estimates[0], TRUTH["k"]))


def test_a_parameter_that_nothing_feels_on_its_bound_widens_the_others(
    fitted: Callable[[int], FitResult], monkeypatch: pytest.MonkeyPatch
) -> None:
    results = {seed: fitted(seed) for seed in range(16)}
    held = [seed for seed, r in results.items() if r.estimates[1].at == "lower"]
    assert len(held) >= 3
    assert max(off(results[seed]) for seed in held) < 3.0
    monkeypatch.setattr(run_module, "released", lambda problem, optimum, known: known)
    assert max(off(fitted(seed)) for seed in held) > 5.0
    free = next(seed for seed in results if seed not in held)
    assert fitted(free).estimates[0].standard_error == results[free].estimates[0].standard_error


@pytest.mark.parametrize("upper", [1.0, 1e9])
def test_a_range_of_any_width_puts_nothing_on_a_bound_that_is_not(upper: float, curve: Callable[..., Any]) -> None:
    """A share of a range of 1e9 is 1e5: a stiffness of one lay 'on its bound' of zero."""

    def line(p: Mapping[str, float], s: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        return p["k"] * s, {"k": s}

    model = curve(line, Parameter("k", "m", 0.0, upper, 0.5, "slope", "test"))
    (found,) = model.fit({"k": 0.7}, 0.02, 1, parameters={"k": {"start": 0.4}}).estimates
    assert not found.at
    assert found.identifiable
    assert found.value == pytest.approx(0.7, abs=5.0 * found.standard_error)
