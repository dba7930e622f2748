"""Errors of parameters that others carry along: on a bound, or along a ridge that bends."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from recovery import Info, Recording, Series

from skinrig_solver import Cost, Experiment, ModelInfo, Parameter, Result
from skinrig_solver.fit import FitResult, fit
from skinrig_solver.fit import run as run_module
from skinrig_solver.fit import spec as spec_module
from skinrig_solver.fit.statistics import Uncertainty, estimates
from skinrig_solver.fit.variables import Free


class Line:
    """height = k (1 + ½ (a + b)²) s + 0.05 (a + b) s² + (a − b) s³, s the time in units of the whole run."""

    info = ModelInfo(
        "line",
        "suction",
        (
            Parameter("k", "m", 0.0, 10.0, 1.0, "slope", "test"),
            Parameter("a", "m", -10.0, 10.0, 0.5, "one half", "test"),
            Parameter("b", "m", -10.0, 10.0, 0.5, "the other", "test"),
        ),
        ("apex_height",),
        "a test",
        "test",
    )

    def simulate(
        self, experiment: Experiment, parameters: Mapping[str, float], sensitivities: Sequence[str] = ()
    ) -> Result:
        p = self.info.complete(parameters)
        s, sum_ = experiment.time / experiment.time[-1], p["a"] + p["b"]
        height = p["k"] * (1.0 + 0.5 * sum_**2) * s + 0.05 * sum_ * s**2 + (p["a"] - p["b"]) * s**3
        common = p["k"] * sum_ * s + 0.05 * s**2
        slopes = {"k": (1.0 + 0.5 * sum_**2) * s, "a": common + s**3, "b": common - s**3}
        wanted = {"apex_height": np.stack([slopes[n] for n in sensitivities], axis=1)} if sensitivities else None
        return Result(experiment.time, {"apex_height": height}, tuple(sensitivities), wanted, Cost())


@pytest.fixture(autouse=True)
def _known(monkeypatch: pytest.MonkeyPatch) -> None:
    """Specifications may name the test's model."""
    monkeypatch.setattr(spec_module, "_info", lambda name: Line.info)


TRUTH = {"k": 1.0, "a": 0.0, "b": 0.0}


def fitted(seed: int, **bounds: float) -> FitResult:
    time = np.linspace(0.0, 1.0, 400)
    pressure = -1e4 * time
    height = Line().simulate(Experiment("cutometer", time, {"pressure": pressure}), TRUTH).channels["apex_height"]
    height = height + 0.01 * height.max() * np.random.default_rng(seed).standard_normal(time.size)
    recording = Recording(
        Info("run", "cutometer"),
        {"pressure": Series(time, pressure, "Pa"), "apex_height": Series(time, height, "m")},
    )
    free = {"k": "free", "a": {"start": 0.2, **bounds}, "b": {"start": 0.2}}
    return fit([recording], {"parameters": free, "drive": "measured", "samples": 1000}, model=Line())


def farthest(result: FitResult) -> float:
    return max(
        abs(e.value - TRUTH[e.free.symbol]) / e.standard_error
        for e in result.estimates
        if np.isfinite(e.standard_error)
    )


def test_what_a_bound_carries_along_has_the_error_of_a_free_parameter() -> None:
    """The bound excludes nothing true; but noise drives ``a`` onto it, and ``b`` must then be where ``a`` lets it."""
    held = [r for r in (fitted(seed, lower=-0.1) for seed in range(12)) if r.estimates[1].at]
    assert len(held) >= 2
    for result in held:
        assert np.isnan(result.estimates[1].standard_error)
        assert result.estimates[2].standard_error > 0.1  # 0.01 with ``a`` held there
        assert farthest(result) < 3.0


def test_a_ridge_that_bends_widens_the_errors_across_it(monkeypatch: pytest.MonkeyPatch) -> None:
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
