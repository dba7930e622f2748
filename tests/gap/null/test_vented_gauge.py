"""A gauge in the loop that is off shows in the record while suction acts, and not while the line is vented."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from acquire.recording.model import Recording
from gap.design import simulated as own
from gap.effects.load import library
from gap.inference.least_squares import fit
from gap.null.groups import GroupedSession
from gap.null.suction_line import EMPTY
from gap.null.suction_pressure import VENTED, PressureBlock

OFF = 100.0  # Pa


def session(empty: float) -> list[Recording]:
    """Recordings by a right gauge beside one in the loop that is off, which matters wholly from ``empty`` Pa on."""
    recordings = []
    legs = [own.triangle(-20e3, 6.0, 3, 5.0), own.step_hold(-10e3, 6.0, 5.0), own.triangle(-12e3, 5.0, 3, 5.0)]
    for r in own.suction_session("cutometer", np.random.default_rng(2), legs=legs):
        series = r.streams["pressure"]
        suction = np.clip(-np.asarray(series.value) / empty, 0.0, 1.0)
        recordings.append(
            replace(r, streams={**r.streams, "pressure": replace(series, value=series.value - OFF * suction)})
        )
    return recordings


@pytest.mark.parametrize("empty", [150.0, EMPTY])
def test_from_which_suction_on_a_line_is_vented_is_told(empty: float) -> None:
    block = PressureBlock(GroupedSession(session(empty), ("pressure",)), library("cutometer"))
    assert block.empty == empty
    found = fit(block)
    assert found.chi2 / len(found.residual) < 1.1
    assert found.nuisance[VENTED] == pytest.approx(OFF, abs=30.0)


def test_a_gauge_that_is_right_asks_for_nothing() -> None:
    legs = [own.step_hold(-20e3, 4.0, 3.0)]
    recordings = own.suction_session("cutometer", np.random.default_rng(2), legs=legs)
    assert PressureBlock(GroupedSession(recordings, ("pressure",)), library("cutometer")).empty == EMPTY
