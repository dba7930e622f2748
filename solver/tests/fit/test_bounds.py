"""Errors of the others where a parameter ends on a bound at which no curve feels it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pytest
from recovery import Info, Recording, Series, distance

from skinrig_solver import Cost, Experiment, ModelInfo, Parameter, Result
from skinrig_solver.fit import FitResult, fit
from skinrig_solver.fit import run as run_module
from skinrig_solver.fit import spec as spec_module

TRUTH = {"k": 1.0, "b": 0.05}


class Backed:
    """height = (k + 10 b²) s + b cos(9 s) / 50: near b = 0 nothing tells that more of b would take from k."""

    info = ModelInfo(
        "backed",
        "suction",
        (
            Parameter("k", "m", 0.1, 10.0, 1.0, "slope", "test"),
            Parameter("b", "m", 0.0, 1.0, 0.05, "backing", "test"),
        ),
        ("apex_height",),
        "a test",
        "test",
    )

    def simulate(
        self, experiment: Experiment, parameters: Mapping[str, float], sensitivities: Sequence[str] = ()
    ) -> Result:
        p, s = self.info.complete(parameters), experiment.time / experiment.time[-1]
        slopes = {"k": s, "b": 20.0 * p["b"] * s + 0.02 * np.cos(9.0 * s)}
        wanted = {"apex_height": np.stack([slopes[n] for n in sensitivities], axis=1)} if sensitivities else None
        height = (p["k"] + 10.0 * p["b"] ** 2) * s + 0.02 * p["b"] * np.cos(9.0 * s)
        return Result(experiment.time, {"apex_height": height}, tuple(sensitivities), wanted, Cost())


@pytest.fixture(autouse=True)
def _known(monkeypatch: pytest.MonkeyPatch) -> None:
    """Specifications may name the test's model."""
    monkeypatch.setattr(spec_module, "_info", lambda name: Backed.info)


def fitted(seed: int) -> FitResult:
    time = np.linspace(0.0, 1.0, 300)
    pressure = -1e4 * time
    height = Backed().simulate(Experiment("cutometer", time, {"pressure": pressure}), TRUTH).channels["apex_height"]
    noisy = height + 0.02 * np.random.default_rng(seed).standard_normal(time.size)
    streams = {"pressure": Series(time, pressure, "Pa"), "apex_height": Series(time, noisy, "m")}
    return fit(
        [Recording(Info("run", "cutometer"), streams)], {"parameters": {"k": "free", "b": "free"}}, model=Backed()
    )


def off(result: FitResult) -> float:
    return abs(distance(result.estimates[0], TRUTH["k"]))


def test_a_parameter_that_nothing_feels_on_its_bound_widens_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    results = {seed: fitted(seed) for seed in range(16)}
    held = [seed for seed, r in results.items() if r.estimates[1].at == "lower"]
    assert len(held) >= 3
    assert max(off(results[seed]) for seed in held) < 3.0
    monkeypatch.setattr(run_module, "released", lambda problem, optimum, known: known)
    assert max(off(fitted(seed)) for seed in held) > 5.0
    free = next(seed for seed in results if seed not in held)
    assert fitted(free).estimates[0].standard_error == results[free].estimates[0].standard_error
