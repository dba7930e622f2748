"""Samples that are means over a sampling period: sound, and smoother than a second gauge whose samples are none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from acquire.recording.model import Recording
from gap.data.binning import node_times
from gap.design import simulated as own
from gap.effects.load import library
from gap.inference.least_squares import fit
from gap.null.blocks import Block
from gap.null.suction import suction_problems
from sim_devices.stages import RATES
from sim_devices.stages.sampling import simulate

PERIOD = 1.0 / RATES["aspiration"]
SKIN = [own.step_hold(-20e3, 6.0, 4.0), own.triangle(-20e3, 1.0, 3, 4.0)]
MANOMETER = [replace(leg, specimen="manometer") for leg in (own.step_hold(-20e3, 3.0, 3.0), own.step_hold(-12e3, 3, 3))]


def session(monkeypatch: pytest.MonkeyPatch, averaging: Mapping[str, float]) -> list[Recording]:
    """A session whose channels are means over ``averaging`` s about their stamps."""
    monkeypatch.setattr(own, "simulate", partial(simulate, averaging=averaging, step=PERIOD / 8 if averaging else 0.0))
    made = own.suction_session("aspiration", np.random.default_rng(7), legs=SKIN + MANOMETER)
    late = {name: 0.5 * window for name, window in averaging.items()}  # `simulate` has the mean of the time before
    streams = [{n: replace(s, time=s.time - late.get(n, 0.0)) for n, s in r.streams.items()} for r in made]
    return [replace(r, streams=s) for r, s in zip(made, streams, strict=True)]


@pytest.mark.parametrize("averaged", [False, True])
def test_means_over_a_period_are_sound(monkeypatch, averaged: bool) -> None:
    """A gauge whose samples were means over 40 ms was told a low-pass of 4 ms, which its manometer has not."""
    window = dict.fromkeys(("pressure", "apex_height"), PERIOD) if averaged else {}
    problems, _ = suction_problems(session(monkeypatch, window), library("aspiration"))
    blocks = {b.name: b for b in problems if isinstance(b, Block)}
    assert [blocks[name].averaged for name in ("pressure", "manometer", "height")] == [averaged, False, averaged]
    for name in ("pressure", "manometer"):
        null = fit(blocks[name])
        assert null.chi2 < 1.25 * len(null.residual), name
        assert null.penalty < 15.0


def test_nodes_of_a_mean_are_as_far_spread_as_its_samples() -> None:
    time, spread = np.array([1.0, 2.0]), np.array([0.0, 0.03])
    for period in (0.0, 0.04):
        nodes = node_times(time, spread, period)
        np.testing.assert_allclose(nodes.mean(axis=0), time)
        np.testing.assert_allclose(nodes.var(axis=0), spread**2 + period**2 / 12)
