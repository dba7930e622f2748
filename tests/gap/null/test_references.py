"""Reference specimens in a diagnosis: effects that they tie down are named, an error of their own is no finding."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from acquire.recording.model import Recording
from gap import diagnose
from gap.design import simulated as own
from gap.diagnosis import Diagnosis
from gap.effects.load import library
from gap.inference.hypothesis import FROZEN, to_unit
from gap.inference.least_squares import fit, under
from gap.null.groups import GroupedSession
from gap.null.robot import robot_problems
from gap.null.robot_axes import QUANTITIES, AxesBlock
from gap.null.robot_loop import CONTROLLERS
from gap.null.suction import suction_problems
from gap.null.suction_regulator import SIZE, VENTED, ZERO
from protocols.specimens import stated
from sim_devices.effects import effects

SKIN = [own.step_hold(-20e3, 6.0, 4.0), own.triangle(-20e3, 4.0, 1, 4.0)]
STEPS = [
    replace(own.step_hold(0.0, 4.0, 4.0), specimen="gauge step", known=stated("gauge step", {"height": h}))
    for h in ("0.500 mm", "1.000 mm")
]
MEMBRANE = [replace(leg, specimen="reference membrane") for leg in (own.step_hold(-20e3, 3.0, 3.0), SKIN[1])]
MANOMETER = [replace(own.step_hold(-20e3, 3.0, 3.0), specimen="manometer")]


def suction(name: str = "", values: Mapping[str, float] | None = None, *, references: bool = True) -> list[Recording]:
    acting = [(effects("aspiration")[name], values or {})] if name else []
    legs = SKIN + (STEPS + MEMBRANE + MANOMETER if references else [])
    return own.suction_session("aspiration", np.random.default_rng(11), acting, legs=legs)


ROBOT = [own.direction_cycles(0.0, 0.0, 1.2e-3, 4.0, 1), own.direction_cycles(1.57, 0.0, 1.2e-3, 4.0, 1)]
SPRING = [
    replace(leg, specimen="reference spring", known=stated("reference spring", {"k": "400 N/m"})) for leg in ROBOT
]
WEIGHT = [
    replace(
        own.direction_cycles(0.0, 0.0, 1e-4, 4.0, 1),
        specimen="dead weight",
        known=stated("dead weight", {"mass": "20 g", "direction": direction}),
    )
    for direction in ("0, 0, -1", "1, 0, 0")
]
HEAVY = {"mass": "50 g", "direction": "1, 0, 0"}


def robot(name: str = "", values: Mapping[str, float] | None = None) -> list[Recording]:
    acting = [(effects("microrobot")[name], values or {})] if name else []
    return own.robot_session(np.random.default_rng(11), acting, legs=[*ROBOT, *SPRING, *WEIGHT])


def test_a_sound_instrument_s_references_are_at_the_noise() -> None:
    problems, candidates = suction_problems(suction(), library("aspiration"))
    assert [p.name for p in problems] == ["pressure", "manometer", "reference", "height"]
    for block in problems[:3]:
        assert fit(block).chi2 < 1.25 * len(block.measured)
    creep = next(c for c in candidates if c.name == "slow_creep")
    lag = next(c for c in candidates if c.name == "sensor_low_pass")
    assert creep.blocks == ("height",)  # a person's tissue does it
    assert lag.blocks == ("reference", "height")  # and the reference speaks first


def test_a_gauge_may_be_zeroed_anew_for_each_recording() -> None:
    """Zeros that differed by 15 Pa were told a gauge that is off for a while, and one that is off for good."""
    taken = suction()
    zeros = 15.0 * np.random.default_rng(3).normal(size=len(taken))
    streams = [{**r.streams, "pressure": replace(r.streams["pressure"])} for r in taken]
    for own_streams, zero in zip(streams, zeros, strict=True):
        gauge = own_streams["pressure"]
        own_streams["pressure"] = replace(gauge, value=gauge.value + zero)
    problems, _ = suction_problems(
        [replace(r, streams=s) for r, s in zip(taken, streams, strict=True)], library("aspiration")
    )
    for block in problems[:2]:
        null = fit(block)
        assert null.chi2 < 1.25 * len(block.measured), block.name
        assert null.penalty < 30.0, block.name
    found = fit(problems[0]).nuisance[SIZE:]
    assert np.std(found - zeros) < 5.0


def test_a_solid_shows_the_slow_noise_of_the_height_on_skin() -> None:
    """It was not whitened on references, and divided their evidence by 1.2 to 2.7."""
    rng, taken = np.random.default_rng(4), []
    solid = [replace(own.step_hold(-20e3, 10.0, 10.0), specimen="rigid block") for _ in range(3)]
    for r in own.suction_session("aspiration", np.random.default_rng(11), legs=SKIN + solid):
        h = r.streams["apex_height"]
        forgets = np.exp(-np.diff(h.time) / 1.5)
        slow = [rng.normal()]
        for keep in forgets:
            slow.append(keep * slow[-1] + np.sqrt(1.0 - keep**2) * rng.normal())
        heights = replace(h, value=h.value + 2.5e-6 * np.array(slow))
        taken.append(replace(r, streams={**r.streams, "apex_height": heights}))
    problems, _ = suction_problems(taken, library("aspiration"))
    reference, height = problems[1:]
    assert reference.row_noise.memory is not None
    assert reference.row_noise.memory[0][0] == pytest.approx(2.5e-6, rel=0.5)
    assert height.row_noise.memory == reference.row_noise.memory


def test_a_weight_hangs_before_its_recording_begins() -> None:
    """A loop of little integral gain takes 0.4 s to hold it: a sound session was told a transducer's gain for it."""
    weights = own.robot_session(np.random.default_rng(2), legs=[replace(WEIGHT[1], known=stated("dead weight", HEAVY))])
    axes = AxesBlock(GroupedSession(weights, QUANTITIES), {})
    axes._take(CONTROLLERS[-1], held=False)
    predicted = axes._predict(axes.prior_mean, {}).reshape(3, -1)
    at_rest = axes.stamps < axes.stamps[0] + 0.5
    assert np.ptp(predicted[:, at_rest], axis=1).max() < 1e-6


def _step(change) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time from the first sample, reading and noise of a step's rows, whose record is ``change``d (time, value)."""
    recordings = []
    for r in suction():
        if r.info.specimen == "gauge step" and str(r.info.specimen_properties["height"]).startswith("0.001"):
            h = r.streams["apex_height"]
            r = replace(r, streams={**r.streams, "apex_height": replace(h, value=change(h.time - h.time[0], h.value))})
        recordings.append(r)
    problems, _ = suction_problems(recordings, library("aspiration"))
    block = next(p for p in problems if p.name == "reference")
    number = next(k for k, r in enumerate(recordings) if "0.001" in str(r.info.specimen_properties.get("height", "")))
    at = block.rows.recording == number
    return block.rows.time[at] - block.rows.time[at][0], block.measured[at], block.sigma[at]


def test_the_moments_in_which_a_step_is_moved_are_left_out_whatever_is_read_of_it() -> None:
    """A gain of a half, and a step that left as its record ended, were told a jump and a scale for a moment."""
    time, value, sigma = _step(lambda t, v: v)
    moved = time[np.flatnonzero(np.diff(value > 0.5e-3))]
    _, _, halved = _step(lambda t, v: 0.45 * v)
    np.testing.assert_array_equal(halved > 1e-3, sigma > 1e-3)
    assert np.all((sigma > 1e-3)[np.min(np.abs(time[:, None] - moved), axis=1) < 1.0])
    assert np.mean(sigma > 1e-3) < 0.5
    _, _, leaving = _step(lambda t, v: np.where(t > t[-1] - 0.1, 0.9 * v, v))
    assert leaving[-1] > 1e-3
    assert not sigma[-1] > 1e-3


def test_a_robot_s_references_are_at_the_noise() -> None:
    problems, _ = robot_problems(robot(), library("microrobot"))
    reference = next(p for p in problems if p.name == "reference")
    assert fit(reference).chi2 < 1.25 * len(reference.measured)


def test_what_is_known_of_a_specimen_is_a_tolerance() -> None:
    """A spring 10 % softer than stated, within an uncertainty of 1 % or of 20 %."""
    chi2 = []
    for uncertainty in ("1 %", "20 %"):
        said = stated("reference spring", {"k": f"440 N/m ± {uncertainty}"})
        recordings = [
            replace(r, info=replace(r.info, specimen_properties=said)) if r.info.specimen == "reference spring" else r
            for r in robot()
        ]
        problems, _ = robot_problems(recordings, library("microrobot"))
        reference = next(p for p in problems if p.name == "reference")
        fitted = fit(reference)
        chi2.append(fitted.chi2 + fitted.penalty)
    assert chi2[0] > chi2[1] + 100


def named(diagnosis: Diagnosis) -> set[str]:
    first = diagnosis.verdict.posterior.causes[0]
    return set(first.names) if diagnosis.verdict.verdict == "effect" else set()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("effect", "values"),
    [
        ("scale_error", {"error": 0.08}),
        ("sensor_low_pass", {"tau": 0.08}),  # one of .1 s skin alone shows
        ("gauge_gain", {"error": 0.06}),
    ],
)
def test_references_name_what_skin_alone_leaves_open(effect: str, values: dict[str, float]) -> None:
    assert effect in named(diagnose(suction(effect, values), quick=True))
    alone = diagnose(suction(effect, values, references=False), quick=True)
    others = {n for c in alone.verdict.posterior.causes if c.probability > 0.02 for n in c.names}
    assert named(alone) != {effect} or others - {effect}


@pytest.mark.slow
@pytest.mark.parametrize("references", [True, False])
def test_friction_of_the_rim_is_named_and_comes_first_on_skin_alone(references: bool) -> None:
    """Without a reference it shows by 5.5 sigma: skin of another law takes up the rest."""
    d = diagnose(suction("rim_friction", {"width": 3e-5}, references=references), quick=True)
    assert "rim_friction" in d.verdict.causes[0].names
    assert bool(named(d)) == references


@pytest.mark.slow
@pytest.mark.parametrize(("effect", "values"), [("sensor_gain", {"error": 0.08}), ("crosstalk", {"share": 0.05})])
def test_the_robot_s_references_name(effect: str, values: dict[str, float]) -> None:
    assert effect in named(diagnose(robot(effect, values), quick=True))


def test_a_gauge_s_zero_that_closes_the_loop_shows_while_it_is_vented_only() -> None:
    """A vented probe is at the air's pressure: a zero of 0.2 mbar, as sound as any, was told a leak by 14 nats."""
    problems, _ = suction_problems(suction("gauge_offset", {"offset": 80.0, "form": 0}), library("aspiration"))
    pressure = next(p for p in problems if p.name == "pressure")
    found = fit(pressure)
    assert found.nuisance[ZERO] == pytest.approx(0.0, abs=20.0)
    assert found.nuisance[VENTED] == pytest.approx(80.0, abs=20.0)
    # Nor is a vented line under suction to a sensor that reads the pressure.
    group = pressure.groups[0][0]
    time, recorded = pressure.session.recorded("pressure", group)["pressure"]
    true = pressure.true(group, time, recorded)
    rests, acts = recorded > -100.0, recorded < -5e3
    assert np.median(true[rests]) == pytest.approx(0.0, abs=20.0)
    assert np.median((true - recorded)[acts]) == pytest.approx(0.0, abs=20.0)
    frozen = pressure.prior_sd.copy()
    frozen[VENTED] = FROZEN
    assert fit(under(pressure, pressure.prior_mean, frozen)).objective > found.objective + 20.0


def test_a_manometer_tells_a_gauge_of_two_slopes_from_a_leak() -> None:
    """The mean over a quarter of a second, which takes the noise out of the fed pressure, smeared each step of the
    gauge's error: the gauge was told a leak by 45 sigma."""
    bent = {"error": -0.1, "knee": 5e3}
    problems, candidates = suction_problems(suction("gauge_gain", bent | {"form": 3.0}), library("aspiration"))
    manometer, gauge = problems[1], next(c for c in candidates if c.key == "gauge_gain[form=3]")
    unit = np.array([to_unit(p, bent[p.name]) for p in gauge.parameters])
    known = fit(manometer, (gauge,), unit)
    assert known.chi2 < 1.25 * len(manometer.measured)
    assert fit(manometer).objective > known.objective + 40.0


def test_a_hose_that_leaks_shows_on_a_manometer_and_a_rim_does_not() -> None:
    _, candidates = suction_problems(suction(), library("aspiration"))
    blocks = {c.form: c.blocks for c in candidates if c.name == "rim_leak"}
    assert blocks[3] == ("manometer", "reference", "height")
    assert blocks[0] == ("reference", "height")


def test_a_membrane_may_be_a_cap_of_rubber() -> None:
    """Its curve was told a pressure that leaks into the height, as the prior of that curve was strained."""
    taken, elastic = [], stated("reference membrane", {"memory": "0.1 %"})
    legs = [*SKIN, *STEPS, *(replace(leg, known=elastic) for leg in MEMBRANE)]
    for r in own.suction_session("aspiration", np.random.default_rng(11), legs=legs):
        if r.info.specimen == "reference membrane":
            height, caps = r.streams["apex_height"], np.linspace(-0.5, 1.5, 500)
            top = float(height.value.max())
            cap = top * np.interp(height.value / top, 0.25 * caps + 0.75 * caps**3, caps)
            r = replace(r, streams={**r.streams, "apex_height": replace(height, value=cap)})
        taken.append(r)
    problems, candidates = suction_problems(taken, library("aspiration"))
    reference, null = problems[1], fit(problems[1])
    leaking = next(c for c in candidates if c.key == "crosstalk[form=3]")
    starts = [np.array([at, knee]) for at in (0.1, 0.9) for knee in (0.3, 0.7)]
    with_leak = max(fit(reference, (leaking,), u).log_evidence(1.0, reference.prior_scales) for u in starts)
    assert with_leak < null.log_evidence(1.0, reference.prior_scales) + 3.0
