"""Reference recordings (rigid block, open air) know nothing of the skin that was recorded before them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gap.blind import effects_robot, effects_suction, effects_wide, robot, robot_tissue, tissue
from gap.blind.cases import _subject
from gap.blind.laboratory import ROBOT_NOISE, SUCTION_NOISE
from gap.blind.session import Session
from gap.blind.strength import Subject
from gap.blind.vocabulary import INSTRUMENTS, stage_of

SUCTION = ("cutometer", "aspiration")
STRANGE = [law for law in tissue.LAWS if law != "conventional"]


def references(session: Session) -> list[int]:
    return [k for k, r in enumerate(session.recordings) if r.specimen != "skin"]


def sound_subject(instrument: str, tier: str, law: str) -> Subject:
    """The first subject with skin of ``law`` that a tier draws, with skin recordings before its references."""
    for seed in range(1000):
        subject, reference = _subject(instrument, tier, "dense", np.random.default_rng(seed))
        if reference and subject.law == law and subject.session.recordings[0].specimen == "skin":
            return subject
    raise AssertionError(f"no subject with {law} skin before a reference recording")


def tail(session: Session) -> Session:
    """The last recording of skin and the reference recordings after it."""
    first = references(session)[0] - 1
    since = int(np.searchsorted(session.t, session.recordings[first].start - 1.0))
    return replace(session, recordings=session.recordings[first:], t=session.t[since:], dt=session.dt[since:])


def assert_white_around_a_constant(x: np.ndarray) -> None:
    n, parts = x.size, 16
    z = (x - x.mean()) / x.std()
    assert abs(z[1:] @ z[:-1]) < 4.5 * n**0.5
    ramp = np.linspace(-1, 1, n)
    assert abs(z @ ramp) < 4.5 * np.linalg.norm(ramp)
    means = np.array([part.mean() * part.size**0.5 for part in np.array_split(z, parts)])
    assert np.sum(means**2) < 45  # chi square of 15 degrees: 1e-4


@pytest.mark.parametrize("law", STRANGE)
@pytest.mark.parametrize("instrument", SUCTION)
def test_the_height_of_a_rigid_block_is_noise_around_a_constant(instrument: str, law: str):
    subject = sound_subject(instrument, "T6", law)
    clean, noisy = subject.record({})["apex_height"], subject.record({}, noisy=True)["apex_height"]
    noise, step = SUCTION_NOISE[instrument]["apex_height"]
    assert references(subject.session)
    for k in references(subject.session):
        assert np.all(clean[k] == 0)
        assert_white_around_a_constant(noisy[k])
        assert abs(noisy[k].mean()) < 5 * np.hypot(noise, step / 2)  # one noisy reading is the zero
        assert noisy[k].std() < 1.1 * np.hypot(noise, step / 2)


@pytest.mark.parametrize("law", [law for law in robot_tissue.LAWS if law != "conventional"])
def test_transducers_in_open_air_are_noise_around_zero(law: str):
    subject = sound_subject("microrobot", "T6", law)
    noisy = subject.record({}, noisy=True)
    for k in references(subject.session):
        for leg in robot.LEGS:
            assert_white_around_a_constant(noisy[leg][k])
            assert abs(noisy[leg][k].mean()) < 5 * ROBOT_NOISE["leg"][0] / noisy[leg][k].size ** 0.5


@pytest.mark.parametrize("instrument", INSTRUMENTS)
def test_no_effect_brings_skin_into_a_reference_recording(instrument: str):
    """With each effect at its strongest another person's skin leaves the same reference recordings."""
    every, laws = (effects_robot, robot_tissue) if instrument == "microrobot" else (effects_suction, tissue)
    drawn = sound_subject(instrument, "T1", "conventional")
    one = replace(drawn, session=tail(drawn.session), scatter=np.ones(len(tail(drawn.session).recordings)))
    rng = np.random.default_rng(8)
    person = robot_tissue.draw(rng) if instrument == "microrobot" else tissue.draw(instrument, rng)
    assert "plastic" in laws.LAWS
    others = [replace(one, law=law, tissue=person, scatter=1.05 * one.scatter) for law in ("plastic", "fractional")]
    where, sound = references(one.session), one.record({})
    assert where == list(range(1, len(one.session.recordings)))
    for form in every.FORMS + every.OUTSIDE + effects_wide.FORMS:
        if instrument not in form.instruments:
            continue
        knobs = form.knobs(form.strong, instrument, 3)
        recorded = one.record(knobs)
        for other in others:
            compared = other.record(knobs)
            assert any(np.any(recorded[c][0] != compared[c][0]) for c in recorded)
            for channel, traces in recorded.items():
                for k in where:
                    off = compared[channel][k] - traces[k]
                    if "tare_late" in knobs:  # the one tare of the session was read on skin: a constant everywhere
                        off = off - off[0]
                    assert np.abs(off).max() < 1e-15, (form.concept, form.name, channel)
        if not form.outside and stage_of(form.concept) == "tissue":
            for channel, traces in recorded.items():
                assert all(np.array_equal(traces[k], sound[channel][k]) for k in where), (form.name, channel)


@pytest.mark.parametrize("instrument", INSTRUMENTS)
def test_detectability_expects_no_skin_in_reference_recordings(instrument: str):
    """Neither the skin's parameters nor the scatter of its compliance move them where the nuisance is removed."""
    subject = sound_subject(instrument, "T1", "conventional")
    subject = replace(subject, session=tail(subject.session), scatter=np.ones(len(tail(subject.session).recordings)))
    where, laws = references(subject.session), robot_tissue if instrument == "microrobot" else tissue
    n_free, n_off = len(laws.free_parameters(subject.law)), len(subject.session.lab.tolerances)
    for view, nuisance in zip(subject._views, subject._nuisances, strict=True):
        flags = {c: [np.full(x.size, float(k in where)) for k, x in enumerate(subject._nominal[c])] for c in view}
        rows = subject._whitened(flags, view) > 0
        scatters = n_free + n_off + np.array(where)
        assert np.all(nuisance.sensitivities[np.ix_(rows, np.arange(n_free))] == 0)
        assert np.all(nuisance.sensitivities[:, scatters] == 0)
        assert np.all(np.any(nuisance.sensitivities[~rows][:, :n_free] != 0, axis=0))
