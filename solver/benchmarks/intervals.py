"""How often do 95 % intervals of a fit hold the truth, where noise is not what a textbook has?

    python benchmarks/intervals.py [--runs 40] [scenario…]

Simulated Cutometer recordings of a law in closed form, fitted by `skinrig_solver.fit.fit` as any other. Each row is a
scenario: how often an interval of a parameter holds its truth, how far off estimates are in the mean (of the true
value), their scatter over the mean standard error (1 where errors are right), and how many of the fits are trusted.
"""

from __future__ import annotations

import os

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")  # before numpy is imported

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from recovery import Info, Recording, Series
from scipy.signal import lfilter

from skinrig_solver import Cost, Experiment, ModelInfo, Parameter, Result
from skinrig_solver.fit import FitResult, fit

RATE, DURATION, SUCTION = 20.0, 30.0, 30e3  # Hz, s, Pa
PROTOCOL = "setup: {opening: 2 mm}"


class Creep:
    """height = a y + b y^2 with y = s + k q: s the suction over 30 kPa, q following it with the time constant tau.

    Like the Cutometer's models it counts heights from the first sample on.
    """

    info = ModelInfo(
        "creep",
        "suction",
        (
            Parameter("a", "m", 1e-6, 1e-1, 2e-4, "slope", "test", "log"),
            Parameter("b", "m", -1e-3, 1e-3, 2e-5, "curvature", "test"),
            Parameter("k", "", 0.0, 5.0, 0.3, "creep", "test"),
            Parameter("tau", "s", 1e-2, 1e2, 1.0, "time constant", "test", "log"),
        ),
        ("apex_height",),
        "a law in closed form",
        "test",
    )

    def simulate(
        self, experiment: Experiment, parameters: Mapping[str, float], sensitivities: Sequence[str] = ()
    ) -> Result:
        p = self.info.complete(parameters)
        s = -experiment.drive["pressure"] / SUCTION
        x = (experiment.time[1] - experiment.time[0]) / p["tau"]
        forget = ([1.0 / (1.0 + x)], [1.0, -1.0 / (1.0 + x)])  # backward Euler: differentiable exactly
        q = lfilter(*forget, x * s)
        dq = lfilter(*forget, x / p["tau"] * (q - s))
        y = s + p["k"] * q
        rise = p["a"] + 2.0 * p["b"] * y
        slopes = {"a": y, "b": y**2, "k": rise * q, "tau": rise * p["k"] * dq}
        height = p["a"] * y + p["b"] * y**2
        wanted = np.stack([slopes[n] - slopes[n][0] for n in sensitivities], axis=1) if sensitivities else None
        found = None if wanted is None else {"apex_height": wanted}
        return Result(experiment.time, {"apex_height": height - height[0]}, tuple(sensitivities), found, Cost())


TRUTH = {"a": 2e-4, "b": -3e-5, "k": 0.4, "tau": 1.5}
START = {"a": {"start": 3e-4}, "b": {"start": 1e-5}, "k": {"start": 0.2}, "tau": {"start": 0.7}}


@dataclass(frozen=True)
class Scenario:
    """Noise of the height [m] and its correlation from sample to sample, of the gauge [Pa] and its own, and how far
    the height's zero is off [m]."""

    name: str
    height: float = 3e-6
    memory: float = 0.0
    gauge: float = 0.0
    gauge_memory: float = 0.0
    zero: float = 0.0


SCENARIOS = (
    Scenario("white, 3 µm"),
    Scenario("AR(1), 0.95", memory=0.95),
    Scenario("AR(1), 0.99", memory=0.99),
    Scenario("gauge, 3 mbar", gauge=300.0),
    Scenario("gauge, 15 mbar", gauge=1500.0),
    Scenario("gauge, 3 mbar, AR .95", gauge=300.0, gauge_memory=0.95),
    Scenario("zero 5 µm off", zero=5e-6),
    Scenario("all of them", memory=0.95, gauge=900.0, zero=5e-6),
)


def noise(random: np.random.Generator, count: int, deviation: float, memory: float) -> np.ndarray:
    """AR(1) noise (count,), stationary from its first sample on."""
    white = random.standard_normal(count)
    white[1:] *= np.sqrt(1.0 - memory**2)
    return np.asarray(deviation * lfilter([1.0], [1.0, -memory], white))


def recorded(scenario: Scenario, seed: int) -> Recording:
    """A recording of two steps and a triangle, 1 s at rest before them."""
    random = np.random.default_rng(seed)
    time = np.arange(0.0, DURATION, 1.0 / RATE)
    pressure = -SUCTION * np.interp(
        time, [1, 1.1, 8, 8.1, 12, 17, 22, 22.1, 26, 26.1], [0, 1, 1, 0, 0, 1, 0, 0.6, 0.6, 0]
    )
    height = Creep().simulate(Experiment("cutometer", time, {"pressure": pressure}), TRUTH).channels["apex_height"]
    height = height + noise(random, time.size, scenario.height, scenario.memory) + scenario.zero
    measured = pressure + noise(random, time.size, scenario.gauge, scenario.gauge_memory)
    streams = {"pressure": Series(time, measured, "Pa"), "apex_height": Series(time, height, "m")}
    return Recording(Info(f"{scenario.name} {seed}", "cutometer", PROTOCOL), streams)


def study(scenario: Scenario, runs: int) -> list[FitResult]:
    """One fit a seed."""
    return [fit([recorded(scenario, seed)], {"parameters": START}, model=Creep()) for seed in range(runs)]


def coverage(results: Sequence[FitResult]) -> dict[str, float]:
    """Share of the intervals that hold the truth, by parameter."""
    return {
        symbol: float(
            np.mean([r.estimates[k].interval[0] <= TRUTH[symbol] <= r.estimates[k].interval[1] for r in results])
        )
        for k, symbol in enumerate(TRUTH)
    }


def row(scenario: Scenario, results: Sequence[FitResult]) -> str:
    held = coverage(results)
    values = np.array([[e.value for e in r.estimates] for r in results])
    errors = np.array([[e.standard_error for e in r.estimates] for r in results])
    truth = np.array(list(TRUTH.values()))
    off = 100 * (values.mean(axis=0) / truth - 1.0)
    scatter = values.std(axis=0, ddof=1) / errors.mean(axis=0)
    shares = "  ".join(f"{100 * held[s]:3.0f} %" for s in TRUTH)
    return (
        f"{scenario.name:<22} {shares}  {100 * np.mean(list(held.values())):5.1f} %  "
        f"{' '.join(f'{x:+6.2f}' for x in off)}  {' '.join(f'{x:4.2f}' for x in scatter)}  "
        f"{np.mean([r.trusted for r in results]):4.2f}"
    )


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--runs", type=int, default=40)
    parser.add_argument("names", nargs="*")
    options = parser.parse_args()
    print(f"{options.runs} fits a row; 95 % intervals that hold the truth; mean error of the value, %; scatter / error")
    print(f"{'':<22} {'  '.join(f'{s:>5}' for s in TRUTH)}      all  {' '.join(f'{s:>6}' for s in TRUTH)}")
    for scenario in SCENARIOS:
        if not options.names or scenario.name in options.names:
            print(row(scenario, study(scenario, options.runs)), flush=True)


if __name__ == "__main__":
    main()
