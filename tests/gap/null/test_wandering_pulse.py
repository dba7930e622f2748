"""A heart's rate wanders, so that no sine of one frequency and phase fits a session."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gap.design import simulated as own
from gap.effects.load import library
from gap.inference.hypothesis import Candidate
from gap.inference.least_squares import fit
from gap.null.candidates import candidates_for
from gap.null.groups import GroupedSession
from gap.null.robot import robot_problems
from gap.null.suction_height import HeightBlock
from gap.null.suction_pressure import PressureBlock
from gap.search.compare import compare
from sim_devices.chain import FloatArray
from tests.gap.null.test_chance import LEGS

WANDERS = "pulse_breathing[form=1]"
BEAT = {"amplitude": 2e-5, "frequency": 1.2, "seed": 3.0}


def height(beats: bool = False) -> HeightBlock:
    effects = [(library("aspiration")[WANDERS], BEAT)] if beats else []
    made = own.suction_session("aspiration", np.random.default_rng(3), effects, legs=LEGS)
    grouped = GroupedSession(made, ("pressure",))
    return HeightBlock(grouped, library("aspiration"), PressureBlock(grouped, library("aspiration")))


def wandering(block: HeightBlock) -> Candidate:
    return next(c for c in candidates_for(library("aspiration"), [block]) if c.key == WANDERS)


def slow(block: HeightBlock, size: float, tau: float) -> FloatArray:
    """Noise (n,) of the height that forgets within ``tau`` s."""
    rng, out = np.random.default_rng(1), [0.0]
    for keep in np.exp(-np.maximum(np.diff(block.stamps), 0.0) / tau):
        out.append(keep * out[-1] + np.sqrt(1.0 - keep**2) * size * rng.normal())
    return np.array(out)


def test_a_pulse_whose_rate_wanders_is_told_by_its_rate() -> None:
    block = height(beats=True)
    assert [p.name for p in wandering(block).parameters] == ["amplitude", "frequency"]
    comparison = compare([block], candidates_for(library("aspiration"), [block]))
    weight = comparison.weighed(comparison.temper())
    best = max((h for h in comparison.hypotheses if len(h.effects) == 1), key=lambda h: weight[id(h)].evidence)
    assert best.name == WANDERS
    values = best.values(best.effects[0])
    assert values["frequency"] == pytest.approx(1.2, rel=0.1)
    assert values["amplitude"] == pytest.approx(2e-5, rel=0.35)
    fitted = best.fits["height"]
    assert fitted.chi2 / len(fitted.residual) < 1.3
    assert block.walk_log_bayes(fitted) > 25.0


@pytest.mark.parametrize("tau", [0.0, 0.1, 0.8, 3.0])
def test_noise_of_no_colour_is_a_rhythm(tau: float) -> None:
    """Nor is what skin of another law leaves, which is slow and has no hump."""
    block = height()
    block.measured = block.measured + (slow(block, 1e-5, tau) if tau else 0.0)
    candidate = wandering(block)
    for quantiles in ([0.5, 0.3], [0.5, 0.75]):
        assert block.walk_log_bayes(fit(block, (candidate,), np.array(quantiles))) < 10.0


def test_on_a_reference_it_is_by_chance_as_well_and_does_nothing() -> None:
    """Else a session with references had its course and its direction among the parameters."""
    skin = own.direction_cycles(0.0, 0.0, 1e-3, 8.0, 2)
    legs = [replace(skin, specimen="open air"), skin]
    effects = library("microrobot")
    blocks = robot_problems(own.robot_session(np.random.default_rng(3), legs=legs), effects)[0]
    (key,) = (key for key, effect in effects.items() if effect.rhythm)
    (beats,) = candidates_for({key: effects[key]}, blocks)
    assert beats.blocks == ("force",)
    assert [p.name for p in beats.parameters] == ["amplitude", "frequency"]
