"""Shrinkage on data not used, and the report: JSON by its contract, sentences, and the page."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import replace
from html.parser import HTMLParser
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest
from scipy.signal import lsim

from acquire.recording.model import Recording
from gap.data.quantities import quantity
from gap.data.splits import splits, splits_of_a_rig
from gap.data.waveform import waveform
from gap.decision.gaps import Shrink, shrink
from gap.decision.transfer import transferred
from gap.diagnosis import Diagnosis, diagnose
from gap.inference.evidence import Hypothesis
from gap.inference.least_squares import fit
from gap.report.document import as_json
from gap.report.figures import most_telling
from gap.report.html import page
from sim_devices.chain import Parameter

TIME = np.arange(0.0, 20.0, 0.02)


def test_shrink_is_the_share_of_the_gap_above_the_floor() -> None:
    assert shrink(7.3, 1.2) == pytest.approx(6.1 / 6.3)
    assert Shrink(5.0, 1.0).value == 1.0
    assert shrink(3.0, 4.0) < 0  # worse than before: a wrong effect, carried over
    assert shrink(0.9, 0.9) is None  # nothing stood above the floor,
    assert shrink(1.01, 1.29) is None  # or no more than the noise's own error: -28 says nothing


STEP = ([0.0, 1.0, 1.0, 11.0, 11.0, 20.0], [0.0, 0.0, -3e4, -3e4, 0.0, 0.0])
HALF = (STEP[0], [v / 2 for v in STEP[1]])
RAMP = ([0.0, 1.0, 9.0, 17.0, 20.0], [0.0, 0.0, -3e4, 0.0, 0.0])
CYCLIC = ([0.0, 1.0, 4.0, 7.0, 10.0, 13.0, 20.0], [0.0, 0.0, -3e4, 0.0, -3e4, 0.0, 0.0])


def test_an_effect_carries_over_though_the_nuisance_does_not(linear, candidate) -> None:
    """Half of the nuisance acts in the second recording only, so that the first cannot foretell it."""
    t = np.linspace(0.0, 1.0, 400)
    second = (t > 0.5).astype(float)
    wave, other = np.sin(40 * t), np.cos(40 * t) * (t <= 0.5)
    y = 3.0 + 20.0 * second + 2.0 * wave + np.random.default_rng(0).normal(size=400)
    effects = {"wave": lambda v: v["a"] * wave, "other": lambda v: v["a"] * other}
    problem = linear(y, np.column_stack([np.ones(400), second]), effects, np.full(2, 100.0), runs=2)
    known = [candidate(name, Parameter("a", "1", -10.0, 10.0)) for name in effects]
    null = Hypothesis((), {"linear": fit(problem)})
    answers = [Hypothesis((c,), {"linear": fit(problem, (c,))}) for c in known]
    right, wrong = (c.session for c in transferred({"linear": problem}, null, answers, {"recording": {1}}))
    assert right["recording"].before > 1.4
    assert right["recording"].value > 0.85
    assert abs(wrong["recording"].value) < 0.05


def test_an_event_is_not_tested_on_the_only_recording_that_shows_it(linear, candidate) -> None:
    """A burst of lost samples, seen by 331 sigma, was refused as its moment was asked of recordings without it."""
    t = np.linspace(0.0, 1.0, 400)

    def burst(at: float) -> np.ndarray:
        return np.exp(-np.square((t - at) / 0.02))

    y = 8.0 * burst(0.8) + np.random.default_rng(0).normal(size=400)
    problem = linear(y, np.ones((400, 1)), {"burst": lambda v: v["a"] * burst(v["at"])}, np.full(1, 100.0), runs=2)
    event = candidate("burst", Parameter("a", "1", -10.0, 10.0), Parameter("at", "1", 0.0, 1.0))
    null = Hypothesis((), {"linear": fit(problem)})
    answer = Hypothesis((event,), {"linear": fit(problem, (event,), np.array([0.9, 0.8]))})
    carried = transferred({"linear": problem}, null, [answer], {"with": {1}, "without": {0}})[0]
    assert set(carried.session) == set(carried.changed) == {"without"}


def test_channels_that_an_effect_leaves_alone_do_not_dilute_what_it_takes_away(linear, candidate) -> None:
    """A regulator was claimed that left a gap of 2.00 of 2.00 on another waveform: skin's, in the height (410005)."""
    t = np.linspace(0.0, 1.0, 400)
    wave, rng = np.sin(40 * t), np.random.default_rng(0)
    effects = {"wave": lambda v: v["a"] * wave}
    first = linear(2.0 * wave + rng.normal(size=400), np.ones((400, 1)), effects, runs=2)
    other = linear(5.0 * np.cos(70 * t) + rng.normal(size=400), np.ones((400, 1)), name="other", runs=2)
    problems = {"linear": first, "other": other}
    null = Hypothesis((), {name: fit(p) for name, p in problems.items()})
    known = candidate("wave", Parameter("a", "1", -10.0, 10.0))
    answer = Hypothesis((known,), null.fits | {"linear": fit(first, (known,))})
    carried = transferred(problems, null, [answer], {"recording": {1}})[0]
    assert carried.session["recording"].value < 0.3
    assert carried.changed["recording"].value > 0.9


def test_a_rhythm_carries_over_though_nobody_foretells_its_phase(linear, candidate) -> None:
    """Looks at equal intervals begin anew with every recording."""
    t = np.arange(0.0, 40.0, 0.1)
    second = t >= 20.0

    def waits(interval: float, phase: float) -> np.ndarray:
        return np.mod(t / interval - phase, 1.0)

    y = 3.0 * np.where(second, waits(1.7, 0.6), waits(1.7, 0.1)) + np.random.default_rng(0).normal(size=len(t)) / 3
    effects = {name: lambda v, k=k: v["a"] * waits(k, v["phase"]) for name, k in (("looks", 1.7), ("others", 0.9))}
    problem = linear(y, np.ones((len(t), 1)), effects, np.full(1, 100.0), runs=2)
    parameters = Parameter("a", "1", -10.0, 10.0), Parameter("phase", "1", 0.0, 1.0)
    known = [candidate(name, *parameters) for name in effects]
    null = Hypothesis((), {"linear": fit(problem)})
    answers = [Hypothesis((c,), {"linear": fit(problem, (c,), np.array([0.65, 0.1]), iterations=0)}) for c in known]
    before = float(np.sqrt(np.mean(np.square(null.fits["linear"].residual[second]))))
    right, wrong = (c.session for c in transferred({"linear": problem}, null, answers, {"recording": {1}}))
    assert right["recording"].after < 0.6 * before
    assert wrong["recording"].after > 0.9 * before


def test_waveforms_and_splits(recording) -> None:
    made = [
        recording({"pressure": 0 * TIME}, TIME, {"pressure": c}, repeat=n) for c, n in
        ((STEP, 1), (STEP, 2), (HALF, 1), (RAMP, 1))
    ]  # fmt: skip
    assert [waveform(r) for r in made] == ["step", "step", "step", "ramp"]
    assert waveform(recording({"pressure": 0 * TIME}, TIME, {"pressure": CYCLIC})) == "ramp, cyclic"
    assert waveform(recording({"pressure": 0 * TIME}, TIME)) == "-"
    assert splits(made) == {"level": {2}, "waveform": {3}, "repeat": {1}}
    assert splits(made[:1]) == {}


def test_only_the_same_command_makes_a_repeat_of_a_rig(recording) -> None:
    time = np.linspace(0.0, 10.0, 50)

    def run(command: tuple[list[float], list[float]] | None):
        return recording({"force": np.zeros(50)}, time, {"stretch": command} if command else {}, instrument="machine")

    slow, again = run(([0.0, 10.0], [0.0, 40.0])), run(([0.0, 10.01], [0.0, 40.0]))
    held = run(([0.0, 2.0, 10.0], [0.0, 40.0, 40.0]))
    assert waveform(slow) == waveform(held) == "ramp"
    assert splits_of_a_rig([slow, again, held]) == {"waveform": {2}, "repeat": {1}}
    assert splits_of_a_rig([slow, held]) == {"waveform": {1}}
    assert splits_of_a_rig([slow, run(([0.0, 10.0], [0.0, 20.0]))]) == {"waveform": {1}}
    assert splits_of_a_rig([run(None), run(None)]) == {"recording": {1}}
    assert splits_of_a_rig([slow]) == {}


class Valve:
    """Flow follows the opening; drawn from two commands."""

    name = "valve"
    channels = ("flow",)
    stages: ClassVar = {"opening": "actuator", "flow": "sensor"}
    units: ClassVar = {"opening": "V", "flow": "V"}
    parameters = (Parameter("gain", "1", 0.1, 10.0, None, 1.0, "log"),)

    def simulate(self, time, data, parameters, tap):
        return {"flow": tap("flow", parameters["gain"] * tap("opening", data["opening"]))}


def runs(recording, change, noise: float = 0.01) -> list[Recording]:
    """Two steps (one repeated) and a ramp through a valve that ``change`` spoils."""
    out = []
    for k, (shape, repeat) in enumerate(((STEP, 1), (STEP, 2), (RAMP, 1))):
        table = (shape[0], [-v / 3e4 for v in shape[1]])
        opening = np.interp(TIME, *table)
        flow = 2.0 * change(TIME, opening) + noise * np.random.default_rng(k).normal(size=len(TIME))
        out.append(
            recording({"flow": flow}, TIME + 30 * k, {"opening": (np.add(table[0], 30 * k), table[1])}, "valve", repeat)
        )
    return out


def lagging(time: np.ndarray, opening: np.ndarray) -> np.ndarray:
    """First-order lag of 0.5 s, exact between samples."""
    return lsim(([1.0], [0.5, 1.0]), opening, time)[1]


@pytest.fixture(scope="module")
def slow_valve(recording) -> Diagnosis:
    return diagnose(runs(recording, lagging), Valve())


@pytest.fixture(scope="module")
def report(slow_valve: Diagnosis) -> dict:
    return as_json(slow_valve)


def test_a_lag_is_found_and_its_gap_shrinks_on_what_was_not_used(report: dict) -> None:
    cause = report["causes"][0]
    assert report["verdict"] == "effect"
    assert "low_pass" in cause["class"]
    assert cause["parameters"]["tau"]["value"] == pytest.approx(0.5, rel=0.1)
    assert set(cause["shrink"]) == {"fitted", "repeat", "waveform"}
    assert min(cause["shrink"].values()) > 0.85


def test_the_report_keeps_its_contract(report: dict) -> None:
    """The keys of gap-report/1 and their types: other programs read them."""
    assert json.loads(json.dumps(report, allow_nan=False)) == report
    assert report["schema"] == "gap-report/1"
    assert report["verdict"] in ("effect", "several", "none", "unknown", "undetectable")
    assert report["rules"][0].startswith("claimed: ")
    assert "--advise" in report["next_experiment_note"]
    assert isinstance(report["next_experiment"], Mapping)
    assert any("straight lines" in s for s in report["assumed"])
    assert all(isinstance(group, list) for group in report["indistinguishable"])
    assert set(report["cost"]) == {"seconds", "simulations", "fe_solves"}
    assert report["cost"]["simulations"] > 0


def test_gaps_are_told_in_all_and_part_by_part(report: dict) -> None:
    gap = report["gap"]
    assert set(gap) == {"before", "after", "noise_floor", "by"}
    assert {"channel", "phase", "level", "direction", "repeat"} <= set(gap["by"])
    for values in gap["by"].values():
        assert all(set(v) == {"before", "after"} for v in values.values())
    assert all(set(w) == {"stage", "probability"} for w in report["where"])


def test_every_cause_has_its_class_its_parameters_and_its_probability(report: dict) -> None:
    for cause in report["causes"]:
        assert set(cause) >= {"effects", "class", "probability", "parameters", "detectability", "tolerated", "shrink"}
        assert 0 <= cause["probability"] <= 1
        assert not cause["tolerated"]
        assert all(set(p) == {"value", "se", "unit"} for p in cause["parameters"].values())
        assert "fitted" in cause["shrink"]
        assert set(cause["effects"]) <= {n for name in cause["class"] for n in name.split(" + ")}
    named = sum(c["probability"] for c in report["causes"])
    assert named + report["none_probability"] + report["outside_probability"] == pytest.approx(1.0, abs=1e-3)
    assert report["set"][: len(report["causes"][0]["class"])] == report["causes"][0]["class"]


def test_the_simulation_s_own_parameters_have_errors_and_units(report: dict) -> None:
    assert report["model"]["gain"]["unit"] == "1"
    assert report["model"]["gain"]["value"] == pytest.approx(2.0, rel=0.05)
    assert 0 < report["model"]["gain"]["se"] < 0.1


def test_three_sentences_say_how_far_what_and_how_sure(report: dict) -> None:
    assert len(report["sentences"]) == 3
    first, second, _ = report["sentences"]
    assert re.search(r"The simulation is [\d.]+ times the noise off", first)
    assert re.search(r"tau 0\.(49|5)", second)
    assert re.search(r"explains \d+ % of it", second)


class Seen(HTMLParser):
    """Words, headings and sources of a page."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.links: list[str] = []
        self.words = ""
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.links += [v or "" for k, v in attrs if k in ("src", "href")]

    def handle_data(self, data: str) -> None:
        self.words += data


def test_the_first_picture_shows_a_channel_that_the_effect_changes(linear) -> None:
    """A store's page began with a height of skin of another law, where nominal and effect are one line."""

    def fits(**residuals: float) -> SimpleNamespace:
        return SimpleNamespace(fits={b: SimpleNamespace(residual=np.full(50, r)) for b, r in residuals.items()})

    problems = {name: linear(np.zeros(50), np.ones((50, 1)), {}) for name in ("pressure", "height")}
    d = SimpleNamespace(problems=problems, null=fits(pressure=2.0, height=5.0), best=fits(pressure=1.0, height=5.0))
    assert most_telling(d, "with the effect") == ("pressure", 0, 0)
    assert most_telling(d, "") == ("height", 0, 0)


def test_the_page_is_self_contained_and_says_the_sentences_first(slow_valve: Diagnosis, report: dict) -> None:
    seen = Seen(page(slow_valve))
    assert all(link.startswith(("data:image/png;base64,", "#")) for link in seen.links)
    assert seen.tags.count("img") >= 2
    assert "script" not in seen.tags
    at = [seen.words.index(s) for s in report["sentences"]]
    assert at == sorted(at)
    assert at[-1] < seen.words.index("What could cause it")
    assert "{{" not in seen.words
    assert "nan" not in seen.words.split()
    assert not re.search(r"\b(skin|tissue)\b", seen.words)  # there is none in a valve


def test_the_page_says_which_cause_is_within_a_tolerance(slow_valve: Diagnosis) -> None:
    found = slow_valve.verdict.posterior
    first = replace(found.causes[0], tolerated=True)
    within = replace(slow_valve.verdict, posterior=replace(found, causes=(first, *found.causes[1:])))
    said = "within its stated tolerance: no finding"
    assert said in page(replace(slow_valve, verdict=within))
    assert said not in page(slow_valve)


def test_names_from_a_recording_cannot_bring_markup_into_the_page(recording) -> None:
    from dataclasses import replace

    made = runs(recording, lambda time, opening: opening)
    made = [replace(r, info=replace(r.info, subject="<script>alert(1)</script>")) for r in made]
    text = page(diagnose(made, Valve()))
    assert "<script" not in text
    assert "&lt;script" in text


def test_a_sound_rig_is_not_accused(recording) -> None:
    result = as_json(diagnose(runs(recording, lambda time, opening: opening), Valve()))
    assert result["verdict"] in ("none", "undetectable")
    assert result["gap"]["before"] == pytest.approx(1.0, abs=0.1)
    assert result["undetectable_below"]  # how strong each effect could still be


def test_what_no_effect_of_the_library_does_is_not_named_with_certainty(recording) -> None:
    def strange(time: np.ndarray, opening: np.ndarray) -> np.ndarray:
        return opening + 0.2 * np.sign(np.sin(2 * np.pi * 1.7 * time)) * (opening > 0.3)

    result = as_json(diagnose(runs(recording, strange), Valve()))
    assert result["verdict"] == "unknown"
    assert result["unknown_probability"] > 0.5
    assert "Nothing in the library explains it" in result["sentences"][1]


@pytest.mark.parametrize(
    ("value", "unit", "se", "written"),
    [
        (12e3, "Pa", 4e3, "120 ± 40 mbar"),
        (1318.4, "1", None, "1320"),
        (0.3104, "s", 0.0213, "0.31 ± 0.02 s"),
        (9.82e-5, "m", None, "98.2 µm"),
    ],
)
def test_numbers_are_written_as_people_do(value: float, unit: str, se: float | None, written: str) -> None:
    assert quantity(value, unit, se) == written
