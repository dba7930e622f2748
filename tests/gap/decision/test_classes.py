"""Causes that are nearly as probable as the first one are one class with it."""

from __future__ import annotations

import pytest

from gap.decision.classes import Cause, Scored
from gap.decision.thresholds import INSTRUMENT
from gap.inference.evidence import Hypothesis
from sim_devices.chain import Parameter


@pytest.fixture
def causes(candidate):
    """``causes((names, probability, detectability), ...)``: a cause of each, that effects of such names make."""

    def made(*known: tuple[str, float, float]) -> list[Cause]:
        out = []
        for names, probability, detectability in known:
            effects = tuple(candidate(name, Parameter("a", "1", -30.0, 30.0)) for name in names.split("+"))
            h = Hypothesis(effects, {})
            out.append(Cause(h, (names,), probability, detectability, (h,)))
        return out

    return made


def _joined(causes: list[Cause]) -> list[Cause]:
    scored = Scored((), None, None, {}, {}, INSTRUMENT)  # type: ignore[arg-type]
    return scored._not_to_be_told_apart(causes)


def test_a_near_rival_is_one_class_with_the_first(causes) -> None:
    """An illumination that drifts was claimed at odds of 2.6 against the saturation that was there."""
    first, rest = _joined(causes(("drift", 0.63, 33.0), ("saturation", 0.25, 32.6), ("tilt", 0.01, 20.0)))
    assert first.names == ("drift", "saturation")
    assert first.probability == pytest.approx(0.88)
    assert [h.effects[0].name for h in first.members] == ["drift", "saturation"]
    assert first.hypothesis.effects[0].name == "drift"
    assert rest.names == ("tilt",)


@pytest.mark.parametrize(
    "known",
    [
        (("drift", 0.90, 33.0), ("saturation", 0.04, 32.0)),  # odds of 22
        (("drift", 0.40, 3.1), ("saturation", 0.30, 3.0)),  # neither is seen
        (("drift+lag", 0.60, 33.0), ("saturation", 0.30, 32.0)),
        (("drift", 0.60, 33.0), ("drift+lag", 0.30, 33.2)),
        (),
    ],
)
def test_others_stay_apart(causes, known: tuple) -> None:
    found = causes(*known)
    assert _joined(found) == found
