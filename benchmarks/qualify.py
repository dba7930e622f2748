"""Hidden faults of instruments, and what a qualification says of them: ``python benchmarks/qualify.py [INSTRUMENT]``.

For each instrument the standard set is simulated by chains alone (no engine, so that it takes seconds), sound and with
each of ten faults that qualification is not told of; the table says whether it passed, and which effects it names. A
fault is named where it is in the class that the finding gives.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass

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
        named = tuple(p.like for p in q.parameters.values() if p.like and p.passed is False)
    return Said(instrument, fault, q.passed, named, q.doubts, time.perf_counter() - begin)


def main(instruments: list[str]) -> None:
    """Print the table."""
    print(f"{'instrument':<11} {'fault':<18} {'':<6} said")
    told: list[Said] = []
    for instrument in instruments:
        for fault in ("", *FAULTS[instrument]):
            s = said_of(instrument, fault)
            told.append(s)
            words = "passed" if s.passed else f"not passed: {', '.join(s.named) or '; '.join(s.doubts) or 'parameters'}"
            right = "right" if s.right else "WRONG"
            print(f"{instrument:<11} {fault or 'sound':<18} {right:<6} {words} ({s.seconds:.0f} s)", flush=True)
    faults = [s for s in told if s.fault]
    print(f"\nfaults named {sum(s.right for s in faults)} of {len(faults)}; ", end="")
    print(f"sound ones passed {sum(s.right for s in told if not s.fault)} of {len(told) - len(faults)}")


if __name__ == "__main__":
    main(sys.argv[1:] or list(FAULTS))
