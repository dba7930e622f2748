"""Claims amid skin whose law no simulation meets."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gap.decision.classes import Cause
from gap.decision.findings import Findings
from gap.decision.gaps import Shrink
from gap.decision.posterior import Posterior, posterior
from gap.decision.thresholds import INSTRUMENT
from gap.decision.verdict import decide
from tests.gap.decision.waves import weak_wave


def first_of(linear, candidate, stage: str) -> tuple[Posterior, Cause]:
    """A posterior and its first cause, whose effect acts in a ``stage``."""
    found = posterior(*weak_wave(linear, candidate, 3.15), INSTRUMENT)
    first = found.causes[0]
    effects = tuple(replace(e, stage=stage) for e in first.effects)
    member = replace(first.hypothesis, effects=effects)
    return found, replace(first, hypothesis=member, members=(member,))


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
    found, first = first_of(linear, candidate, stage)
    findings = Findings(
        replace(found, causes=(first,)), INSTRUMENT, fitted=Shrink(9.0, left), without_skin=without_skin
    )
    assert INSTRUMENT.seen < first.detectability < INSTRUMENT.overwhelming
    assert decide(findings).rules[0].startswith(said)


@pytest.mark.parametrize(("share", "said"), [(0.97, "amid skin of another law"), (0.7, "claimed")])
def test_an_effect_of_the_device_is_not_claimed_beside_one_of_skin_as_large(
    linear, candidate, share: float, said: str
) -> None:
    """A tone that rose by a logistic (16.9 sigma) was told a lamp that drifts (17.2), which left a gap of 3.6."""
    found, skin = first_of(linear, candidate, "tissue")
    first = replace(found.causes[0], detectability=17.2)
    causes = replace(found, causes=(first, replace(skin, probability=0.0, detectability=share * 17.2)))
    findings = Findings(causes, INSTRUMENT, fitted=Shrink(16.9, 3.6), without_skin=0.0)
    assert decide(findings).rules[0].startswith(said)


@pytest.mark.parametrize(
    ("sigma", "left", "said"),
    [(47.0, 2.2, "claimed"), (15.8, 2.2, "amid skin of another law"), (47.0, 4.0, "amid skin of another law")],
)
def test_an_effect_of_skin_that_stands_out_beyond_doubt_may_leave_skin_of_another_law(
    linear, candidate, sigma: float, left: float, said: str
) -> None:
    """A breath of 22 um under a robot took a gap of 6.0 to 2.2 on a sheet beside an Eyring arm: it was unknown."""
    found, skin = first_of(linear, candidate, "tissue")
    causes = replace(found, causes=(replace(skin, detectability=sigma),))
    findings = Findings(causes, INSTRUMENT, fitted=Shrink(6.0, left), without_skin=0.0)
    assert decide(findings).rules[0].startswith(said)


@pytest.mark.parametrize(
    ("sigma", "left", "said"), [(9.6, 1.53, "of another form"), (9.6, 1.2, "claimed"), (34.0, 1.83, "claimed")]
)
def test_a_faint_effect_leaves_another_waveform_near_the_noise(
    linear, candidate, sigma: float, left: float, said: str
) -> None:
    """A low pass of a transducer was told a change of tone (9.6 sigma) that left 1.53 on a withheld waveform."""
    found, first = first_of(linear, candidate, "sensor")
    causes = replace(found, causes=(replace(first, detectability=sigma),))
    tested = {"waveform": Shrink(2.22, left)}
    findings = Findings(causes, INSTRUMENT, fitted=Shrink(1.71, 1.16), held_out=tested, without_skin=0.0)
    assert decide(findings).rules[0].startswith(said)


@pytest.mark.parametrize(
    ("input_gap", "gap", "left", "said"),
    [(2.1, 0.96, 0.9, "unexplained input"), (1.5, 0.96, 0.9, "claimed"), (2.1, 7.4, 1.5, "claimed")],
)
def test_an_effect_of_axes_near_the_noise_is_none_under_forces_that_no_skin_explains(
    linear, candidate, input_gap: float, gap: float, left: float, said: str
) -> None:
    """A sound robot was told a windup (11.8 sigma): its force where motion turned was not the one that it had."""
    found, first = first_of(linear, candidate, "controller")
    causes = replace(found, causes=(replace(first, detectability=11.8),))
    findings = Findings(causes, INSTRUMENT, fitted=Shrink(gap, left), without_skin=np.inf, input_gap=input_gap)
    assert decide(findings).rules[0].startswith(said)
