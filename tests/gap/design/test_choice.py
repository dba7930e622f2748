"""The next experiment: its worth in closed form, the catalogue's limits, files, and a choice that helps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import yaml

from acquire.cli.check import limits_of
from gap.design import simulated as own
from gap.design.answers import asked_for, believed
from gap.design.anylaw import lagged
from gap.design.beliefs import within_tolerance
from gap.design.bench import Bench, telling
from gap.design.catalogue import catalogue
from gap.design.choice import certain, choose
from gap.design.experiment import Experiment, ExperimentError, fault, read, write
from gap.design.information import Known, worth
from gap.effects import library
from protocols import Limits, compile_protocol, load

LEGS = [own.step_hold(-30e3, 5.0, 3.0), own.triangle(-30e3, 5.0, 1, 3.0)]
LIMITS = limits_of("cutometer", None)


def test_two_sure_explanations_far_apart_are_worth_one_bit() -> None:
    rng = np.random.default_rng(1)
    far = worth(np.array([[0.0], [20.0]]), np.array([0.5, 0.5]), ["a", "b"], rng)
    assert far.information == pytest.approx(1.0, abs=1e-6)
    assert (far.before, far.after) == (0.5, pytest.approx(1.0, abs=1e-6))
    same = worth(np.zeros((2, 1)), np.array([0.5, 0.5]), ["a", "b"], rng)
    assert same.information == pytest.approx(0.0, abs=1e-6)


def test_the_chance_of_a_right_answer_is_that_of_two_normals() -> None:
    """Two normals d apart: right with probability Φ(d/2)."""
    got = worth(np.array([[0.0], [2.0]]), np.array([0.5, 0.5]), ["a", "b"], np.random.default_rng(2), draws=20000)
    assert got.after == pytest.approx(0.8413, abs=0.01)


def test_draws_of_one_cause_are_not_told_apart() -> None:
    """Two parameters of one effect that differ visibly tell nothing of the cause."""
    points, weights = np.array([[0.0], [9.0], [0.0], [9.0]]), np.full(4, 0.25)
    blurred = worth(points, weights, ["a", "a", "b", "b"], np.random.default_rng(3))
    assert blurred.information == pytest.approx(0.0, abs=0.01)


def test_what_is_left_is_as_long_as_it_is_detectable() -> None:
    rng = np.random.default_rng(4)
    known = Known({("a",): rng.normal(size=30), ("b",): 20.0 * rng.normal(size=30)}, temper=2.0)
    change = rng.normal(size=30)
    assert np.linalg.norm(known.left(change)) == pytest.approx(float(known.distance(change)))


def test_an_unknown_shared_with_the_session_is_known_better_in_the_experiment() -> None:
    """An unknown of unit variance, seen in n rows of the session, has 1/(n + 1) of it left in the experiment."""
    ones = np.ones(9)
    known = Known({("gain",): ones})
    there = {("gain",): np.ones(1)}
    points = known.seen(there, np.zeros((9, 2)), np.array([[0.0, 1.0]]))
    assert np.linalg.norm(points[1] - points[0]) == pytest.approx(1.0 / np.sqrt(1.0 + 1.0 / 10.0))
    # An effect that looks in both like the unknown is not seen at all, but for the prior's resistance.
    like = known.seen(there, np.column_stack([0 * ones, ones]), np.array([[0.0, 1.0]]))
    assert np.linalg.norm(like[1] - like[0]) == pytest.approx(0.1 / np.sqrt(1.1), rel=1e-6)


def test_a_lag_goes_on_through_the_rest_between_recordings() -> None:
    t = np.arange(0.0, 2.0, 0.01)
    first, second = lagged([t, t + 3.0], [np.ones_like(t), np.zeros_like(t)], 1.0)
    assert first[-1] == pytest.approx(1 - np.exp(-2.0), abs=0.01)
    assert second[0] == pytest.approx(first[-1] * np.exp(-1.01), rel=0.02)


def test_the_catalogue_stays_within_limits_and_within_the_session() -> None:
    every = catalogue("cutometer", LEGS, LIMITS)
    assert {e.specimen for e in every} >= {"skin", "rigid block"}
    assert min(float(e.leg.quantity_tables["pressure"][1].min()) for e in every) >= -30e3
    station = Limits.parse({"pressure": {"low": "-150 mbar", "high": "0 mbar"}})
    weak = catalogue("cutometer", LEGS, LIMITS.intersect(station))
    step = next(e for e in every if e.specimen == "gauge step")
    assert step.as_dict()["specimen_properties"]["height"] == {"value": 0.3e-3, "se": 2e-6, "unit": "m"}
    assert {e.waveform for e in weak if e.specimen == "skin"} == {"a step of a third"}
    assert {e.specimen for e in catalogue("cutometer", LEGS, LIMITS, ["rigid block"])} == {"rigid block"}
    assert len({e.id for e in every}) == len(every)


def test_files_of_an_experiment_compile_and_are_read_again(tmp_path) -> None:
    asked = catalogue("cutometer", LEGS, LIMITS)[0]
    write(asked, tmp_path)
    said = yaml.safe_load((tmp_path / "experiment.yaml").read_text())
    assert (said["schema"], said["id"], said["stop"]) == ("gap-experiment/1", asked.id, False)
    setpoints = compile_protocol(load(tmp_path / "protocol.yaml"), LIMITS)
    back = read(tmp_path)
    time, value = back.quantities["pressure"]
    assert time[-1] == pytest.approx(setpoints.duration)
    np.testing.assert_allclose(value, setpoints.table()[1]["pressure"])
    (tmp_path / "setpoints.csv").write_text("t,pressure\n0,x\n")
    with pytest.raises(ExperimentError, match=r"setpoints\.csv: is no table of set-points"):
        read(tmp_path)


def _answer(asked: Experiment, **changes):
    leg = asked.leg
    tables = {q: (t, v * changes.get("size", 1.0)) for q, (t, v) in leg.quantity_tables.items()}
    made = own.Leg(tables, leg.duration, changes.get("specimen", leg.specimen))
    return own.suction_session("cutometer", np.random.default_rng(1), legs=[made])[0]


def test_an_answer_to_another_experiment_is_told_by_specimen_and_set_points(tmp_path) -> None:
    asked = next(e for e in catalogue("cutometer", LEGS, LIMITS) if e.specimen == "rigid block")
    write(asked, tmp_path)
    wanted = read(tmp_path)
    assert fault(_answer(asked), wanted) == ""
    assert "'rigid block' was asked for" in fault(_answer(asked, specimen="skin"), wanted)
    assert "% of their range off" in fault(_answer(asked, size=0.5), wanted)


def test_answers_are_believed_by_their_files_or_by_what_their_id_says(tmp_path) -> None:
    asked = next(e for e in catalogue("cutometer", LEGS, LIMITS) if e.specimen == "rigid block")
    write(asked, tmp_path)

    def named(recording, name):
        return replace(recording, info=replace(recording.info, experiment=name))

    good, on_skin, weak = (named(_answer(asked, **c), asked.id) for c in ({}, {"specimen": "skin"}, {"size": 0.5}))
    strange = named(_answer(asked), asked.id.replace("rigid", "frigid"))
    plain = _answer(asked)
    for known in (asked_for([tmp_path], []), {}):
        kept, answers = believed([plain, good, on_skin, weak, strange], known)
        assert kept == [plain, good]
        assert [bool(a.fault) for a in answers] == [False, True, True, True]
        assert "'rigid block' was asked for" in answers[1].text
        assert "no experiment of that id is known" in answers[3].text


def test_a_choice_splits_a_lag_of_the_sensor_from_skin_and_stops_when_certain() -> None:
    lag = next(e for e in library("cutometer").values() if e.name == "sensor_low_pass")
    session = own.suction_session("cutometer", np.random.default_rng(2), legs=LEGS)
    some = {k: e for k, e in library("cutometer").items() if e.name in ("sensor_low_pass", "rim_friction", "leak")}
    cause = {"effects": ["sensor_low_pass"], "class": ["sensor_low_pass", "rim_friction"], "probability": 0.8,
             "where": [lag.name], "parameters": {}}  # fmt: skip
    report = {"schema": "gap-report/1", "causes": [cause], "none_probability": 0.1}
    choice = choose(report, session, LIMITS, some)
    assert choice.experiment is not None
    assert choice.experiment.right_after > choice.experiment.right_before
    assert choice.experiment.information / choice.experiment.minutes == pytest.approx(
        max(w.information / e.minutes for e, w in choice.considered)
    )
    again = choose(report, session, LIMITS, some)
    assert again.as_dict() == choice.as_dict()
    never_none = report | {"none_probability": 0.0, "outside_probability": 0.0}
    assert np.isfinite(choose(never_none, session, LIMITS, some, ["rigid block"]).probability)
    sure = {"schema": "gap-report/1", "causes": [cause | {"class": ["sensor_low_pass"], "probability": 0.97}]}
    assert choose(sure, session, LIMITS, some).as_dict()["stop"] is True
    within = Limits.parse({"pressure": {"low": "-1 mbar", "high": "0 mbar"}})
    assert "no experiment is within the limits" in choose(report, session, within, some, ["skin"]).reason


def test_what_the_library_lacks_is_told_from_a_cause_by_a_reference() -> None:
    """A lag between pressure and height may be skin's; a membrane has none."""
    some = {k: e for k, e in library("cutometer").items() if e.name in ("sensor_low_pass", "rim_friction", "leak")}
    session = own.suction_session("cutometer", np.random.default_rng(2), legs=LEGS)
    cause = {"effects": ["sensor_low_pass"], "class": ["sensor_low_pass"], "probability": 0.6,
             "parameters": {"tau": {"value": 0.2, "se": 0.05}}}  # fmt: skip
    report = {"schema": "gap-report/1", "causes": [cause], "none_probability": 0.0, "outside_probability": 0.4}
    choice = choose(report, session, LIMITS, some, ["skin", "reference membrane"])
    assert choice.experiment is not None
    assert choice.experiment.specimen == "reference membrane"
    assert choice.experiment.right_before == pytest.approx(0.6, abs=0.01)
    assert choice.experiment.right_after > 0.7
    assert set(choice.experiment.separates) == {"sensor_low_pass", "outside"}
    # The membrane has shown it once, and need not again.
    answer = _answer(choice.experiment)
    again = choose(report, [*session, answer], LIMITS, some, ["reference membrane"])
    assert max(w.information for _, w in again.considered) < 0.5 * choice.experiment.information
    # The same waveform would err in the same way: it is not even considered.
    assert choice.experiment.waveform not in {e.waveform for e, _ in again.considered}


def test_a_pair_s_imitators_are_drawn_with_the_effect_that_they_share() -> None:
    """A manometer tells a gauge's offset from a leak, whatever slew limit acts beside either."""
    names = ("gauge_offset", "leak", "slew_limit")
    some = {k: e for k, e in library("cutometer").items() if e.name in names}
    session = own.suction_session("cutometer", np.random.default_rng(2), legs=LEGS)
    pair = {"effects": ["gauge_offset", "slew_limit"], "probability": 0.9,
            "class": ["gauge_offset + slew_limit", "leak + slew_limit"],
            "parameters": {"gauge_offset.offset": {"value": -300.0, "se": 20.0}}}  # fmt: skip
    report = {"schema": "gap-report/1", "causes": [pair], "none_probability": 0.0, "outside_probability": 0.1}
    choice = choose(report, session, LIMITS, some, ["manometer", "rigid block"])
    assert choice.experiment is not None
    assert choice.experiment.specimen == "manometer"
    assert {"gauge_offset + slew_limit", "leak + slew_limit"} <= set(choice.experiment.separates)


def test_what_a_session_leaves_open_was_not_told_apart_by_it() -> None:
    """Explanations ten σ apart that a report holds equally probable: the simulated σ was too small."""
    rng = np.random.default_rng(4)
    known = Known({("a",): rng.normal(size=30)})
    change = rng.normal(size=30)
    change *= 10.0 / float(known.distance(change))
    both = np.stack([change, np.zeros(30)], axis=1)
    wider = known.tempered(both, np.array([0.5, 0.5]))
    assert float(wider.distance(change)) == pytest.approx(3.0, rel=0.05)
    assert known.tempered(both, np.array([0.99, 0.01])) is known  # a report that has decided


def test_a_cause_is_certain_by_its_share_of_what_can_be_named() -> None:
    cause = {"effects": ["leak"], "class": ["leak"], "probability": 0.9}
    assert "leak is certain" in certain({"causes": [cause]}, "cutometer").reason
    assert certain({"causes": [cause | {"probability": 0.8}]}, "cutometer") is None
    assert certain({"causes": [cause | {"class": ["leak", "gauge_gain"]}]}, "cutometer") is None


def test_what_is_within_a_tolerance_is_not_looked_for() -> None:
    """A gauge's zero of half a tolerance led a report, and two manometers were asked for where a lens was bent."""
    within = {"effects": ["gauge_offset"], "class": ["gauge_offset"], "probability": 0.97, "tolerated": True}
    report = {"causes": [within], "none_probability": 0.01}
    assert certain(report, "cutometer") is None
    assert within_tolerance(report) == pytest.approx(0.97)
    assert certain({"causes": [within | {"tolerated": False}]}, "cutometer") is not None


def test_repeats_are_simulated_once_and_count_as_often_as_they_are() -> None:
    once, twice = (own.suction_session("cutometer", np.random.default_rng(2), legs=[*LEGS[:n], *LEGS]) for n in (0, 1))
    assert telling(twice) == {0: 2, 2: 1}
    one, two = Bench(once), Bench(twice)
    assert len(two.session.legs) == len(one.session.legs) == 2
    assert two.end > one.end
    ratio = two.part("p", LEGS[:1], [0.0], [2]).sigma / two.part("p", LEGS[:1], [0.0]).sigma
    np.testing.assert_allclose(ratio, np.sqrt(0.5))


def test_forces_on_a_post_tell_nothing_as_no_diagnosis_looks_at_them() -> None:
    leg = own.direction_cycles(0.0, 0.0, 1e-3, 4.0, 1)
    bench = Bench(own.robot_session(np.random.default_rng(2), legs=[leg]))
    free, post = (bench.part("p", [replace(leg, specimen=s)], [0.0]) for s in ("open air", "rigid post"))
    channels = len(post.sigma) // len(bench.channels)
    ratio = dict(zip(bench.channels, (post.sigma / free.sigma)[::channels], strict=True))
    assert ratio["axis_position_1"] == 1.0
    assert ratio["force_z"] > 1e3
