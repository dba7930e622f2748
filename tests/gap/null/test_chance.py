"""Effects by chance: noise that remembers, and what only looks like it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
import pytest

from acquire.recording.model import Recording
from gap.design import simulated as own
from gap.effects.load import library
from gap.inference.hypothesis import Candidate
from gap.inference.least_squares import fit, predicted
from gap.null.candidates import candidates_for
from gap.null.groups import GroupedSession
from gap.null.suction_height import HeightBlock
from gap.null.suction_pressure import PressureBlock
from gap.search.compare import compare
from sim_devices.chain import FloatArray

WALKS = "sensor_drift[form=4]"
WANDERS = "pulse_breathing[form=1]"
LEGS = [own.step_hold(-level, 10.0, 8.0) for level in (20e3, 12e3, 20e3, 16e3)]


@cache
def recordings(walk: float) -> Sequence[Recording]:
    """Skin whose height's reading walks so far in a second, rms in m."""
    effects = [(library("aspiration")[WALKS], {"walk": walk, "seed": 4.0})] if walk else []
    return own.suction_session("aspiration", np.random.default_rng(3), effects, legs=LEGS)


def height(walk: float) -> HeightBlock:
    grouped = GroupedSession(recordings(walk), ("pressure",))
    return HeightBlock(grouped, library("aspiration"), PressureBlock(grouped, library("aspiration")))


def walking(block: HeightBlock) -> Candidate:
    return next(c for c in candidates_for(library("aspiration"), [block]) if c.key == WALKS)


def test_effects_by_chance_scatter_instants_walk_or_beat_and_have_no_other_form() -> None:
    block = height(0.0)
    chance = {key for key in library("aspiration") if block.by_chance(key)}
    told = {key.partition("[")[0] for key in chance - {WALKS, WANDERS}}
    assert told == {"jitter", "late_samples", "dropped_samples"}
    assert {WALKS, WANDERS} <= chance


@pytest.mark.parametrize("form", [0, 1, 2, 3])
def test_a_drift_along_a_course_moves_the_prediction(form: int) -> None:
    block = height(0.0)
    known = {c.key: c for c in candidates_for(library("aspiration"), [block])}
    drift = known[f"sensor_drift[form={form}]"]
    active = {drift: {p.name: p.default for p in drift.parameters}}
    plain, moved = (block.evaluate(block.start(), a, want_jacobian=False).residual for a in ({}, active))
    assert block.noise_scale(active) is None
    assert np.max(np.abs(moved - plain)) > 3.0


def test_a_reading_that_walks_is_told_by_how_fast_it_does() -> None:
    block = height(4e-5)
    assert [p.name for p in walking(block).parameters] == ["walk"]  # which course it took does not matter
    comparison = compare([block], candidates_for(library("aspiration"), [block]))
    weight = comparison.weighed(comparison.temper())
    best = max((h for h in comparison.hypotheses if len(h.effects) == 1), key=lambda h: weight[id(h)].evidence)
    assert best.name == WALKS
    assert best.values(best.effects[0])["walk"] == pytest.approx(4e-5, rel=0.35)
    fitted = best.fits["height"]
    assert fitted.chi2 / len(fitted.residual) < 1.2
    assert weight[id(best)].evidence > weight[id(comparison.null)].evidence + 20
    assert block.walk_log_bayes(fitted) > 25.0


def test_a_walk_is_predicted_from_the_rows_before() -> None:
    block = height(4e-5)
    fits = fit(block), fit(block, (walking(block),), np.array([0.7]))
    nominal, walks = (np.sqrt(np.mean(np.square(block.measured - predicted(block, f)))) for f in fits)
    assert walks < 0.85 * nominal


def test_skin_whose_reading_stands_does_not_walk() -> None:
    block = height(0.0)
    candidate = walking(block)
    alone, with_walk = fit(block), fit(block, (candidate,), np.array([0.05]))
    assert 0.5 * (alone.objective - with_walk.objective) < 4.0
    assert block.walk_log_bayes(with_walk) < 4.0
    assert block.walk_log_bayes(alone) == np.inf


def test_an_answer_to_motion_is_no_walk() -> None:
    """A rest that goes to and fro behind each kink, and stands in holds."""
    block = height(0.0)
    candidate = walking(block)
    kinks = np.array([k for k in block.session.kinks if round(k % 39.0) in (1, 11)])  # it loads, it unloads
    since = block.stamps - np.r_[-np.inf, kinks][np.searchsorted(kinks, block.stamps, side="right")]
    block.measured = block.measured + 60e-6 * np.sin(4.0 * np.minimum(since, 20.0)) * np.exp(-2.0 * since)
    assert block.walk_log_bayes(fit(block, (candidate,), np.array([0.5]))) < 0.0


def test_noise_scale_and_residual_are_of_one_filter() -> None:
    block = height(0.0)
    active = {walking(block): {"walk": 6e-6}}
    wider = block.noise_scale(active)
    assert wider is not None
    assert np.all(wider >= 1.0)
    assert np.max(wider) > 1.2
    assert wider[0] == pytest.approx(1.0)  # it has had no time to go anywhere
    difference: FloatArray = np.random.default_rng(0).normal(size=len(block.measured)) * block.sigma
    there = block.whitened(difference, active)
    assert block.row_noise.unwhitened(there, block.wider(active)) == pytest.approx(difference)
    assert block.noise_scale({}) is None
