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
from gap.null.suction_line import commanded_line
from sim_devices.stages import RATES, nominal
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
    for period in (0.0, 0.04, 0.1):
        nodes = node_times(time, spread, period)
        np.testing.assert_allclose(nodes.mean(axis=0), time)
        np.testing.assert_allclose(nodes.var(axis=0), spread**2 + period**2 / 12)


def test_nodes_of_a_mean_are_close_enough_for_an_answer_to_a_step() -> None:
    """Two lags of 40 ms after a step of 30 kPa, each sample the mean over a tenth of a second: four nodes were 100 Pa
    off."""
    fine = np.arange(-0.2, 1.0, 1e-4)
    after = np.maximum(fine, 0.0) / 0.04
    answer = -30e3 * (1.0 - (1.0 + after) * np.exp(-after))
    for middle in np.arange(-0.04, 0.3, 0.013):
        inside = np.abs(fine - middle) <= 0.05
        nodes = node_times(np.array([middle]), np.zeros(1), 0.1)
        assert np.interp(nodes, fine, answer).mean() == pytest.approx(answer[inside].mean(), abs=20.0)


@pytest.mark.parametrize("tau", [0.04, 0.12])
def test_a_line_between_rare_samples_is_simulated_as_closely_as_it_bends(tau: float) -> None:
    """Between samples a tenth of a second apart the line was straight: the membrane that it met was 150 of chi2 off."""
    chain, time = nominal("cutometer", command_step=0.0).tuned("regulator", tau=tau), np.arange(0.0, 12.0, 0.1)
    corners = np.array([0.0, 2.0, 2.0, 7.0, 7.0, 12.0]), -30e3 * np.array([0.0, 0.0, 1.0, 1.0, 0.0, 0.0])
    nodes, line = commanded_line(chain, {"pressure": corners}, np.array([2.0, 7.0]), time, np.zeros_like)
    close = np.arange(0.0, 11.8, 0.003)
    exact = simulate(chain, {"pressure": corners}, {"line_pressure": close})["line_pressure"]
    assert np.max(np.abs(np.interp(close, nodes, line) - exact)) < 30.0
    assert np.max(np.diff(nodes)) < 0.021
