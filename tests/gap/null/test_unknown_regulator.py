"""Regulators of a structure that the library does not hold, simulated by themselves."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from acquire.recording.model import Recording
from gap.effects.load import library
from gap.inference.hypothesis import FROZEN
from gap.inference.least_squares import fit
from gap.null.blocks import GroupedSession
from gap.null.suction_pressure import PressureBlock
from gap.null.suction_regulator import UNKNOWN
from sim_devices.stages.kernels import FREE, evaluate, free_loop, second_order
from sim_devices.stages.kernels.loops import DRIVE_KNOTS, SPEED_KNOTS

STEP, NOISE = 1e-3, 30.0
TIME = np.arange(0.0, 40.0, STEP)
CORNERS = np.array([0, 2, 6, 10, 12, 12.001, 17, 17.001, 22, 22.001, 26, 26.001, 30, 30.001, 34, 34.001, 40])
SUCTION = 1e3 * np.array([0, 0, 30, 0, 0, 30, 30, 10, 10, 0, 0, 15, 15, 30, 30, 0, 0.0])


def with_windup(asked: np.ndarray) -> np.ndarray:
    """Suction (n,) Pa of a PI controller with back-calculation, a valve of 15 ms and a limited flow, of a chamber that
    air bleeds into."""
    gain, late, bleed, most, back = 16.0, 0.015, 0.2, 3.0e5, 0.1
    p, flow, integral, out = 0.0, 0.0, 0.0, np.empty(len(asked))
    for k, u in enumerate(asked):
        out[k] = p
        for _ in range(4):
            h, wanted = 0.25 * STEP, gain * (u - p) + integral
            given = min(max(wanted, -most), most)
            integral += h * (gain / bleed * (u - p) + (given - wanted) / back)
            flow += h * (given - flow) / late
            p = max(p + h * (flow - p / bleed), 0.0)
    return out


def choked(asked: np.ndarray) -> np.ndarray:
    """Suction (n,) Pa by a three-way valve between a store and the air, whose flow is that of ISO 6358 and which opens
    more readily to the air."""
    air, store, late, critical = 101.3e3, 40e3, 0.01, 0.3
    p, opened, out = 0.0, 0.0, np.empty(len(asked))

    def share(ratio: float) -> float:
        return 1.0 if ratio <= critical else np.sqrt(max(1.0 - ((ratio - critical) / (1.0 - critical)) ** 2, 0.0))

    for k, u in enumerate(asked):
        out[k] = p
        for _ in range(8):
            error, h = u - p, 0.125 * STEP
            wanted = min(max((error if error > 0 else 2.0 * error) / 16e3, -1.0), 1.0)
            opened += h * (wanted - opened) / late
            gives = (air - p) * share(store / (air - p)) if opened > 0 else air * share((air - p) / air)
            p = max(p + h * 4.0 * opened * gives, 0.0)
    return out


def block_of(recording: Callable[..., Recording], suction: np.ndarray) -> PressureBlock:
    measured = -suction[::20] + NOISE * np.random.default_rng(1).normal(size=len(TIME[::20]))
    made = recording({"pressure": measured}, TIME[::20], {"pressure": (CORNERS, -SUCTION)})
    return PressureBlock(GroupedSession([made], ("pressure",)), library("cutometer"), unknown=True)


@pytest.mark.parametrize(("regulator", "most"), [(with_windup, 1.5), (choked, 3.0)])
def test_a_regulator_of_another_structure_is_sound(
    recording: Callable[..., Recording], regulator: Callable[[np.ndarray], np.ndarray], most: float
) -> None:
    """Sound sessions of another author had gaps of 3.7 and 4: all else was hidden behind them."""
    block = block_of(recording, regulator(np.interp(TIME, CORNERS, SUCTION)))
    found = fit(block)
    assert block.prior_sd[UNKNOWN.start] > FROZEN
    assert found.chi2 / len(found.residual) < most
    told = block.quantities(found.nuisance)
    assert "regulator_time" not in told
    assert told["sampling_shift"][0] == pytest.approx(0.0, abs=8e-3)


def test_it_does_not_hide_a_pressure_that_falls_short(recording: Callable[..., Recording]) -> None:
    """At rest it meets its command: what is amiss in a hold is not its structure."""
    suction = with_windup(np.interp(TIME, CORNERS, SUCTION))
    found = fit(block_of(recording, suction - 0.02 * 30e3 * (suction / 30e3) ** 2))
    assert found.chi2 / len(found.residual) > 3.0


def test_a_second_order_is_none(recording: Callable[..., Recording]) -> None:
    suction = evaluate(second_order, TIME, np.interp(TIME, CORNERS, SUCTION), 0.05, 0.8)
    assert block_of(recording, suction).prior_sd[UNKNOWN.start] <= FROZEN


@pytest.mark.parametrize(("tau", "zeta"), [(0.04, 1.0), (0.03, 0.6)])
def test_a_free_loop_without_freedom_is_a_second_order(tau: float, zeta: float) -> None:
    asked = -np.interp(TIME, CORNERS, SUCTION)
    plain = evaluate(second_order, TIME, asked, tau, zeta)
    np.testing.assert_allclose(evaluate(free_loop, TIME, asked, tau, zeta, 30e3, *[0.0] * FREE), plain, atol=1.0)


def test_a_free_loop_solves_its_equations() -> None:
    time, span, tau, zeta = np.arange(0.0, 3.0, 2e-3), 20e3, 0.05, 0.8
    asked = -span * np.clip(time / 0.7, 0.0, 1.0)
    logs = np.random.default_rng(3).uniform(-0.4, 0.4, FREE)
    nd, nr = len(DRIVE_KNOTS), len(SPEED_KNOTS)
    drives, resists, rise = np.exp(logs[: 2 * nd]), np.exp(logs[2 * nd : 2 * (nd + nr)]), logs[2 * (nd + nr) :]

    def line(x: float, knots: np.ndarray, slopes: np.ndarray) -> float:
        ends = np.append(knots[1:], np.inf)
        own = slopes[: len(knots)] if x < 0 else slopes[len(knots) :]
        return float(np.sign(x) * np.sum(own * np.clip(abs(x) - knots, 0.0, ends - knots)))

    def rate(t: float, state: np.ndarray) -> list[float]:
        y, v, z = state
        u, q = float(np.interp(t, time, asked)), min(max(-y / span, 0.0), 1.0)
        e, side = u - y, 0 if u - y < 0 else 1
        push = line(e, np.array(DRIVE_KNOTS) * span, drives)
        undone = push - drives[side * nd] * e
        push *= np.exp(q * (rise[side] + q * rise[side + 5])) * (np.exp(rise[4]) if u > -1.0 else 1.0)
        way = 2 if v < 0 else 3
        drag = line(v, np.array(SPEED_KNOTS) * span / tau, resists) * np.exp(q * (rise[way] + q * rise[way + 5]))
        return [
            v,
            (push + z - 2 * zeta * tau * drag) / tau**2,
            (rise[9] * e + rise[10] * undone - z) / 0.2 / np.exp(rise[11]),
        ]

    exact = solve_ivp(rate, (0, time[-1]), [0, 0, 0], t_eval=time, rtol=1e-8, atol=1e-5, max_step=2e-3).y[0]
    np.testing.assert_allclose(evaluate(free_loop, time, asked, tau, zeta, span, *logs), exact, atol=5.0)
