"""An effect that takes away next to nothing of a gap must stand out the more."""

from __future__ import annotations

import pytest

from gap.decision.gaps import Shrink
from gap.decision.thresholds import RIG
from tests.gap.decision.waves import judge, weak_wave


@pytest.mark.parametrize(
    ("strength", "after", "said"),
    [(3.15, 0.93, "undetectable"), (3.15, 0.90, "effect"), (4.0, 0.93, "effect")],
)
def test_a_faint_effect_needs_more_than_many_samples(linear, candidate, strength, after, said) -> None:
    """Six of seven claims of 5 to 8 sigma that took less than .04 of the gap in their channels were wrong."""
    comparison, known = weak_wave(linear, candidate, strength)
    verdict = judge(comparison, known, fitted=Shrink(0.96, after), held_out={"waveform": Shrink(0.98, 0.90)})
    assert verdict.verdict == said
    assert said == "effect" or verdict.settled_by == "takes little away"


def test_of_a_strained_tolerance_or_a_rig_little_is_enough(linear, candidate) -> None:
    comparison, known = weak_wave(linear, candidate, 3.15)
    assert judge(comparison, known, fitted=Shrink(0.96, 0.93), strained=True).claims
    assert judge(comparison, known, RIG, fitted=Shrink(1.2, 1.16)).claims
