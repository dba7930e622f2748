"""Effects that a protocol could never tell apart: traces, their likeness, and the groups they make."""

from __future__ import annotations

import numpy as np
import pytest

from gap.design.plan import Trace, likeness, summarise, traces
from gap.inference.evidence import Hypothesis
from gap.inference.least_squares import fit
from sim_devices.chain import Parameter

T = np.linspace(0.0, 1.0, 200)


def test_traces_are_what_the_nuisance_cannot_take_up(linear, candidate) -> None:
    design = np.column_stack([np.ones_like(T), T])
    effects = {"slope": lambda v: v["a"] * T, "bend": lambda v: v["a"] * T**2, "curve": lambda v: v["a"] * (1 - T) ** 2}
    problem = linear(np.zeros_like(T), design, effects)
    known = [candidate(n, Parameter("a", "1", -50.0, 50.0, 0.0, 20.0)) for n in effects]
    null = Hypothesis((), {"linear": fit(problem)})
    slope, bend, curve = traces({"linear": problem}, null, known)
    assert slope.detectability == pytest.approx(0.0, abs=1e-3)
    assert not len(slope.directions)
    bent = 20 * T**2
    left = bent - design @ np.linalg.lstsq(design, bent, rcond=None)[0]
    assert bend.detectability == pytest.approx(np.linalg.norm(left), rel=1e-3)
    assert likeness(bend, curve) == pytest.approx(1.0, abs=1e-6)  # T² and (1 − T)² differ by a line
    assert likeness(slope, bend) == 0.0


def test_groups_join_what_imitates_each_other(candidate) -> None:
    def trace(name: str, *rows: list[float]) -> Trace:
        directions = np.array(rows, float)
        return Trace(candidate(name), directions / np.linalg.norm(directions, axis=1)[:, None], 10.0)

    found = [
        trace("regulator_lag", [1, 0, 0]),
        trace("latency", [1, 0.1, 0]),
        trace("leak", [0, 1, 0]),
        trace("slew_limit", [0, 0, 1], [0.05, 1, 0], [0, 0.3, 1]),  # in one of its forms it imitates the leak
        trace("dead_band", [0.5, 0.5, 0.5]),
    ]
    plan = summarise("cutometer", found)
    assert set(plan.classes) == {("latency", "regulator_lag"), ("leak", "slew_limit")}
    assert plan.weakest["leak"] == 10.0
    assert "overshoot" in plan.invisible
    assert "latency, regulator_lag" in plan.as_text()
