"""How far every table of docs/validation moves on a finer mesh and with more time steps.

    python benchmarks/convergence.py [suction] [finger] [sheet]     # minutes of processor time; all without a word

Each row is computed as its table does and once with each refinement alone. What moves by more than 1 % is marked.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from validate_sheet import ROWS, WAYS, run
from validate_suction import RB, YEOH, instant, linear

from skinrig_solver import Experiment, Model, SolverError, models

LIMIT = 1.0  # per cent
FINER: Mapping[str, Mapping[str, float]] = {"mesh x 2": {"mesh": 2.0}, "steps x 4": {"steps": 4.0}}
FINER_SHEET: Mapping[str, Mapping[str, int]] = {"10 x 24 elements": {"radial": 10, "around": 24}}


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    print(f"| {' | '.join(head)} |\n|{'---|' * len(head)}")
    for row in rows:
        print(f"| {' | '.join(row)} |")
    print()


def moved(found: Sequence[float], base: Sequence[float]) -> str:
    """The relative change of each of a row's numbers."""
    changes = [100.0 * abs(f / b - 1.0) for f, b in zip(found, base, strict=True)]
    return " / ".join(f"**{c:.2f} %**" if c > LIMIT else f"{c:.2f} %" for c in changes)


def heights(model: Model, experiment: Callable[..., Experiment], at: Sequence[float], **geometry: float) -> list[float]:
    """Heights [mm] at the times ``at`` [s], nan for the largest; the model's last channel."""
    result = model.simulate(experiment(**geometry), {})
    curve = 1e3 * result.channels[model.info.channels[0]]
    return [float(curve.max() if np.isnan(t) else np.interp(t, result.time, curve)) for t in at]


def compared(
    names: Mapping[str, tuple[Model, Callable[..., Experiment], Sequence[float]]], finer: Mapping[str, Any], shown: str
) -> None:
    rows = []
    for name, (model, experiment, at) in names.items():
        base = heights(model, experiment, at)
        changes = [moved(heights(model, experiment, at, **change), base) for change in finer.values()]
        rows.append([name, " / ".join(f"{b:.3f}" for b in base), *changes])
    table(["row", shown, *finer], rows)


def suction() -> None:
    print("### Suction: paper W's protocols and paper F's levels, default mesh and steps\n")

    def at_once(instrument: str, mbar: float, hold: float, release: float = 0.0) -> Callable[..., Experiment]:
        return lambda **geometry: instant(instrument, mbar, hold, release, **geometry)

    def triangle(instrument: str, rate: float, leg: float) -> Callable[..., Experiment]:
        return lambda **geometry: linear(instrument, rate, leg, **geometry)

    most = (np.nan,)
    cases: dict[str, Any] = {
        f"Cutometer instant {p} mbar": (RB, at_once("cutometer", p, 60.0), most) for p in (300, 500)
    }
    cases |= {f"Cutometer linear {r} mbar/s": (RB, triangle("cutometer", r, 17.5), most) for r in (10, 15, 20)}
    cases |= {f"aspiration instant {p} mbar": (RB, at_once("aspiration", p, 31.0), most) for p in (66, 133, 200)}
    cases |= {f"aspiration linear {r} mbar/s": (RB, triangle("aspiration", r, 10.0), most) for r in (15, 20, 30)}
    compared(cases, FINER, "largest apex, mm")
    times = (5.0, 60.0, 75.0)
    levels = {f"paper F, {p} mbar": (YEOH, at_once("cutometer", p, 60.0, 15.0), times) for p in (150, 250, 350, 450)}
    compared(levels, FINER, "height at 5, 60, 75 s, mm")


def finger() -> None:
    print("### Fingertip cross-section\n")
    time = np.linspace(0.0, 1.0, 3)

    def section(**options: Any) -> Callable[..., Experiment]:
        return lambda **finer: Experiment("cutometer", time, {"pressure": -2e4 * time}, {**options, **finer})

    model = models()["finger_section"]
    options = {"with ridges": {}, "smooth pad": {"ridge_height": 0.0}, "held at the bone": {"support": "bone"}}
    cases = {name: (model, section(**o), (1.0,)) for name, o in options.items()}
    compared(cases, {"mesh x 2": {"mesh": 2.0}}, "rise, mm")


def sheet() -> None:
    print("### Sheet: every row of paper M, dead loads\n")
    rows = []
    for row in ROWS:
        try:
            base = [run(row, way, {})[0] for way in WAYS]
        except SolverError:
            rows.append([row.region, row.law, "locked", *("" for _ in FINER_SHEET)])
            continue
        changes = []
        for change in FINER_SHEET.values():
            found = [run(row, way, change)[0] for way in WAYS]
            changes.append(moved(found, base))
        rows.append([row.region, row.law, " / ".join(f"{b:.3f}" for b in base), *changes])
    table(["region", "law", "x / y / normal, N", *FINER_SHEET], rows)


PARTS = {"suction": suction, "finger": finger, "sheet": sheet}

if __name__ == "__main__":
    for part in sys.argv[1:] or PARTS:
        PARTS[part]()
