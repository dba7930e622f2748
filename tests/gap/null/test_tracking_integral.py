"""A PI loop whose integral tracks the valve where that is at its end: back-calculation against windup."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from acquire.recording.model import Recording
from gap.effects.load import library
from gap.inference.least_squares import fit
from gap.null.groups import GroupedSession
from gap.null.suction_pressure import PressureBlock
from tests.gap.null.regulators import CORNERS, STEP, SUCTION, TIME, session_of


def tracking(asked: np.ndarray, uneven: float) -> np.ndarray:
    """Suction (n,) Pa by a PI loop of 12.5/s and .8/s and a valve of 20 ms that gives no more than 240 kPa/s, which the
    integral tracks within 150 ms; it is cleared once the line has come to the air's pressure. The valve's two ways
    differ by ``uneven``."""
    p = valve = integral = 0.0
    out, most = np.empty(len(asked)), 2.4e5
    for k, u in enumerate(asked):
        out[k] = p
        wanted = 12.5 * (u - p) + integral
        given = min(max(wanted, -most), most)
        integral += STEP * (10.0 * (u - p) + (given - wanted) / 0.15)
        integral *= 0.0 if u <= 0.0 and p <= 50.0 else 1.0
        valve += STEP * (given - valve) / 0.02
        p = max(p + STEP * valve * (1.0 + uneven if valve > 0.0 else 1.0 - uneven), 0.0)
    return out


@pytest.mark.parametrize("uneven", [0.0, 0.15])
def test_a_loop_whose_integral_tracks_its_valve_is_sound(recording: Callable[..., Recording], uneven: float) -> None:
    """A sound session of an outside author left a chi2 of 965 a row, one of unequal ways 13, and took a quarter of an
    hour: of ours the integral waits meanwhile."""
    taken = session_of(recording, tracking(np.interp(TIME, CORNERS, SUCTION), uneven))
    block = PressureBlock(GroupedSession([taken], ("pressure",)), library("cutometer"))
    found = fit(block)
    assert found.chi2 / len(found.residual) < 1.1
    assert found.penalty < 25
    told = block.quantities(found.nuisance)
    assert told["regulator_integral_tracks"] == (pytest.approx(1 / 0.15, rel=0.15), "1/s")
    assert told["regulator_integral_rate"] == (pytest.approx(0.8, rel=0.1), "1/s")
