"""A PI loop of an even flow whose controller clears its integral while nothing is asked for."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from acquire.recording.model import Recording
from gap.effects.load import library
from gap.inference.hypothesis import FROZEN
from gap.inference.least_squares import fit
from gap.null.groups import GroupedSession
from gap.null.suction_pressure import PressureBlock
from gap.null.suction_regulator import CLEARS, FLOW, LANDS, STILL, SWINGS, TOUCHED, Vent
from sim_devices.stages.kernels import CLEARS as CLEARS_WHEN
from sim_devices.stages.kernels import evaluate, valve_loop
from tests.gap.null.regulators import CORNERS, STEP, SUCTION, TIME, session_of


def cleared(asked: np.ndarray, leak: float = 0.0) -> np.ndarray:
    """Suction (n,) Pa by a PI loop of 15/s and a valve of 16 ms whose flow ends softly at 1.5 MPa/s; its integral goes
    within 50 ms while nothing is asked for. Air leaks in, ``leak`` 1/s times the suction."""
    p = valve = integral = 0.0
    out, most = np.empty(len(asked)), 1.5e6
    for k, u in enumerate(asked):
        out[k] = p
        integral += STEP * (9.0 * (u - p) if u > 0.0 else -integral / 0.05)
        valve += STEP * (most * np.tanh((15.0 * (u - p) + integral) / most) - valve) / 0.016
        p = max(p + STEP * (valve - leak * p), 0.0)
    return out


def block_of(recording: Callable[..., Recording], leak: float = 0.0) -> PressureBlock:
    taken = session_of(recording, cleared(np.interp(TIME, CORNERS, SUCTION), leak))
    return PressureBlock(GroupedSession([taken], ("pressure",)), library("cutometer"))


def test_an_integral_that_is_cleared_answers_each_suction_as_the_first() -> None:
    time = np.arange(0.0, 12.0, 2e-3)
    asked = np.where((time % 4.0 > 1.0) & (time % 4.0 < 3.0), -20e3, 0.0)
    loop = (0.035, 1.0, np.inf, np.inf, 3.0, 1.0, 0.0, 0.0, 0.0, 50e3, 0.0, np.inf, 0.0)
    stays, clears = (
        evaluate(valve_loop, time, asked, *loop, flag, 0.0, 0.0, 0.0).reshape(3, -1) for flag in (0.0, 1.0)
    )
    np.testing.assert_allclose(clears[1:], clears[[0, 0]], atol=1.0)
    assert np.max(np.abs(stays[1] - stays[0])) > 100.0


def test_a_command_that_touches_nought_may_clear_an_integral() -> None:
    """A sound session of another author was told a gauge off for .8 s, which is how long the integral took to fill
    again between two triangles."""
    time = np.arange(0.0, 8.0, 2e-3)
    asked = -20e3 * (1.0 - np.abs((time % 4.0) - 2.0) / 2.0)
    loop = (0.035, 1.0, np.inf, np.inf, 3.0, 1.0, 0.0, 0.0, 0.0, 50e3, 0.0, np.inf, 0.0)
    leaves, clears = (
        evaluate(valve_loop, time, asked, *loop, CLEARS_WHEN.index(when), 0.0, 0.0, 0.0).reshape(2, -1)
        for when in ("unasked", "touched")
    )
    later = slice(400, None)  # the chamber and its valve bring a little with them
    np.testing.assert_allclose(clears[1, later], clears[0, later], atol=5.0)
    assert np.max(np.abs(leaves[1, later] - leaves[0, later])) > 50.0


def test_a_command_that_stays_at_nought_clears_an_integral_at_once() -> None:
    """Of a sound session of an outside author with a sine that touches nought and a short rest, chi2 was 11 a row: no
    way of venting cleared an integral in the one and left it in the other."""
    time = np.arange(0.0, 8.02, 2e-3)
    loop = (0.035, 1.0, np.inf, np.inf, 3.0, 1.0, 0.0, 0.0, 0.0, 50e3, 0.0, np.inf, 5e3)
    touches = np.interp(time, [0, 2, 4, 6, 8], [0, -2e4, 0, -2e4, 0])
    never, still = (
        evaluate(valve_loop, time, touches, *loop, CLEARS_WHEN.index(when), 0.0, 0.0, 0.0)
        for when in ("never", "still")
    )
    np.testing.assert_allclose(still[time < 8.0], never[time < 8.0], atol=1e-6)
    rests = np.interp(time, [0, 2, 4, 4.02, 6.02, 8.02], [0, -2e4, 0, 0, -2e4, 0])
    unasked, still = (
        evaluate(valve_loop, time, rests, *loop, CLEARS_WHEN.index(when), 0.0, 0.0, 0.0)
        for when in ("unasked", "still")
    )
    again, first = (time > 4.2) & (time < 6.0), (time > 0.18) & (time < 1.98)
    assert np.max(np.abs(still[again] - still[first])) < 0.7 * np.max(np.abs(unasked[again] - unasked[first]))


def test_a_pi_loop_that_clears_its_integral_is_sound(recording: Callable[..., Recording]) -> None:
    """A sound session of an outside author was told a store that runs empty (.81), after 14 minutes: of a chi2 of 30 a
    row, no structure of ours left less than 7."""
    block = block_of(recording)
    found = fit(block)
    assert block.vent in (CLEARS, TOUCHED, STILL)  # each suction begins with none, and so it does in all
    assert found.chi2 / len(found.residual) < 1.2
    assert found.penalty < 25
    assert block.quantities(found.nuisance)["regulator_integral_rate"][0] == pytest.approx(0.6, rel=0.1)
    assert np.all(block.prior_sd[FLOW] <= FROZEN)


def weighed(asked: np.ndarray, gain: float, rate: float, weight: float, late: float, highest: float) -> np.ndarray:
    """Suction (n,) Pa by a PI loop of ``gain`` 1/s and ``rate`` 1/s whose set-point is weighed by ``weight`` and whose
    valve is ``late`` s; while nothing is asked for the integral goes on until the line has come to the air's pressure,
    and is cleared then. The line swings above it, or vents to ``highest`` Pa above it and no further."""
    p = valve = integral = 0.0
    out = np.empty(len(asked))
    for k, u in enumerate(asked):
        out[k] = p
        integral += STEP * gain * rate * (u - p)
        valve += STEP * (gain * (weight * u - p) + integral - valve) / late
        p = max(p + STEP * valve, -highest)
        integral *= 0.8 if u <= 0.0 and p < 20.0 else 1.0
    return out


@pytest.mark.parametrize(
    ("loop", "vent"),
    [
        ((8.6, 4.1, 0.4, 0.027, np.inf), SWINGS),
        ((9.0, 7.8, 0.715, 0.0135, np.inf), SWINGS),
        ((8.6, 4.1, 0.4, 0.027, 0.0), LANDS),
        ((9.0, 7.8, 0.715, 0.0135, 0.0), LANDS),
    ],
)
def test_one_that_clears_it_at_the_airs_pressure_is_sound(
    recording: Callable[..., Recording], loop: tuple[float, float, float, float, float], vent: Vent
) -> None:
    """Sound sessions of two other authors were told an overshoot (10 sigma) and a regulator's lag (13 sigma). One is
    found from a valve whose flow follows the pressure only."""
    taken = session_of(recording, weighed(np.interp(TIME, CORNERS, SUCTION), *loop))
    block = PressureBlock(GroupedSession([taken], ("pressure",)), library("cutometer"))
    found = fit(block)
    assert block.vent == vent
    assert found.chi2 / len(found.residual) < 1.2
    assert block.quantities(found.nuisance)["regulator_setpoint_weight"][0] == pytest.approx(loop[2], abs=0.05)


def test_a_leak_in_such_a_loop_is_no_other_make(recording: Callable[..., Recording]) -> None:
    """Its droop, which the integral repairs, is that of a set-point of which the loop sees less."""
    block = block_of(recording, leak=2.0)
    assert block.structure is None
    assert fit(block).chi2 / len(block.measured) > 2.0
