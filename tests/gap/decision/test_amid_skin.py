"""Claims amid skin whose law no simulation meets."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gap.decision.gaps import Shrink
from gap.decision.posterior import posterior
from gap.decision.thresholds import INSTRUMENT
from gap.decision.verdict import Findings, decide
from tests.gap.decision.waves import weak_wave


@pytest.mark.parametrize(
    ("stage", "left", "without_skin", "said"),
    [
        ("sensor", 1.8, 0.0, "claimed"),
        ("sensor", 2.5, 0.0, "amid skin of another law"),
        ("sensor", 2.5, np.inf, "claimed"),
        ("tissue", 1.8, np.inf, "claimed"),
        ("tissue", 2.5, np.inf, "amid skin of another law"),
    ],
)
def test_an_effect_that_leaves_much_of_skin_is_not_claimed(
    linear, candidate, stage: str, left: float, without_skin: float, said: str
) -> None:
    """Fibres of 15.8 sigma were claimed that left a gap of 9 of a sound sheet of another law."""
    comparison, known = weak_wave(linear, candidate, 2.5)
    found = posterior(comparison, known, INSTRUMENT)
    first = found.causes[0]
    effects = tuple(replace(e, stage=stage) for e in first.effects)
    member = replace(first.hypothesis, effects=effects)
    cause = replace(first, hypothesis=member, members=(member,))
    findings = Findings(
        replace(found, causes=(cause,)), INSTRUMENT, fitted=Shrink(9.0, left), without_skin=without_skin
    )
    assert INSTRUMENT.seen < first.detectability < INSTRUMENT.overwhelming
    assert decide(findings).rules[0].startswith(said)
