"""The next experiment: which measurement would split the explanations that survive.

Every feasible one is simulated with the leading explanation as the truth; then both explanations are refitted to
session and new measurement together, parameters, shapes and nuisance free. What counts is by how much χ² the rival is
worse.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from acquire.recording.model import Recording
from gap.decision.posterior import concept
from gap.decision.verdict import Verdict
from gap.design import simulated as own
from gap.design.plan import build
from gap.inference.evidence import Hypothesis
from gap.inference.hypothesis import Active, Candidate
from gap.inference.least_squares import fit
from gap.inference.problem import Problem
from sim_devices.chain import Effect

ENOUGH = 9.0
"""Δχ² that splits two explanations: three σ."""
WORTH, RIVALS = 0.02, 3
"""Probability from which an explanation is worth splitting from the first, and how many are at most."""


def next_experiment(
    recordings: Sequence[Recording], rivals: Sequence[Hypothesis], effects: Mapping[str, Effect]
) -> dict[str, Any]:
    """The action that best splits the first of ``rivals`` from the worst-separated other; says so when none does."""
    instrument = recordings[0].info.instrument
    legs = [_leg(r) for r in recordings]
    found = {}
    for name, action in actions(instrument, legs).items():
        found[name] = min(_split([*legs, action], instrument, rivals[0], rival, effects) for rival in rivals[1:])
    best = max(found, key=lambda k: found[k])
    names = [" with ".join(e.name.replace("_", " ") for e in h.effects) or "no effect" for h in rivals]
    others = " or ".join(dict.fromkeys(names[1:]))
    if found[best] < ENOUGH:
        text = f"None of the measurements considered would tell {names[0]} from {others}."
    else:
        text = f"Measure {best}: it would tell {names[0]} from {others} by {np.sqrt(found[best]):.1f} σ."
    return {
        "action": best,
        "separates": found[best] >= ENOUGH,
        "sigma": round(float(np.sqrt(max(found[best], 0))), 2),
        "text": text,
        "considered": {k: round(float(np.sqrt(max(v, 0))), 2) for k, v in found.items()},
    }


def _leg(recording: Recording) -> own.Leg:
    """A recording's command as a leg of a simulated session."""
    times = [s.time for s in recording.streams.values()]
    begin, end = min(float(t[0]) for t in times), max(float(t[-1]) for t in times)
    tables = {
        q: (np.asarray(s.time, float) - begin, np.asarray(s.value, float)) for q, s in recording.setpoints.items()
    }
    return own.Leg(tables, end - begin, recording.info.specimen or "skin", recording.info.repeat)


def actions(instrument: str, legs: Sequence[own.Leg]) -> dict[str, own.Leg]:
    """Feasible further measurements, in the words of a protocol."""
    if instrument == "microrobot":
        size = max(float(np.max(np.abs(v))) for leg in legs for _, v in leg.quantity_tables.values())
        same = own.direction_cycles(0.0, 0.0, size, 10.0, 2)
        return {
            "the same motion in open air (no skin)": replace(same, specimen="open air"),
            "a direction five times as fast": own.direction_cycles(0.0, 0.0, size, 2.0, 5),
            "half the amplitude": own.direction_cycles(0.0, 0.0, 0.5 * size, 10.0, 2),
            "a slow cycle (60 s)": own.direction_cycles(0.0, 0.0, size, 60.0, 1),
        }
    level = min(float(np.min(leg.quantity_tables["pressure"][1])) for leg in legs)
    return {
        "a rigid block in place of skin": replace(own.step_hold(level, 10.0, 5.0), specimen="rigid block"),
        "a slow triangle (20 s each way)": own.triangle(level, 20.0, 1, 10.0),
        "three quick triangles (3 s each way)": own.triangle(level, 3.0, 3, 10.0),
        "a third of the suction": own.step_hold(round(level / 300.0) * 100.0, 20.0, 10.0),
        "a hold of two minutes": own.step_hold(level, 120.0, 30.0),
    }


def _split(
    legs: Sequence[own.Leg], instrument: str, truth: Hypothesis, rival: Hypothesis, effects: Mapping[str, Effect]
) -> float:
    """How much worse the rival fits (χ² with the prior) when the truth is true."""
    rng = np.random.default_rng(7)
    acting = [(effects[c.key], values) for c, values in _active(truth).items()]
    if instrument == "microrobot":
        recordings = own.robot_session(rng, acting, legs=legs, scatter=0.0)
    else:
        recordings = own.suction_session(instrument, rng, acting, legs=legs, scatter=0.0)
    problems, _ = build(recordings, effects)
    return sum(_cost(p, rival) - _cost(p, truth) for p in problems)


def _active(h: Hypothesis) -> Active:
    out: dict[Candidate, Mapping[str, float]] = {}
    for f in h.fits.values():
        out.update(f.active)
    return out


def _cost(problem: Problem, h: Hypothesis) -> float:
    there = h.fits.get(problem.name)
    if there is None:
        return 0.0
    return fit(problem, there.hypothesis, there.unit, iterations=8).objective


def advised(
    recordings: Sequence[Recording], null: Hypothesis, verdict: Verdict, effects: Mapping[str, Effect]
) -> Mapping[str, object]:
    """The next experiment, where more than one explanation survives a verdict; nothing where none needs one."""
    if verdict.verdict in ("none", "undetectable") or not verdict.causes:
        return {}
    first, *rest = verdict.causes
    twins = [h for h in first.members if concept(h) != concept(first.hypothesis)][:1]
    others = [null] if verdict.posterior.none > WORTH else []
    others += [c.hypothesis for c in rest if c.probability > WORTH]
    rivals = [first.hypothesis, *twins, *others][:RIVALS]
    return next_experiment(recordings, rivals, effects) if len(rivals) > 1 else {}
