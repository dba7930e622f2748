"""A regulator whose valve gives little flow, beside one whose pressure changes at a limited rate."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from acquire.recording.model import Recording
from gap.effects.load import library
from gap.inference.hypothesis import FROZEN
from gap.inference.least_squares import fit
from gap.null.blocks import GroupedSession
from gap.null.suction_pressure import PressureBlock
from gap.null.suction_regulator import SPAN
from tests.gap.null.regulators import CORNERS, STEP, SUCTION, TIME, session_of


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
    taken = session_of(recording, of_little_flow(np.interp(TIME, CORNERS, SUCTION)))
    block = PressureBlock(GroupedSession([taken], ("pressure",)), library("cutometer"))
    found = fit(block)
    assert found.nuisance[SPAN] <= FROZEN
    assert found.chi2 / len(found.residual) < 1.2
    assert found.penalty < 25
    told = block.quantities(found.nuisance)
    assert 30e3 / told["regulator_opened_wholly"][0] == pytest.approx(230 / 16.7 * 1e3, rel=0.1)
