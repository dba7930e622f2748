"""A regulator of another structure whose gauge has slow noise: what that leaves is no other regulator's."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from acquire.recording.model import Recording
from gap.effects.load import library
from gap.inference.least_squares import fit
from gap.null.groups import GroupedSession
from gap.null.suction_pressure import PressureBlock
from tests.gap.null.regulators import CORNERS, NOISE, STEP, SUCTION, TIME, session_of

TAU, ZETA, RESETS, WEIGHT = 0.041, 1.05, 5.0, 0.55


def weighed(asked: np.ndarray) -> np.ndarray:
    """Suction (n,) Pa by a PI loop whose proportional part sees a share of the set-point, which may swing above the
    air's pressure."""
    gain, late = 1.0 / (2.0 * ZETA * TAU), TAU / (2.0 * ZETA)
    p = valve = integral = 0.0
    out = np.empty(len(asked))
    for k, u in enumerate(asked):
        out[k] = p
        given = gain * (WEIGHT * u - p) + integral
        integral += STEP * gain * RESETS * (u - p)
        valve += STEP * (given - valve) / late
        p += STEP * valve
    return out


def test_a_weighed_set_point_is_found_in_slow_noise(recording: Callable[..., Recording]) -> None:
    """A sound session of an outside author left 1.27 of chi2 a row with its own structure, by slow noise;
    none was taken, and a lag was claimed instead."""
    taken = session_of(recording, weighed(np.interp(TIME, CORNERS, SUCTION)))
    pressure = taken.streams["pressure"]
    forgets = np.exp(-0.02 / 0.6)
    drawn = np.random.default_rng(3).normal(size=len(pressure.value))
    slow = 0.5 * NOISE * np.sqrt(1.0 - forgets**2) * lfilter([1.0], [1.0, -forgets], drawn)
    noisy = replace(taken, streams={"pressure": replace(pressure, value=pressure.value + slow)})
    block = PressureBlock(GroupedSession([noisy], ("pressure",)), library("cutometer"))
    found = fit(block)
    assert found.chi2 / len(found.residual) < 1.1
    assert found.penalty < 25
    told = block.quantities(found.nuisance)
    assert told["regulator_setpoint_weight"] == (pytest.approx(WEIGHT, abs=0.05), "1")
    assert told["regulator_integral_rate"] == (pytest.approx(RESETS, rel=0.1), "1/s")
