"""The next experiment: feasible actions in words, and one that splits what remains."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gap.design import simulated as own
from gap.design.next_experiment import actions, next_experiment
from gap.design.plan import build
from gap.effects.load import library
from gap.inference.evidence import Hypothesis
from gap.search.compare import compare

pytestmark = pytest.mark.slow

LEGS = [own.step_hold(-30e3, 5.0, 3.0), replace(own.step_hold(-30e3, 5.0, 3.0), repeat=2)]


def test_actions_are_feasible_measurements_in_words() -> None:
    suction = actions("cutometer", LEGS)
    assert "a rigid block in place of skin" in suction
    lowest = min(float(np.min(leg.quantity_tables["pressure"][1])) for leg in LEGS)
    for leg in suction.values():
        value = leg.quantity_tables["pressure"][1]
        assert lowest <= value.min() < 0  # never a higher suction than the session had
        assert value.max() == 0
    robot = actions("microrobot", [own.direction_cycles(0.0, 0.0, 1e-3, 10.0, 1)])
    assert {leg.specimen for leg in robot.values()} == {"skin", "open air"}


def test_an_experiment_is_proposed_that_splits_an_effect_from_none() -> None:
    """A regulator somewhat slow against a sound one: any further step or quick triangle tells."""
    chosen = {k: e for k, e in library("cutometer").items() if e.name == "regulator_lag"}
    effect = next(iter(chosen.values()))
    recordings = own.suction_session(
        "cutometer", np.random.default_rng(2), [(effect, {"tau": 0.12})], legs=LEGS, scatter=0.0
    )
    problems, candidates = build(recordings, chosen)
    comparison = compare(problems, candidates)
    lag = next(h for h in comparison.hypotheses if len(h.effects) == 1)
    proposed = next_experiment(recordings, [lag, comparison.null], chosen)
    assert proposed["separates"]
    assert proposed["sigma"] == max(proposed["considered"].values()) > 3
    assert "it would tell regulator lag from no effect by" in proposed["text"]


def test_it_says_so_when_nothing_would_split() -> None:
    recordings = own.suction_session("cutometer", np.random.default_rng(2), legs=LEGS, scatter=0.0)
    problems, candidates = build(recordings, {})
    null = compare(problems, candidates).null
    proposed = next_experiment(recordings, [null, Hypothesis((), dict(null.fits))], {})
    assert not proposed["separates"]
    assert "None of the measurements considered would tell no effect from no effect" in proposed["text"]
