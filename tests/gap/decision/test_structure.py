"""When a regulator is taken to be of a structure that nobody knows."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from acquire.recording.model import Recording
from gap.decision.structure import regulator_unknown
from gap.effects.load import library
from gap.null.suction import suction_problems
from gap.search.compare import Comparison, Effort, compare
from sim_devices.stages.kernels import evaluate, rate_limit, second_order
from tests.gap.null.regulators import CORNERS, SUCTION, TIME, session_of, with_windup

ASKED = ("slew_limit", "leak", "overshoot", "regulator_lag")


def compared(recording: Callable[..., Recording], suction: np.ndarray) -> Comparison:
    effects = {k: e for k, e in library("cutometer").items() if e.name in ASKED}
    problems, candidates = suction_problems([session_of(recording, suction)], effects)
    return compare(problems, candidates, Effort().quicker())


def test_one_that_winds_up_is(recording: Callable[..., Recording]) -> None:
    assert regulator_unknown(compared(recording, with_windup(np.interp(TIME, CORNERS, SUCTION))))


@pytest.mark.parametrize("rate", [6e4, 1e9])
def test_one_that_an_effect_explains_is_not(recording: Callable[..., Recording], rate: float) -> None:
    """A rate that is limited far beyond its tolerance, and a leak: drive and resistance would do much of the first."""
    asked = np.interp(TIME, CORNERS, SUCTION)
    suction = evaluate(second_order, TIME, evaluate(rate_limit, TIME, asked, rate, rate), 0.04, 1.0)
    leaking = suction if rate < 1e9 else suction - 0.05 * suction**1.5 / 30e3**0.5
    comparison = compared(recording, leaking)
    assert not comparison.problems["pressure"].explained
    assert not regulator_unknown(comparison)
