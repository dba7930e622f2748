"""A model quick enough to be fitted a hundred times, and recordings of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pytest
from recovery import Info, Recording, Series

from skinrig_solver import Cost, Experiment, ModelInfo, Parameter, Result, SolverError


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
        wanted = np.stack([slopes[n] for n in sensitivities], axis=1) if sensitivities else None
        return Result(
            time,
            {"apex_height": height},
            tuple(sensitivities),
            None if wanted is None else {"apex_height": wanted},
            Cost(),
        )


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
