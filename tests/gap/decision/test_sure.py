"""A claim is more probable by far than all else together."""

from __future__ import annotations

from dataclasses import replace

import pytest

from gap.decision.findings import Findings
from gap.decision.gaps import Shrink
from gap.decision.posterior import posterior
from gap.decision.thresholds import INSTRUMENT, RIG, Thresholds
from gap.decision.verdict import decide
from tests.gap.decision.waves import judge, weak_wave


@pytest.mark.parametrize(("probability", "t", "said"), [(0.56, INSTRUMENT, "not sure"), (0.7, INSTRUMENT, "claimed")])
def test_a_cause_of_little_more_than_even_odds_is_not_claimed(
    linear, candidate, probability: float, t: Thresholds, said: str
) -> None:
    """A zero that jumps in each recording (delta 214) was told a drift with .56; all six such claims were wrong."""
    comparison, known = weak_wave(linear, candidate, 4.0)
    found = posterior(comparison, known, t)
    cause = replace(found.causes[0], probability=probability)
    verdict = decide(Findings(replace(found, causes=(cause,)), t, fitted=Shrink(13.0, 1.1)))
    assert verdict.settled_by == said
    assert verdict.claims == (said == "claimed")


def test_of_a_rig_even_odds_are_enough() -> None:
    assert RIG.sure < 0.5 < INSTRUMENT.sure


@pytest.mark.parametrize(("strength", "most"), [(1.8, 0.2), (8.0, 1.0)])
def test_a_cause_that_is_not_seen_is_improbable(linear, candidate, strength: float, most: float) -> None:
    """Sound sessions in which something stood out by three to five sigma were told it with .45."""
    comparison, known = weak_wave(linear, candidate, strength)
    verdict = judge(comparison, known, fitted=Shrink(13.0, 1.1))
    assert verdict.claims == (most == 1.0)
    found = verdict.posterior
    assert 0.5 * most < found.causes[0].probability <= most
    assert found.named + found.none + found.outside == pytest.approx(1.0)
