"""Events as explanations: something for a while repairs anything a bit."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import pytest

from gap.decision.classes import Cause
from gap.decision.findings import Findings
from gap.decision.gaps import Shrink
from gap.decision.posterior import posterior
from gap.decision.thresholds import INSTRUMENT
from gap.decision.verdict import decide
from tests.gap.decision.waves import weak_wave


def test_patches_that_leave_a_gap_are_no_explanation(linear, candidate) -> None:
    comparison, known = weak_wave(linear, candidate, 4.0)
    found = posterior(comparison, known, INSTRUMENT, ())
    first = found.causes[0]
    cases = ((False, 3.0, "claimed"), (True, 1.5, "claimed"), (True, 3.0, "patched"))
    for (event, gap, rule), number in product(cases, (1, 2)):
        patched = replace(found, causes=(_as_event(first, event, number),), gap_after=gap, unexplained=0.0)
        assert decide(Findings(patched, INSTRUMENT)).rules[0].startswith(rule)


@pytest.mark.parametrize(("nats", "rule"), [(200.0, "claimed"), (0.0, "patched")])
def test_an_event_that_axes_show_is_not_doubted_for_the_rest_of_a_skin(linear, candidate, nats, rule) -> None:
    """Samples lost in a burst (331 sigma in the axes, a gap of 18.3 to 1.2 there) were unknown, as skin left 2.8."""
    comparison, known = weak_wave(linear, candidate, 4.0)
    found = posterior(comparison, known, INSTRUMENT, ())
    found = replace(found, causes=(_as_event(found.causes[0], True),), gap_before=12.0, gap_after=2.8, unexplained=0.0)
    findings = Findings(found, INSTRUMENT, fitted=Shrink(18.3, 1.2), without_skin=nats)
    assert decide(findings).rules[0].startswith(rule)


def _as_event(cause: Cause, event: bool, number: int = 1) -> Cause:
    """A cause whose effect is said to be an event, or not, and to act a ``number`` of times."""
    effects = tuple(replace(e, event=event) for e in number * cause.hypothesis.effects)
    return replace(cause, hypothesis=replace(cause.hypothesis, effects=effects))


@pytest.mark.parametrize(
    ("event", "before", "after", "rule"),
    [
        (True, 2.55, 2.06, "patched"),
        (False, 2.55, 2.06, "claimed"),
        (True, 2.55, 1.2, "claimed"),
        (True, 1.25, 1.15, "claimed"),
    ],
)
def test_an_event_that_leaves_most_of_the_gap_is_no_explanation(linear, candidate, event, before, after, rule) -> None:
    """A tone that changed within ten seconds was claimed as a jump of the gauge for half a second."""
    comparison, known = weak_wave(linear, candidate, 4.0)
    found = posterior(comparison, known, INSTRUMENT, ())
    cause = _as_event(found.causes[0], event)
    found = replace(found, causes=(cause,), gap_before=1.14, gap_after=1.09, unexplained=0.0)
    assert decide(Findings(found, INSTRUMENT, fitted=Shrink(before, after))).rules[0].startswith(rule)
