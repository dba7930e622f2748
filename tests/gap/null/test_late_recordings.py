"""A regulator that looks at its command every few milliseconds is late by another part of that in each recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from acquire.recording.model import Recording
from gap.design import simulated as own
from gap.effects.load import library
from gap.inference.evidence import Fit
from gap.inference.least_squares import fit
from gap.null.blocks import GroupedSession
from gap.null.suction_pressure import PressureBlock


@cache
def sound() -> Sequence[Recording]:
    legs = [own.step_hold(-20e3, 6.0, 4.0), own.triangle(-20e3, 3.0, 2, 4.0), own.triangle(-15e3, 2.0, 2, 4.0)]
    return tuple(own.suction_session("aspiration", np.random.default_rng(5), legs=legs))


def fitted(late: float) -> tuple[PressureBlock, Fit]:
    """The fit of a session whose second recording follows its command ``late`` s later than the others."""
    recordings = list(sound())
    asked = {q: replace(s, time=np.asarray(s.time) - late) for q, s in recordings[1].setpoints.items()}
    recordings[1] = replace(recordings[1], setpoints=asked)
    block = PressureBlock(GroupedSession(recordings, ("pressure",)), library("aspiration"))
    return block, fit(block)


@pytest.mark.parametrize("late", [0.0, 2.2e-3])
def test_a_recording_late_by_part_of_a_look_is_sound(late: float) -> None:
    """An outside author's crosstalk was claimed together with samples lost in one recording."""
    block, null = fitted(late)
    assert null.chi2 / len(null.residual) < 1.15
    assert null.penalty < 10.0
    middle = np.array([np.mean(block.session.span(k)) for k in range(3)])
    early = block.early(middle)
    assert early[1] - 0.5 * (early[0] + early[2]) == pytest.approx(-late, abs=8e-4)


def test_a_recording_late_by_a_sample_is_not() -> None:
    assert fitted(0.04)[1].penalty > 100.0
