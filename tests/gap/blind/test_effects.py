"""The table of effects: complete, in the vocabulary, and every form does something that can be seen."""

from __future__ import annotations

import numpy as np
import pytest

from gap.blind import effects_robot, effects_suction, effects_wide
from gap.blind.forms import Form
from gap.blind.vocabulary import CONCEPTS, INSTRUMENTS, STAGES, concepts_of, stage_of

KNOWN = effects_suction.FORMS + effects_robot.FORMS + effects_wide.FORMS
OUTSIDE = effects_suction.OUTSIDE + effects_robot.OUTSIDE
# A constant gain of the height is a stiffness: nothing in a recording of skin can show it.
INVISIBLE = {("sensor_gain", "constant"), ("scale_error", "constant")}


def test_vocabulary_covers_every_stage_of_every_instrument():
    for instrument in INSTRUMENTS:
        names = concepts_of(instrument)
        assert len(names) >= 14
        assert {stage_of(n) for n in names} == set(STAGES)
    assert len(CONCEPTS) >= 40


@pytest.mark.parametrize("instrument", INSTRUMENTS)
@pytest.mark.parametrize("own", [False, True])
def test_every_concept_has_a_textbook_form_and_one_of_our_own(instrument: str, own: bool):
    assert {f.concept for f in KNOWN if instrument in f.instruments and f.own is own} == set(concepts_of(instrument))


def test_unknown_effects_are_outside_the_vocabulary():
    assert all(f.outside and f.concept not in CONCEPTS for f in OUTSIDE)
    for instrument in INSTRUMENTS:
        assert len({f.concept for f in OUTSIDE if instrument in f.instruments}) >= 6


def test_knobs_repeat_for_a_seed_and_scale_with_the_instrument():
    form = Form("sensor_offset", "x", True, "±offset", 1.0, {"when": (0.0, 1.0), "k": range(3)}, length=True)
    small, large = form.knobs(0.5, "cutometer", 1), form.knobs(0.5, "aspiration", 1)
    assert abs(small["offset"]) == 0.5
    assert large["offset"] == 7 * small["offset"]
    assert small["when"] == large["when"]
    assert small["k"] in (0.0, 1.0, 2.0)
    assert Form("leak", "x", True, "1/slew", 1.0).knobs(0.25, "cutometer", 1) == {"slew": 4.0}


def every(instrument: str) -> list[Form]:
    """Forms of an instrument; of the aspiration only those that the Cutometer, on the same chain, does not have."""
    forms = [f for f in KNOWN + OUTSIDE if instrument in f.instruments]
    return forms if instrument != "aspiration" else [f for f in forms if "cutometer" not in f.instruments]


@pytest.mark.parametrize("instrument", INSTRUMENTS)
def test_every_effect_changes_the_recordings(subjects, instrument: str):
    subject = subjects[instrument]
    for form in every(instrument):
        # Lazily: some draws cannot be seen (a sign of a force that the session never has), then another can.
        deltas = (subject.detectability(form.knobs(form.strong, instrument, seed)) for seed in range(1, 5))
        if (form.concept, form.name) in INVISIBLE:
            assert next(deltas) < 0.5, form
        else:
            assert any(2 < delta < np.inf for delta in deltas), (form.concept, form.name)


@pytest.mark.parametrize("instrument", INSTRUMENTS)
def test_effects_fade_with_their_strength(subjects, instrument: str):
    subject = subjects[instrument]
    for form in every(instrument):
        # One lost sample shifts all after it, and a tare before each recording takes away what is left of the last.
        if not form.steps and form.name not in ("closed up", "each recording anew"):
            faint = subject.detectability(form.knobs(1e-6 * form.strong, instrument, 1))
            assert faint < 0.5, (form.concept, form.name, faint)


@pytest.mark.parametrize("instrument", INSTRUMENTS)
def test_a_strength_is_found_for_a_detectability(subjects, instrument: str):
    form = next(f for f in KNOWN if instrument in f.instruments and f.concept == "sensor_hysteresis")
    strength, delta = subjects[instrument].calibrate(form, 12.0, 4)
    assert delta == pytest.approx(12.0, rel=0.1)
    assert subjects[instrument].detectability(form.knobs(strength, instrument, 4)) == delta


def test_an_effect_too_weak_for_its_target_stays_plausible(subjects):
    form = next(f for f in KNOWN if (f.concept, f.name) == ("sensor_gain", "constant"))
    strength, delta = subjects["cutometer"].calibrate(form, 50.0, 4)
    assert strength == form.strong
    assert delta < 0.5


def test_detectability_beside_another_effect_counts_only_its_own_share(subjects):
    leak, drift = {"leak": 1.0}, {"drift": 3e-5}
    subject = subjects["cutometer"]
    assert subject.detectability(drift, leak) == pytest.approx(subject.detectability(drift), rel=0.05)
    assert subject.detectability({}, leak) < 1e-6
