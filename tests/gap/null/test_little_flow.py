"""Regulators whose valve gives little flow, or another at each pressure, and one that is no other make: its command is
looked at now and then."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.signal import lsim, lti

from acquire.recording.model import Recording
from gap.effects.load import library
from gap.inference.hypothesis import FROZEN
from gap.inference.least_squares import fit
from gap.null.groups import GroupedSession
from gap.null.suction_pressure import PressureBlock
from gap.null.suction_regulator import SPAN
from sim_devices.stages.kernels import evaluate, second_order
from tests.gap.null.regulators import CORNERS, NOISE, STEP, SUCTION, TIME, session_of


def block_of(taken: Recording) -> PressureBlock:
    return PressureBlock(GroupedSession([taken], ("pressure",)), library("cutometer"))


def of_little_flow(asked: np.ndarray) -> np.ndarray:
    """Suction (n,) Pa by a controller of 16.7/s whose valve, late by 15 ms, gives no more than 230 kPa/s."""
    p, valve, out = 0.0, 0.0, np.empty(len(asked))
    for k, u in enumerate(asked):
        out[k] = p
        for _ in range(4):
            valve += 0.25 * STEP * (min(max(16.7 * (u - p), -230e3), 230e3) - valve) / 0.015
            p = max(p + 0.25 * STEP * valve, 0.0)
    return out


def test_a_valve_of_little_flow_is_not_a_limited_rate(recording: Callable[..., Recording]) -> None:
    """A sound session of an outside author was told an overshoot (6 sigma, .92): a limited rate came near the noise,
    150 of chi2 and strain behind the valve, and was taken as the simpler one."""
    block = block_of(session_of(recording, of_little_flow(np.interp(TIME, CORNERS, SUCTION))))
    found = fit(block)
    assert found.nuisance[SPAN] <= FROZEN
    assert found.chi2 / len(found.residual) < 1.2
    assert found.penalty < 25
    told = block.quantities(found.nuisance)
    assert 30e3 / told["regulator_opened_wholly"][0] == pytest.approx(230 / 16.7 * 1e3, rel=0.1)


def softly(asked: np.ndarray) -> np.ndarray:
    """Suction (n,) Pa by a PI loop of 13.4/s, an integral of 1/s and a valve, late by 26 ms, that comes softly to its
    260 kPa/s and lets out less air than in."""
    p, valve, integral, out, most = 0.0, 0.0, 0.0, np.empty(len(asked)), 260e3
    for k, u in enumerate(asked):
        out[k] = p
        for _ in range(4):
            h, wanted = 0.25 * STEP, 13.4 * (u - p + integral)
            given = most * np.tanh(wanted / most)
            integral += h * (u - p) if abs(given - wanted) < 0.05 * most else 0.0
            valve += h * (given - valve) / 0.026
            p = max(p + h * valve * (1.35 if valve > 0 else 0.65), 0.0)
            integral *= 0.8 if u <= 0.0 and p < 20.0 else 1.0
    return out


def test_a_valve_that_comes_softly_to_its_end_is_sound_at_low_suction(recording: Callable[..., Recording]) -> None:
    """Another's, of 120 mbar at most, was told a leak: no fit began at a soft valve, and one that is never opened
    wholly shows no flow."""
    low = 0.4 * SUCTION
    measured = -softly(np.interp(TIME, CORNERS, low))[::20] + NOISE * np.random.default_rng(2).normal(
        size=len(TIME) // 20
    )
    block = block_of(recording({"pressure": measured}, TIME[::20], {"pressure": (CORNERS, -low)}))
    found = fit(block)
    assert block.structure is not None
    assert found.chi2 / len(found.residual) < 1.2
    assert found.penalty < 25
    assert block.quantities(found.nuisance)["regulator_flow_asymmetry"][0] == pytest.approx(0.35, abs=0.05)


def of_uneven_flow(asked: np.ndarray) -> np.ndarray:
    """Suction (n,) Pa by a PI loop of 10.7/s, an integral of 1.2/s and a valve, late by 32 ms, that lets in 1.05 and
    out 0.95 of its flow, and a fifth and an eighth less and more at the pump's 50 kPa."""
    p, valve, integral, out = 0.0, 0.0, 0.0, np.empty(len(asked))
    for k, u in enumerate(asked):
        out[k] = p
        for _ in range(4):
            h = 0.25 * STEP
            integral = integral + h * 1.2 * (u - p) if u > 0.0 else 0.0
            valve += h * (10.7 * (u - p + integral) - valve) / 0.032
            p = max(p + h * valve * (1.05 - 0.2 * p / 50e3 if valve > 0 else 0.95 + 0.12 * p / 50e3), 0.0)
    return out


def test_a_valve_is_found_where_an_integral_takes_most_away_but_not_all(recording: Callable[..., Recording]) -> None:
    """An outside author's, sound by docs/nominal.md, was of a structure that nobody knows: an integral alone took 95 %
    of what a second order leaves, and no valve was tried any more."""
    suction = of_uneven_flow(np.interp(TIME, CORNERS, 1.5 * SUCTION))
    noise = 20.0 * np.random.default_rng(5).normal(size=len(TIME) // 10)
    taken = recording({"pressure": noise - suction[::10]}, TIME[::10], {"pressure": (CORNERS, -1.5 * SUCTION)})
    block = block_of(taken)
    found = fit(block)
    assert found.chi2 / len(found.residual) < 1.2
    told = block.quantities(found.nuisance)
    assert told["regulator_suction_flow_slope"][0] == pytest.approx(0.2, abs=0.05)
    assert told["regulator_integral_rate"][0] == pytest.approx(1.2, rel=0.1)


def looked_at(asked: np.ndarray) -> np.ndarray:
    """Suction (n,) Pa by a second order of 40 ms whose command is looked at each 24.3 ms, and sent in 3 ms."""
    looks = np.floor(TIME / 0.0243) * 0.0243
    late = np.interp(looks - 0.003, TIME, asked)
    return np.asarray(lsim(lti([1.0], [0.04**2, 0.084, 1.0]), late, TIME)[1])


def test_a_command_that_is_looked_at_now_and_then_is_no_other_make(recording: Callable[..., Recording]) -> None:
    """Such a latency was told a leak and a latency (.93): a valve took a third of what a second order leaves."""
    low = 0.1 * SUCTION
    noise = NOISE * np.random.default_rng(4).normal(size=len(TIME) // 10)
    measured = -looked_at(np.interp(TIME, CORNERS, low))[::10] + noise
    taken = recording({"pressure": measured}, TIME[::10], {"pressure": (CORNERS, -low)})
    assert block_of(taken).structure is None


def test_a_sampled_set_point_of_a_limited_rate_is_sound(recording: Callable[..., Recording]) -> None:
    """A sound session of an outside author, with rows each 10 ms that its controller holds, was told a regulator's lag
    (11 sigma): only the pressure's own rate could be limited, and which rows are held was asked of a second order."""
    rows, time = np.arange(0.0, 24.0, 0.01), np.arange(0.0, 24.0, STEP)
    steps = np.select([rows < 2, rows < 6, rows < 8, rows < 12, rows < 13], [0.0, 30e3, 0.0, 10e3, 0.0], 0.0)
    asked = steps + np.where(rows >= 13, 10e3 * (1.0 - np.cos(2.0 * np.pi * 0.2 * (rows - 13.0))), 0.0)
    held, limited = np.repeat(asked, 10), np.zeros(len(time))
    for k in range(1, len(time)):
        limited[k] = limited[k - 1] + np.clip(held[k] - limited[k - 1], -240.0, 240.0)
    made = evaluate(second_order, time, limited, 0.036, 1.0)[::20]
    measured = -made + NOISE * np.random.default_rng(5).normal(size=len(made))
    block = block_of(recording({"pressure": measured}, time[::20], {"pressure": (rows, -asked)}))
    found = fit(block)
    assert block.held
    assert block.quantities(found.nuisance)["regulator_setpoint_span_time"][0] == pytest.approx(0.125, rel=0.02)
    assert found.penalty < 25
    assert found.chi2 < 1.1 * len(found.residual)
