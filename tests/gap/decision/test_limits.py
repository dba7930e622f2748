"""Bounds on the strength of effects."""

from __future__ import annotations

import pytest

from gap.decision.gaps import Shrink
from gap.decision.limits import beyond_the_fitted
from tests.gap.decision.waves import judge, weak_wave


def test_a_bound_does_not_contradict_what_fits_best(linear, candidate) -> None:
    """A force constant that varies by 58 per m fitted best and was not claimed, beside 'weaker than 8.6 per m'."""
    comparison, known = weak_wave(linear, candidate, 3.15)
    elsewhere = {"waveform": Shrink(0.93, 0.93)}
    quiet = judge(comparison, known, fitted=Shrink(0.95, 0.93), held_out=elsewhere)
    assert not quiet.claims
    key = quiet.causes[0].effects[0].key
    found = beyond_the_fitted({key: 1e-3, "another": 2e-3}, quiet)
    assert found["another"] == 2e-3
    assert found[key] > 0.1
    claimed = judge(comparison, known, fitted=Shrink(0.95, 0.85), held_out=elsewhere)
    assert beyond_the_fitted({key: 1e-3}, claimed) == {key: 1e-3}
    # A pulse of 1.2 mN was claimed beside 'weaker than 3.7 mN'.
    assert beyond_the_fitted({key: 1e3}, claimed)[key] == pytest.approx(found[key])
