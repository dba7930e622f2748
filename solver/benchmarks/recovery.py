"""Do fits find the truth? Simulated noisy recordings of the three instruments, fitted from wrong starts.

Run with ``python benchmarks/recovery.py [seeds [instrument…]]``: prints, for each instrument, in how many seeds every
parameter that the report calls identifiable lies within three of its standard errors, and what a fit costs. The
recordings come from the same forward models, so this is a test of the identification, not of the models.
"""

from __future__ import annotations

import os

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")  # before numpy is imported

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from skinrig_solver import Experiment, models
from skinrig_solver.fit import FitResult, fit
from skinrig_solver.fit.cases import DRIVES, MEASURED_AS

UNIT = {"pressure": "Pa", "apex_height": "m"}


@dataclass(frozen=True)
class Info:
    id: str
    instrument: str
    protocol: str = ""


@dataclass(frozen=True)
class Series:
    time: np.ndarray
    value: np.ndarray
    unit: str


@dataclass(frozen=True)
class Recording:
    """As much of a recording as a fit reads."""

    info: Info
    streams: Mapping[str, Series]
    setpoints: Mapping[str, Series] = field(default_factory=dict)


def unit(channel: str) -> str:
    return UNIT.get(channel, "N" if channel.startswith("force") else "m")


def recorded(model: str, experiment: Experiment, truth: Mapping[str, float], noise: float, seed: int) -> Recording:
    """A recording of a simulated experiment: white noise of ``noise`` times each channel's largest value."""
    random = np.random.default_rng(seed)
    streams = {name: Series(experiment.time, values, unit(name)) for name, values in experiment.drive.items()}
    result = models()[model].simulate(experiment, truth)
    for channel, values in result.channels.items():
        name = MEASURED_AS.get(channel, channel)
        noisy = values + noise * np.abs(values).max() * random.standard_normal(values.size)
        streams[name] = Series(experiment.time, noisy, unit(name))
    return Recording(Info(experiment.label, experiment.instrument), streams)


def suction_steps(instrument: str, levels: Sequence[float], hold: float, rate: float, label: str) -> Experiment:
    """Suction levels [Pa, negative] held for ``hold`` s, each followed by half as long at rest; ``rate`` in Hz."""
    time = np.arange(0.0, 1.0 + 1.5 * hold * len(levels), 1.0 / rate)
    edges = [0.0, 1.0]
    values = [0.0, 0.0]
    for k, level in enumerate(levels):
        begin = 1.0 + 1.5 * hold * k
        edges += [begin + 0.05, begin + hold, begin + hold + 0.05, begin + 1.5 * hold]
        values += [level, level, 0.0, 0.0]
    return Experiment(instrument, time, {"pressure": np.interp(time, edges, values)}, label=label)  # type: ignore[arg-type]


def triangles(
    directions: Sequence[tuple[float, float, float]], amplitude: float, rate: float, label: str
) -> Experiment:
    """One triangle of 0.1 Hz along each direction."""
    time = np.arange(0.0, 10.0 * len(directions), 1.0 / rate)
    height = amplitude * (1.0 - np.abs((time % 10.0) / 5.0 - 1.0))
    way = np.array(directions)[np.minimum((time // 10.0).astype(int), len(directions) - 1)]
    drive = {name: height * way[:, k] for k, name in enumerate(DRIVES["sheet"])}
    return Experiment("microrobot", time, drive, {"radial": 4, "around": 8}, label=label)


@dataclass(frozen=True)
class Setting:
    """A recovery: experiments of one model, the truth, and how far off the fit starts."""

    name: str
    model: str
    experiments: tuple[Experiment, ...]
    truth: Mapping[str, float]

    def run(self, seed: int, noise: float = 0.01, wrong: float = 0.3, **options: Any) -> FitResult:
        """Fit noisy recordings from starts ``wrong`` off, up or down at random."""
        random = np.random.default_rng([seed, 1])
        recordings = [
            recorded(self.model, e, self.truth, noise, 1000 * seed + k) for k, e in enumerate(self.experiments)
        ]
        starts = {s: v * (1.0 + wrong * random.choice([-1.0, 1.0])) for s, v in self.truth.items()}
        geometry = self.experiments[0].geometry
        parameters = {s: {"start": v} for s, v in starts.items()}
        spec = {"model": self.model, "parameters": parameters, "geometry": geometry}
        tight = {"tolerance": 1e-7}  # stopping early must not be taken for noise
        return fit(recordings, spec | tight | options)

    def errors(self, result: FitResult) -> dict[str, float]:
        """Distance from the truth in standard errors, of the parameters called identifiable."""
        return {
            e.free.symbol: (e.value - self.truth[e.free.symbol]) / e.standard_error
            for e in result.estimates
            if e.identifiable
        }


YEOH = {"G": 2.0e4, "c20": 1.0e4, "g1": 0.2, "tau1": 0.8}
SETTINGS = (
    Setting(
        "cutometer",
        "suction_yeoh_qlv",
        (suction_steps("cutometer", (-1.5e4, -3.0e4), 4.0, 50.0, "cutometer"),),
        YEOH,
    ),
    Setting(
        "aspiration",
        "suction_yeoh_qlv",
        (suction_steps("aspiration", (-1.0e4, -2.0e4), 6.0, 25.0, "aspiration"),),
        YEOH,
    ),
    Setting(
        "microrobot",
        "sheet_ogden",
        (triangles([(1, 0, 0), (0, 1, 0), (0.7, 0.7, 0), (0.8, 0, 0.6)], 1.2e-3, 20.0, "microrobot"),),
        {"mu1": 29.16e3, "mu2": 2.15, "alpha2": 40.09, "sx": 84e3, "sy": 61e3},
    ),
)


def main(seeds: int, names: Sequence[str]) -> None:
    print(f"1 % noise, starts 30 % off, {seeds} seeds; within 3 standard errors: every parameter called identifiable")
    for setting in (s for s in SETTINGS if s.name in names or not names):
        inside, worst, named, runs, seconds = 0, 0.0, 0, [], []
        for seed in range(seeds):
            result = setting.run(seed)
            errors = setting.errors(result)
            largest = max((abs(x) for x in errors.values()), default=np.inf)
            inside += largest <= 3.0
            worst = max(worst, largest)
            named += len(errors)
            runs.append(result.effort.forward_runs)
            seconds.append(result.effort.seconds)
        print(
            f"{setting.name:11s}{setting.model:20s} {inside:2d} of {seeds} seeds, largest {worst:.1f} standard errors; "
            f"{named / seeds:.1f} of {len(setting.truth)} identifiable; "
            f"{np.median(runs):.0f} forward runs, {np.median(seconds):.1f} s"
        )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 20, sys.argv[2:])
