"""A model quick enough to be fitted a hundred times, and recordings of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from recovery import Info, Recording, Series

from skinrig_solver import Cost, Experiment, ModelInfo, Parameter, Result, SolverError
from skinrig_solver.fit import FitResult, fit
from skinrig_solver.fit import spec as spec_module

Formula = Callable[[Mapping[str, float], np.ndarray], tuple[np.ndarray, Mapping[str, np.ndarray]]]


def answer(
    time: np.ndarray, height: np.ndarray, slopes: Mapping[str, np.ndarray], sensitivities: Sequence[str]
) -> Result:
    """A result of one channel, with the slopes that were asked for."""
    wanted = {"apex_height": np.stack([slopes[n] for n in sensitivities], axis=1)} if sensitivities else None
    return Result(time, {"apex_height": height}, tuple(sensitivities), wanted, Cost())


def suction(label: str, instrument: str, time: np.ndarray, pressure: np.ndarray, height: np.ndarray) -> Recording:
    streams = {"pressure": Series(time, pressure, "Pa"), "apex_height": Series(time, height, "m")}
    return Recording(Info(label, instrument), streams)


@dataclass(frozen=True)
class Curve:
    """height = formula(parameters, s), s the time in units of the whole run; the formula gives its slopes as well."""

    info: ModelInfo
    formula: Formula

    def simulate(
        self, experiment: Experiment, parameters: Mapping[str, float], sensitivities: Sequence[str] = ()
    ) -> Result:
        time = experiment.time
        return answer(time, *self.formula(self.info.complete(parameters), time / time[-1]), sensitivities)

    def fit(self, truth: Mapping[str, float], noise: float, seed: int, size: int = 300, **spec: Any) -> FitResult:
        """A fit of ``size`` samples with white ``noise`` [m] and of a known zero."""
        time = np.linspace(0.0, 1.0, size)
        height = self.simulate(Experiment("cutometer", time, {"pressure": -1e4 * time}), truth).channels["apex_height"]
        height = height + noise * np.random.default_rng(seed).standard_normal(time.size)
        return fit([suction("run", "cutometer", time, -1e4 * time, height)], {"zero": "fixed", **spec}, model=self)


@pytest.fixture
def named(monkeypatch: pytest.MonkeyPatch) -> Callable[[ModelInfo], None]:
    """named(info): specifications may name this model, and no other."""
    return lambda info: monkeypatch.setattr(spec_module, "_info", lambda name: info)


@pytest.fixture
def curve(named: Callable[[ModelInfo], None]) -> Callable[..., Curve]:
    """curve(formula, *parameters) -> a model that specifications may name."""

    def make(formula: Formula, *parameters: Parameter) -> Curve:
        info = ModelInfo("curve", "suction", parameters, ("apex_height",), "a test", "test")
        named(info)
        return Curve(info, formula)

    return make


class Dashpot:
    """height = a s + b s^2 + c (s - q), with s the suction over 10 kPa and q following it with the time constant tau.

    ``twin`` adds to ``a`` only: the two cannot be told apart. Above a = 1e-2 the model breaks down.
    """

    info = ModelInfo(
        "dashpot",
        "suction",
        (
            Parameter("a", "m", 1e-6, 1e-1, 1e-4, "slope", "test", "log"),
            Parameter("b", "m", -1e-3, 1e-3, 2e-5, "curvature", "test"),
            Parameter("c", "m", 0.0, 1e-3, 5e-5, "instantaneous part", "test"),
            Parameter("tau", "s", 1e-2, 1e2, 1.0, "time constant", "test", "log"),
            Parameter("twin", "m", 0.0, 1e-3, 0.0, "the same as a", "test"),
        ),
        ("apex_height",),
        "a test",
        "test",
    )

    def simulate(
        self, experiment: Experiment, parameters: Mapping[str, float], sensitivities: Sequence[str] = ()
    ) -> Result:
        p = self.info.complete(parameters)
        if p["a"] > 1e-2:
            raise SolverError("it broke", time=1.0)
        time, s = experiment.time, -experiment.drive["pressure"] / 1e4
        q, dq = np.zeros_like(s), np.zeros_like(s)
        for k in range(1, s.size):  # backward Euler: differentiable exactly
            dt = time[k] - time[k - 1]
            q[k] = (q[k - 1] + dt / p["tau"] * s[k]) / (1 + dt / p["tau"])
            dq[k] = (dq[k - 1] + dt / p["tau"] ** 2 * (q[k] - s[k])) / (1 + dt / p["tau"])
        slopes = {"a": s, "b": s**2, "c": s - q, "tau": -p["c"] * dq, "twin": s}
        height = (p["a"] + p["twin"]) * s + p["b"] * s**2 + p["c"] * (s - q)
        return answer(time, height, slopes, sensitivities)


@pytest.fixture(scope="session")
def dashpot() -> Dashpot:
    return Dashpot()


@pytest.fixture(scope="session")
def record(dashpot: Dashpot) -> Callable[..., Recording]:
    """record(truth, noise=, seed=, instrument=) -> a noisy recording of steps and ramps of suction."""

    def make(
        truth: Mapping[str, float], noise: float = 0.01, seed: int = 0, instrument: str = "cutometer", **info: Any
    ) -> Recording:
        time = np.linspace(0.0, 20.0, 401)
        pressure = -1e4 * np.interp(time, [0, 1, 1.1, 6, 6.1, 9, 14, 19], [0, 0, 2, 2, 0, 0, 3, 0])
        result = dashpot.simulate(Experiment(instrument, time, {"pressure": pressure}), truth)  # type: ignore[arg-type]
        height = result.channels["apex_height"]
        height = height + noise * np.abs(height).max() * np.random.default_rng(seed).standard_normal(time.size)
        return Recording(
            Info(info.pop("id", f"run-{seed}"), instrument, **info),
            {"pressure": Series(time, pressure, "Pa"), "apex_height": Series(time, height, "m")},
        )

    return make
