"""Do fits find the truth? Simulated noisy recordings of the three instruments, fitted from wrong starts.

    python benchmarks/recovery.py FOLDER [--minutes 15] [--seeds 20] [setting…]   # fits what FOLDER lacks
    python benchmarks/recovery.py FOLDER --table                                  # prints what FOLDER holds

Every fit is one file in FOLDER: a run may be stopped and goes on where it was, and several may share a folder. The
recordings come from the same forward models, so this is a test of the identification, not of the models.
"""

from __future__ import annotations

import os

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")  # before numpy is imported

import argparse
import fcntl
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import radians
from pathlib import Path
from time import monotonic
from types import MappingProxyType
from typing import Any

import numpy as np
from scipy import stats

from skinrig_solver import Experiment, models
from skinrig_solver.fit import FitError, FitResult, fit
from skinrig_solver.fit.cases import DRIVES, MEASURED_AS, cases
from skinrig_solver.fit.problem import Problem
from skinrig_solver.fit.statistics import Estimate
from skinrig_solver.suction.models import SuctionModel

LEVEL = 2.0 * float(stats.norm.sf(3.0))  # how often a fit may miss by chance: as one parameter misses three errors
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


def suction_steps(
    instrument: str,
    levels: Sequence[float],
    hold: float,
    rate: float,
    label: str,
    geometry: Mapping[str, float] = MappingProxyType({}),
) -> Experiment:
    """Suction levels [Pa, negative] held for ``hold`` s, each followed by half as long at rest; ``rate`` in Hz."""
    time = np.arange(0.0, 1.0 + 1.5 * hold * len(levels), 1.0 / rate)
    edges = [0.0, 1.0]
    values = [0.0, 0.0]
    for k, level in enumerate(levels):
        begin = 1.0 + 1.5 * hold * k
        edges += [begin + 0.05, begin + hold, begin + hold + 0.05, begin + 1.5 * hold]
        values += [level, level, 0.0, 0.0]
    drive = {"pressure": np.interp(time, edges, values)}
    return Experiment(instrument, time, drive, dict(geometry), label=label)  # type: ignore[arg-type]


def triangles(
    directions: Sequence[tuple[float, float, float]], amplitude: float, rate: float, label: str
) -> Experiment:
    """One triangle of 0.1 Hz along each direction."""
    time = np.arange(0.0, 10.0 * len(directions), 1.0 / rate)
    height = amplitude * (1.0 - np.abs((time % 10.0) / 5.0 - 1.0))
    way = np.array(directions)[np.minimum((time // 10.0).astype(int), len(directions) - 1)]
    drive = {name: height * way[:, k] for k, name in enumerate(DRIVES["sheet"])}
    return Experiment("microrobot", time, drive, {"radial": 4, "around": 8}, label=label)


def distance(estimate: Estimate, truth: float) -> float:
    """Estimate minus truth in standard errors, in the fit's own coordinate."""
    free = estimate.free
    deviation = estimate.standard_error / free.slope(estimate.value)
    return (free.coordinate(estimate.value) - free.coordinate(truth)) / deviation


def joint_bound(parameters: int, freedom: int) -> float:
    """Standard errors within which all of a fit's ``parameters`` lie together as often as one lies within three.

    Šidák's bound of Student's t: a fit makes one claim of all parameters that it calls identifiable, and of four the
    farthest is beyond three standard errors in 1 % of right fits. ``freedom``: samples less parameters.
    """
    each = 1.0 - (1.0 - LEVEL) ** (1.0 / max(parameters, 1))
    return float(stats.t.isf(0.5 * each, freedom))


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
        starts = {s: v * (1.0 + wrong * random.choice([-1.0, 1.0])) for s, v in self.truth.items()}
        geometry = {**self._opening(), **self.experiments[0].geometry}
        parameters = {s: {"start": v} for s, v in starts.items()}
        spec = {"model": self.model, "parameters": parameters, "geometry": geometry}
        tight = {"tolerance": 1e-7, "zero": "fixed"}  # stopping early must not be taken for noise; the zero is exact
        return fit(self.recordings(seed, noise), spec | tight | options)

    def _opening(self) -> dict[str, Any]:
        """That which the model simulates where nobody says another: its paper's."""
        model = models()[self.model]
        if not isinstance(model, SuctionModel):
            return {}
        return {"opening_radius": model.defaults[self.experiments[0].instrument]["opening_radius"]}

    def recordings(self, seed: int, noise: float) -> list[Recording]:
        """Of every experiment, with noise of its own."""
        return [recorded(self.model, e, self.truth, noise, 1000 * seed + k) for k, e in enumerate(self.experiments)]

    def rise(self, result: FitResult, recordings: Sequence[Recording]) -> float:
        """The objective at the truth less that of the fit, over the variance that the fit leaves: chi-squared with one
        degree of freedom a free parameter, where all curves weigh as their noise does. Below zero the fit ended in a
        worse minimum than the truth's."""
        info = models()[self.model].info
        variables = result.spec.variables(info)
        problem = Problem(self.model, cases(recordings, result.spec, info), variables)
        z = np.array([f.coordinate(self.truth[f.symbol]) for f in variables.free])
        variance = result.objective / (problem.size - z.size)
        return (problem.evaluate(z, derivatives=False).objective - result.objective) / variance

    def errors(self, result: FitResult) -> dict[str, float]:
        """Distance from the truth in standard errors, of the parameters called identifiable.

        Counted in the coordinate that the fit steps in (the logarithm of a modulus), as its 95 % interval is.
        """
        return {e.free.symbol: distance(e, self.truth[e.free.symbol]) for e in result.estimates if e.identifiable}


YEOH = {"G": 2.0e4, "c20": 1.0e4, "g1": 0.2, "tau1": 0.8}
SKIN = {"skin.mu0": 0.086e6, "skin.Gamma2": 67.3, "skin.r2": 6.91, "smas.mu0": 0.004e6}
HALF = {"mesh": 0.5}  # simulated and fitted alike: a test of the fit takes less than half the time
CUTOMETER = suction_steps("cutometer", (-1.5e4, -3.0e4), 4.0, 50.0, "cutometer", HALF)
ASPIRATION = suction_steps("aspiration", (-1.0e4, -2.0e4), 6.0, 25.0, "aspiration", HALF)
ROBOT = triangles([(1, 0, 0), (0, 1, 0), (0.7, 0.7, 0), (0.8, 0, 0.6)], 1.2e-3, 20.0, "microrobot")


def _robot(law: str, **truth: float) -> Setting:
    return Setting(f"microrobot {law}", f"sheet_{law}", (ROBOT,), truth)


SETTINGS = (
    Setting("cutometer", "suction_yeoh_qlv", (CUTOMETER,), YEOH),
    Setting("aspiration", "suction_yeoh_qlv", (ASPIRATION,), YEOH),
    Setting(
        "microrobot",
        "sheet_ogden",
        (ROBOT,),
        {"mu1": 29.16e3, "mu2": 2.15, "alpha2": 40.09, "sx": 84e3, "sy": 61e3},
    ),
)
# Beside the settings of the tests: every other law, at rows of the papers' tables (chains as in docs/validation).
ALL = (
    *SETTINGS,
    Setting("cutometer plastic", "suction_rubin_bodner", (CUTOMETER,), SKIN),
    Setting("aspiration plastic", "suction_rubin_bodner", (ASPIRATION,), SKIN),
    Setting("cutometer plastic γ", "suction_rubin_bodner_gamma", (CUTOMETER,), SKIN),
    Setting("aspiration plastic γ", "suction_rubin_bodner_gamma", (ASPIRATION,), SKIN),
    _robot("tong_fung", A1=40.636, A2=21.837, a1=12.754e3, a3=38.046e3, sx=92e3, sy=49e3),
    _robot("bischoff", n=6.632e23, a=0.8529, b=1.272, sx=25e3, sy=23e3),
    _robot("fung", c=0.3118e3, mu1=7.169e3, mu2=7.142e3, sx=7e3, sy=3e3),
    _robot("gasser", mu=14.08e3, k1=11.01e3, theta=radians(30.82), sx=26e3, sy=18e3),
    _robot("yeoh", c10=15e3, c20=5e3, sx=40e3, sy=30e3),
)


def verdict(setting: Setting, result: FitResult, recordings: Sequence[Recording]) -> dict[str, Any]:
    """One fit in plain data. ``outcome``: 'found' (every parameter called identifiable lies within `joint_bound`),
    'told' (the model leaves more than noise, or nothing is called identifiable), or 'wrong'."""
    errors = setting.errors(result)
    farthest = max((abs(x) for x in errors.values()), default=0.0)
    told = not result.describes or not errors
    bound = joint_bound(len(errors), sum(c.data.size for c in result.curves) - len(result.estimates))
    return {
        "outcome": "told" if told else "found" if farthest <= bound else "wrong",
        "farthest": farthest,
        "bound": bound,
        "rise": setting.rise(result, recordings),
        "errors": errors,
        "estimates": {
            e.free.symbol: {
                "value": e.value,
                "truth": setting.truth[e.free.symbol],
                "standard_error": e.standard_error,
                "at": e.at,
                "identifiable": e.identifiable,
            }
            for e in result.estimates
        },
        "correlation": result.correlation.tolist(),
        "persistence": [c.persistence for c in result.curves],
        "vaf": result.vaf,
        "starts": len(result.starts),
        "runs": result.effort.forward_runs,
        "seconds": result.effort.seconds,
        "warnings": result.warnings,
    }


def one(setting: Setting, seed: int, noise: float, wrong: float) -> dict[str, Any]:
    """The verdict of one fit; a start at which the model cannot be run is told as well."""
    try:
        return verdict(setting, setting.run(seed, noise, wrong), setting.recordings(seed, noise))
    except FitError as error:
        return {"outcome": "told", "farthest": 0.0, "errors": {}, "starts": 1, "runs": 0, "seconds": 0.0,
                "warnings": [str(error)]}  # fmt: skip


def fill(folder: Path, settings: Sequence[Setting], seeds: int, noise: float, wrong: float, minutes: float) -> None:
    """Fit whatever is not in the folder yet, until the time is up. A lock on each file keeps others off it."""
    folder.mkdir(parents=True, exist_ok=True)
    until = monotonic() + 60.0 * minutes
    for seed in range(seeds):
        for setting in settings:
            if monotonic() > until:
                return
            path = folder / f"{setting.name.replace(' ', '-')}-{seed:02d}.json"
            with open(path, "a+") as file:
                try:
                    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                except BlockingIOError:
                    continue
                if path.stat().st_size == 0:
                    found = {"setting": setting.name, "seed": seed, **one(setting, seed, noise, wrong)}
                    file.write(json.dumps(found, indent=1))
                    print(f"{setting.name:22s} seed {seed:2d}: {found['outcome']}, {found['farthest']:.1f}", flush=True)


def table(folder: Path) -> None:
    """The folder's fits as a table in Markdown."""
    fits = [json.loads(text) for path in sorted(folder.glob("*.json")) if (text := path.read_text())]
    head = ("setting", "model", "free", "seeds", "found", "told", "trusted and wrong", "identifiable", "beyond 3",
            "r.m.s.", "farthest", "worse than the truth", "runs")  # fmt: skip
    print(f"| {' | '.join(head)} |\n|{'---|' * len(head)}")
    for setting in ALL:
        if own := [f for f in fits if f["setting"] == setting.name]:
            print(f"| {' | '.join(_row(setting, own))} |")
    claims = _claims(fits)
    print(
        f"\n{claims.size} parameters called identifiable: {np.count_nonzero(claims > 3.0)} beyond three standard "
        f"errors ({LEVEL * claims.size:.1f} by chance), {np.count_nonzero(claims > 2.0)} beyond two "
        f"({2.0 * stats.norm.sf(2.0) * claims.size:.1f} by chance), {np.sqrt(np.mean(claims**2)):.2f} r.m.s. (1)"
    )


def _claims(fits: Sequence[Mapping[str, Any]]) -> np.ndarray:
    """Distances from the truth, in standard errors, of all that trusted fits call identifiable."""
    return np.abs([x for f in fits if f["outcome"] != "told" for x in f["errors"].values()])


def _row(setting: Setting, own: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    count = {name: sum(f["outcome"] == name for f in own) for name in ("found", "told", "wrong")}
    wrong = ", ".join(f"seed {f['seed']}: {f['farthest']:.1f}" for f in own if f["outcome"] == "wrong")
    yield from (setting.name, f"`{setting.model}`", ", ".join(setting.truth), str(len(own)))
    yield from (str(count["found"]), str(count["told"]), f"{count['wrong']}{f' ({wrong})' if wrong else ''}")
    yield f"{np.mean([len(f['errors']) for f in own]):.1f} of {len(setting.truth)}"
    claims = _claims(own)
    yield f"{np.count_nonzero(claims > 3.0)} of {claims.size}"
    yield from (f"{np.sqrt(np.mean(claims**2)):.2f}", f"{claims.max():.1f}") if claims.size else ("–", "–")
    yield str(sum(f["rise"] < 0.0 for f in own if f["outcome"] != "told"))
    yield f"{np.median([f['runs'] for f in own]):.0f}"


def main() -> None:
    ask = argparse.ArgumentParser(description="Fits of simulated recordings from wrong starts")
    ask.add_argument("folder", type=Path)
    ask.add_argument("settings", nargs="*", help=f"of {', '.join(s.name for s in ALL)}; all without one")
    ask.add_argument("--seeds", type=int, default=20)
    ask.add_argument("--noise", type=float, default=0.02, help="of each channel's largest value")
    ask.add_argument("--wrong", type=float, default=0.5, help="share of the truth by which every start is off")
    ask.add_argument("--minutes", type=float, default=np.inf, help="after which no further fit begins")
    ask.add_argument("--table", action="store_true", help="print what the folder holds, fit nothing")
    told = ask.parse_intermixed_args()
    if told.table:
        return table(told.folder)
    chosen = [s for s in ALL if s.name in told.settings or not told.settings]
    fill(told.folder, chosen, told.seeds, told.noise, told.wrong, told.minutes)


if __name__ == "__main__":
    main()
