"""The loop of a driven axis with dry friction, against integrations of its equations of motion."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sim_devices.chain import FloatArray
from sim_devices.stages.axes import LOOP_RATE, MASS, AxisLoop

CORNERS = np.array([0.0, 0.5, 1.5, 2.5, 3.0])
WAY = 1e-3 * np.array([0.0, 0.0, 1.0, 0.0, 0.0])
KP, KI, KD = 3 * MASS * LOOP_RATE**2, MASS * LOOP_RATE**3, 3 * MASS * LOOP_RATE


def moved(time: FloatArray, **rubbing: float) -> FloatArray:
    """Positions (n,) m of an axis that is sent to and fro."""
    loop = AxisLoop("axes", "actuator", ("target_1", "load_1"), ("axis_1",), **rubbing)
    signals = {"target_1": np.interp(time, CORNERS, WAY), "load_1": np.zeros(len(time))}
    loop.advance(loop.fresh(), time, signals)
    return signals["axis_1"]


@pytest.mark.parametrize("length", [2e-6, 6e-6, 4e-5])
def test_presliding_friction_follows_dahl(length: float) -> None:
    """Dahl 1968: f' = x' (f_c - f sign x') / length, however long the steps of a log are."""

    def slope(t: float, s: FloatArray) -> list[float]:
        integral, x, v, f = s
        error = np.interp(t, CORNERS, WAY) - x
        return [error, v, (KP * error + KI * integral - KD * v - f) / MASS, (0.15 * v - abs(v) * f) / length]

    time = np.arange(0.0, 3.0, 0.02)
    parts, state = [np.zeros(1)], np.zeros(4)
    for a, b in itertools.pairwise(CORNERS):
        at = time[(time > a + 1e-9) & (time <= b + 1e-9)]
        out = solve_ivp(slope, (a, b), state, method="LSODA", t_eval=[*at[:-1], b], rtol=1e-8, atol=1e-11)
        parts.append(out.y[1])
        state = out.y[:, -1]
    expected = np.concatenate(parts)[: len(time)]
    assert np.abs(expected - moved(time)).max() > 4e-6, "friction shows"
    np.testing.assert_allclose(moved(time, coulomb=0.15, presliding=length), expected, atol=6e-7)


def test_what_sticks_breaks_away_at_the_stiction() -> None:
    """An axis at rest builds up the whole stiction before it moves: its speed in the law is its own, and not that which
    the coil would give it without friction."""
    time = np.arange(0.0, 0.9, 5e-4)
    coulomb, stiction = 0.05, 0.1
    held = np.interp(time, CORNERS, WAY)  # the error while the axis stays at rest
    integral = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(time) * (held[1:] + held[:-1]))])
    breaks = time[np.argmax(KP * held + KI * integral > coulomb + stiction)]
    for speed in (1e-4, 1e-3):
        there = moved(time, coulomb=coulomb, stiction=stiction, stribeck_speed=speed)
        assert abs(time[np.argmax(there > 1e-7)] - breaks) < 3e-3
