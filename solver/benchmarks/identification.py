"""The cost of an identification: paper W's four suction cases together, and paper M's sixteen directions.

Run with ``python benchmarks/identification.py [robot]``. Recordings are simulated with 1 % noise; fits start 30 % off.
Wall seconds depend on what else the machine does: the processor seconds of all processes stand beside them.
"""

from __future__ import annotations

import os

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[name] = "1"  # before numpy is imported

import resource
import sys
from collections.abc import Mapping, Sequence
from time import perf_counter

import numpy as np
from recovery import recorded

from skinrig_solver import Experiment, models
from skinrig_solver.fit import fit, workers
from skinrig_solver.fit.cases import DRIVES
from skinrig_solver.fit.spec import FREE, free_by_default

W = "suction_rubin_bodner"


def suction(instrument: str, label: str, edges: Sequence[tuple[float, float]], rate: float) -> Experiment:
    """A piecewise linear pressure through (time [s], suction [mbar]) points."""
    at, level = np.array(edges).T
    time = np.arange(0.0, at[-1], 1.0 / rate)
    return Experiment(instrument, time, {"pressure": -100.0 * np.interp(time, at, level)}, label=label)  # type: ignore[arg-type]


def paper_w() -> list[Experiment]:
    """Cutometer: instant 300 mbar, linear 15 mbar/s; aspiration: instant 200 mbar, linear 15 mbar/s."""
    return [
        suction("cutometer", "cutometer instant 300", [(0, 0), (0.05, 300), (60, 300)], 20.0),
        suction("cutometer", "cutometer linear 15", [(0, 0), (17.5, 262.5), (35, 0)], 20.0),
        suction("aspiration", "aspiration instant 200", [(0, 0), (0.1, 200), (31, 200)], 20.0),
        suction("aspiration", "aspiration linear 15", [(0, 0), (10, 150), (20, 0)], 20.0),
    ]


def paper_m() -> Experiment:
    """Sixteen in-plane directions, each three triangles of 0.1 Hz to 1.2 mm, sampled at 5 Hz."""
    time = np.arange(0.0, 480.0, 0.2)
    height = 1.2e-3 * (1.0 - np.abs((time % 10.0) / 5.0 - 1.0))
    angle = 2.0 * np.pi * (time // 30.0) / 16.0
    way = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)])
    return Experiment("microrobot", time, dict(zip(DRIVES["sheet"], height * way, strict=True)), label="16 directions")


def processor_seconds() -> float:
    return sum(
        r.ru_utime + r.ru_stime for r in map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    )


def identify(title: str, model: str, experiments: Sequence[Experiment], symbols: Sequence[str], jobs: int) -> None:
    truth: Mapping[str, float] = {s: models()[model].info[s].default for s in symbols}
    random = np.random.default_rng(1)
    recordings = [recorded(model, e, truth, 0.01, k) for k, e in enumerate(experiments)]
    starts = {s: {"start": v * (1.0 + 0.3 * random.choice([-1.0, 1.0]))} for s, v in truth.items()}
    before = processor_seconds()
    with workers(jobs) as executor:
        if executor is not None:  # imports and compiled code in place, as in a second fit of a session
            wait = [executor.submit(models()[model].simulate, experiments[0], truth) for _ in range(2 * jobs)]
            _ = [future.result() for future in wait]
        began = perf_counter()
        result = fit(recordings, {"model": model, "parameters": starts}, executor=executor)
        wall = perf_counter() - began
    known = [e for e in result.estimates if e.identifiable]
    off = [abs(e.value - truth[e.free.symbol]) / e.standard_error for e in known]
    print(f"\n{title}: {len(symbols)} parameters, {len(experiments)} recordings, {jobs} processes")
    print(result.in_words())
    print(
        f"{wall:.0f} s wall, {processor_seconds() - before:.0f} s of processors in all, "
        f"{result.effort.model_seconds:.0f} s inside the model; {len(known)} identifiable, "
        f"the farthest {max(off, default=np.nan):.1f} standard errors off"
    )


if __name__ == "__main__":
    if "robot" not in sys.argv:
        identify("paper W, four suction cases", W, paper_w(), FREE[W], 2)
    identify("paper M, 16 directions", "sheet_ogden", [paper_m()], free_by_default(models()["sheet_ogden"].info), 1)
