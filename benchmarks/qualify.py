"""Hidden faults of instruments, and what a qualification says of them: ``python benchmarks/qualify.py [INSTRUMENT]``.

    python benchmarks/qualify.py cutometer --record benchmarks/results

For each instrument the standard set is simulated by chains alone (no engine, so that it takes seconds), sound and with
each of ten faults that qualification is not told of; the table says whether it passed, and which effects it names. A
fault is named where it is in the class that the finding gives.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from acquire.recording.model import Recording
from acquire.session import Session
from acquire.station import simulated_station
from gap.design import simulated as own
from gap.qualify.judge import qualify
from gap.qualify.steps import STANDARD
from protocols import Setpoints, find, load
from sim_devices.effects import effects

SUCTION = {
    "regulator_lag": {"tau": 0.12},
    "leak": {"shortfall": 0.03},
    "dead_band": {"band": 600.0},
    "gauge_gain": {"error": 0.06},
    "gauge_offset": {"offset": 800.0},
    "desynchronisation": {"shift": 0.06},
    "sensor_gain": {"error": 0.08},
    "sensor_low_pass": {"tau": 0.15},
    "sensor_hysteresis": {"width": 0.04e-3},
    "rim_friction": {"width": 0.03e-3},
}
ROBOT = {
    "latency": {"delay": 0.03},
    "viscous_drag": {"drag": 60.0},
    "coulomb_friction": {"force": 0.3},
    "backlash": {"gap": 40e-6},
    "sensor_gain": {"error": 0.08},
    "quadratic_error": {"error": 0.08},
    "sensor_low_pass": {"tau": 0.1},
    "crosstalk": {"share": 0.05},
    "misalignment": {"angle": 0.05},
    "wrong_geometry": {"h_error": 0.06, "w_error": 0.0},
}
FAULTS: Mapping[str, Mapping[str, Mapping[str, float]]] = {
    "cutometer": SUCTION,
    # Its height is read in pictures: a wrong gain is a wrong scale.
    "aspiration": {("scale_error" if name == "sensor_gain" else name): values for name, values in SUCTION.items()},
    "microrobot": ROBOT,
}


@dataclass(frozen=True)
class Said:
    """The result of one qualification: ``fault`` is '' for a sound one."""

    instrument: str
    fault: str
    passed: bool
    named: tuple[str, ...]
    doubts: tuple[str, ...]
    seconds: float

    @property
    def right(self) -> bool:
        """A sound one passes, a fault is named."""
        return self.passed if not self.fault else not self.passed and self.fault in self.named


def standard_legs(instrument: str) -> list[own.Leg]:
    """The standard set as legs of a simulated session."""
    with Session(simulated_station()) as session:
        return [
            own.Leg(_tables(c), c.duration, step.specimen, known=step.known)
            for step in STANDARD[instrument]
            for c in [session.compile(instrument, load(find(step.protocol)))[0]]
        ]


def _tables(setpoints: Setpoints) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Corners of each commanded quantity, s and SI."""
    times: list[float] = []
    values: dict[str, list[float]] = {q: [] for q in setpoints.segments[0].start}
    at = 0.0
    for segment in setpoints.segments:
        times += [at, at + segment.duration]
        for q, column in values.items():
            column += [segment.start[q], segment.end[q]]
        at += segment.duration
    return {q: (np.asarray(times), np.asarray(column)) for q, column in values.items()}


def measured(instrument: str, fault: str, seed: int) -> list[Recording]:
    """Recordings of the standard set on an instrument with a fault ('': sound)."""
    acting = [(effects(instrument)[fault], FAULTS[instrument][fault])] if fault else []
    rng, legs = np.random.default_rng(seed), standard_legs(instrument)
    if instrument == "microrobot":
        return own.robot_session(rng, acting, legs=legs)
    return own.suction_session(instrument, rng, acting, legs=legs)


def said_of(instrument: str, fault: str, seed: int = 1) -> Said:
    """The judgement on one instrument."""
    begin = time.perf_counter()
    q = qualify(measured(instrument, fault, seed)).qualification
    named = tuple(name for f in q.findings for name in f.indistinguishable)
    if not named:  # beside a finding, a strained parameter is its consequence
        named = tuple(dict.fromkeys(p.like for p in q.parameters.values() if p.like and p.passed is False))
    return Said(instrument, fault, q.passed, named, q.doubts, time.perf_counter() - begin)


def row(s: Said) -> dict[str, Any]:
    """The judgement as a row of the table."""
    told = "passed" if s.passed else f"not passed: {', '.join(s.named) or '; '.join(s.doubts) or 'parameters'}"
    return {"instrument": s.instrument, "fault": s.fault or "sound", "right": s.right, "said": told,
            "seconds": round(s.seconds)}  # fmt: skip


def counted(rows: Sequence[Mapping[str, Any]]) -> str:
    """How many of the judgements are right."""
    faults, sound = ([r for r in rows if (r["fault"] != "sound") == is_fault] for is_fault in (True, False))
    return (
        f"faults named {sum(r['right'] for r in faults)} of {len(faults)}; "
        f"sound ones passed {sum(r['right'] for r in sound)} of {len(sound)}"
    )


def record(folder: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write ``qualify.json`` and ``qualify.md``; instruments that were not run keep their earlier rows."""
    file, anew = folder / "qualify.json", {r["instrument"] for r in rows}
    before = json.loads(file.read_text(encoding="utf-8"))["rows"] if file.exists() else []
    kept = [*(r for r in before if r["instrument"] not in anew), *rows]
    every = sorted(kept, key=lambda r: list(FAULTS).index(r["instrument"]))
    command = "python benchmarks/qualify.py --record benchmarks/results"
    lines = ["# Hidden faults and what a qualification says of them", "", f"`{command}`: {counted(every)}.", "",
             "| instrument | fault | right | said |", "|---|---|---|---|"]  # fmt: skip
    lines += [f"| {r['instrument']} | {r['fault']} | {'yes' if r['right'] else 'no'} | {r['said']} |" for r in every]
    (folder / "qualify.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    file.write_text(json.dumps({"command": command, "rows": every}, indent=1) + "\n", encoding="utf-8")


def main() -> None:
    """Print the table, and record it where that is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("instrument", nargs="*", help=f"of {', '.join(FAULTS)} (default: all)")
    parser.add_argument("--fault", nargs="+", help="only these, sound among them; nothing is recorded then")
    parser.add_argument("--record", type=Path, help="folder that also gets qualify.json and qualify.md")
    given = parser.parse_args()
    print(f"{'instrument':<11} {'fault':<18} {'':<6} said")
    rows: list[dict[str, Any]] = []
    for instrument in given.instrument or FAULTS:
        for fault in ("sound", *FAULTS[instrument]):
            if given.fault and fault not in given.fault:
                continue
            r = row(said_of(instrument, "" if fault == "sound" else fault))
            rows.append(r)
            right = "right" if r["right"] else "WRONG"
            print(f"{instrument:<11} {fault:<18} {right:<6} {r['said']} ({r['seconds']} s)", flush=True)
    print(f"\n{counted(rows)}")
    if given.record and not given.fault:
        record(given.record, rows)


if __name__ == "__main__":
    main()
