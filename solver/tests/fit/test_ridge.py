"""Errors of parameters that others carry along: on a bound, or along a ridge that bends."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from skinrig_solver import Parameter
from skinrig_solver.fit import FitResult
from skinrig_solver.fit import run as run_module
from skinrig_solver.fit.statistics import Uncertainty, estimates
from skinrig_solver.fit.variables import Free

TRUTH = {"k": 1.0, "a": 0.0, "b": 0.0}


def line(p: Mapping[str, float], s: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """k (1 + ½ (a + b)²) s + 0.05 (a + b) s² + (a − b) s³."""
    sum_ = p["a"] + p["b"]
    height = p["k"] * (1.0 + 0.5 * sum_**2) * s + 0.05 * sum_ * s**2 + (p["a"] - p["b"]) * s**3
    common = p["k"] * sum_ * s + 0.05 * s**2
    return height, {"k": (1.0 + 0.5 * sum_**2) * s, "a": common + s**3, "b": common - s**3}


@pytest.fixture
def fitted(curve: Callable[..., Any]) -> Callable[..., FitResult]:
    model = curve(
        line,
        Parameter("k", "m", 0.0, 10.0, 1.0, "slope", "test"),
        Parameter("a", "m", -10.0, 10.0, 0.5, "one half", "test"),
        Parameter("b", "m", -10.0, 10.0, 0.5, "the other", "test"),
    )

    def go(seed: int, **bounds: float) -> FitResult:
        free = {"k": "free", "a": {"start": 0.2, **bounds}, "b": {"start": 0.2}}
        return model.fit(TRUTH, 0.01, seed, 400, parameters=free, drive="measured", samples=1000)

    return go


def farthest(result: FitResult) -> float:
    return max(
        abs(e.value - TRUTH[e.free.symbol]) / e.standard_error
        for e in result.estimates
        if np.isfinite(e.standard_error)
    )


def test_what_a_bound_carries_along_has_the_error_of_a_free_parameter(fitted: Callable[..., FitResult]) -> None:
    """The bound excludes nothing true; but noise drives ``a`` onto it, and ``b`` must then be where ``a`` lets it."""
    held = [r for r in (fitted(seed, lower=-0.1) for seed in range(12)) if r.estimates[1].at]
    assert len(held) >= 2
    for result in held:
        assert np.isnan(result.estimates[1].standard_error)
        assert result.estimates[2].standard_error > 0.1  # 0.01 with ``a`` held there
        assert farthest(result) < 3.0


def test_a_ridge_that_bends_widens_the_errors_across_it(
    fitted: Callable[..., FitResult], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_module, "traced", lambda problem, optimum, known: known)
    bent = [fitted(seed) for seed in range(6)]
    monkeypatch.setattr(run_module, "widened", lambda problem, optimum, known: known)
    straight = [fitted(seed) for seed in range(6)]
    wider = [b.estimates[0].standard_error / s.estimates[0].standard_error for b, s in zip(bent, straight, strict=True)]
    assert min(wider) >= 1.0
    assert max(wider) > 1.3
    for b, s in zip(bent, straight, strict=True):
        assert b.estimates[0].value == s.estimates[0].value
        assert s.effort.forward_runs <= b.effort.forward_runs <= s.effort.forward_runs + 2


@pytest.mark.parametrize(("size", "correlation", "known"), [(2.0, 0.7, False), (2.0, 0.3, True), (0.3, 0.7, True)])
def test_what_a_long_ridge_carries_along_is_not_known(size: float, correlation: float, known: bool) -> None:
    """``a`` and ``b`` trade with each other, by as much as themselves or by less; ``c`` goes along with them or not."""
    free = tuple(Free(name, 1.0, -10.0, 10.0, log=False) for name in "abc")
    info = {name: SimpleNamespace(unit="1") for name in "abc"}
    variables: Any = SimpleNamespace(free=free, info=info, values=lambda z: dict(zip("abc", z, strict=True)))
    alike = np.array([[1.0, -0.999, correlation], [-0.999, 1.0, -correlation], [correlation, -correlation, 1.0]])
    sizes = np.array([size, size, 0.1])
    uncertainty = Uncertainty(alike * np.outer(sizes, sizes), alike, (1.0,), (1.0,), ("", "", ""), ())
    problem: Any = SimpleNamespace(variables=variables)
    optimum: Any = SimpleNamespace(z=np.ones(3))
    found = estimates(problem, optimum, uncertainty)
    assert [e.identifiable for e in found] == [False, False, known]
