"""The posterior on small linear problems: classes, who leads one, marks as evidence, one simplex."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import expit

from gap.data.signatures import Signature
from gap.data.tolerances import Tolerance
from gap.decision.findings import Findings
from gap.decision.gaps import Shrink
from gap.decision.limits import bounds, confusable
from gap.decision.marks import explains_marks, made_by
from gap.decision.posterior import posterior
from gap.decision.thresholds import INSTRUMENT
from gap.decision.transfer import best_elsewhere, plain
from gap.decision.verdict import quiet
from gap.inference.evidence import Hypothesis
from gap.inference.hypothesis import to_unit
from gap.inference.least_squares import fit
from gap.search.compare import Comparison, Effort, compare
from sim_devices.chain import Parameter
from tests.gap.decision.waves import DESIGN, SHAPES, T, judge, total, weak_wave


def test_effects_with_equal_traces_are_one_class(verdict_on) -> None:
    v = verdict_on(("bump", "late", "twin"), {"bump": 8.0})
    assert v.verdict == "effect"
    assert set(v.causes[0].names) == {"bump", "twin"}
    assert v.causes[0].probability > 0.8  # together: never a coin toss between them


def test_forms_of_one_concept_share_its_prior(verdict_on) -> None:
    v = verdict_on(("bump[form=0]", "bump[form=1]", "late"), {"bump": 8.0})
    assert v.causes[0].names == ("bump",)
    assert v.causes[0].probability > 0.8


def test_probabilities_are_one_simplex_and_do_not_contradict_the_verdict(verdict_on) -> None:
    strange = 8.0 * np.sign(np.sin(23 * T))
    cases = [
        verdict_on(("bump", "late"), {}),
        verdict_on(("bump", "late"), {"bump": 0.7}),
        verdict_on(("bump", "late", "twin"), {"bump": 8.0}),
        verdict_on(("bump", "late"), {}, extra=strange),
        verdict_on(("bump", "late"), {"bump": 6.0}, extra=strange),
    ]
    for v in cases:
        assert total(v) == pytest.approx(1.0)
        if v.verdict == "unknown":
            assert v.posterior.outside > 0.5
            assert v.posterior.none < 0.5
    assert {v.verdict for v in cases} >= {"effect", "unknown"}


def test_nothing_is_sure_of_none_beside_a_large_gap(linear, candidate) -> None:
    """Skin of another law may leave a gap of 11 and no effect: that is outside the library, not nothing."""
    comparison, known = weak_wave(linear, candidate, 0.0)
    near, far = (posterior(comparison, known, INSTRUMENT, gap=gap) for gap in (1.0, 11.0))
    assert near.none > 0.9
    assert far.none < 0.01
    assert far.outside > 0.9


def test_a_mark_is_no_verdict_where_it_explains_nothing(verdict_on) -> None:
    marks = (Signature("late", "height", 30.0, "late's mark"),)
    silent = verdict_on(("bump", "late"), {}, marks=marks)
    assert silent.verdict in ("none", "undetectable")
    assert silent.causes[0].probability < 0.5
    assert verdict_on(("bump", "late"), {"bump": 8.0}, marks=marks).causes[0].names == ("bump",)


def test_a_mark_must_explain_what_stands_out_where_it_is() -> None:
    assert explains_marks(Shrink(9.0, 2.0), INSTRUMENT)
    assert not explains_marks(Shrink(9.0, 8.9), INSTRUMENT)
    assert not explains_marks(Shrink(1.05, 0.2), INSTRUMENT)  # nothing stands out there
    assert not explains_marks(None, INSTRUMENT)


def test_a_mark_helps_what_it_explains(verdict_on) -> None:
    faint = {"late": 1.3}
    marks = (Signature("late", "height", 30.0, "late's mark"),)
    alone, marked = (
        verdict_on(("bump", "late"), faint, seed=2),
        verdict_on(("bump", "late"), faint, marks=marks, seed=2),
    )
    assert alone.verdict not in ("effect", "several")
    assert marked.verdict == "effect"


def test_a_signature_decides_between_equals(verdict_on) -> None:
    marks = (Signature("twin", "height", 30.0, "twin's mark"),)
    v = verdict_on(("bump", "late", "twin"), {"bump": 8.0}, marks=marks)
    assert v.causes[0].names[0] == "twin"


def test_a_defect_of_the_noise_is_told_by_its_marks_alone(verdict_on) -> None:
    """A gap is told in units of the noise: steps that make most of it leave none."""
    mark = Signature("late", "height", 30.0, "late's mark", noise=1.6)
    told = verdict_on(("bump", "late"), {}, marks=(mark,))
    assert (told.verdict, told.causes[0].names) == ("effect", ("late",))
    assert told.rules[0].startswith("told by its noise: ")
    assert total(told) == pytest.approx(1.0)
    assert verdict_on(("bump", "late"), {}, marks=(replace(mark, noise=1.05),)).verdict in ("none", "undetectable")
    beside = verdict_on(("bump", "late"), {"bump": 9.0}, marks=(mark,))  # whatever else acts
    assert beside.causes[0].names == ("late",)


def test_effects_that_leave_one_mark_are_one_class(linear, candidate) -> None:
    """Old values under new stamps are late samples or repeated ones: .91 was said for the wrong one of the two."""

    def bump(middle: float) -> np.ndarray:
        return np.exp(-(((T - middle) / 0.05) ** 2))

    y = DESIGN @ [2.0, 1.0] + 40.0 * bump(0.302) + np.random.default_rng(1).normal(size=len(T))
    effects = {"late": lambda v: v["a"] * bump(0.297), "lost": lambda v: v["a"] * bump(0.308)}
    known = [candidate(n, Parameter("a", "1", -90.0, 90.0)) for n in effects]
    found = compare([linear(y, DESIGN, effects, np.full(2, 100.0))], known, Effort(pair_bases=0))
    mark = Signature("lost", "height", 8.0, "repeats", also=("late",))
    alone, marked = judge(found, known).causes[0], judge(found, known, INSTRUMENT, (mark,)).causes[0]
    assert len(alone.names) == 1
    assert set(marked.names) == {"late", "lost"}


def test_a_prior_for_no_effect_wins_on_weak_evidence(verdict_on) -> None:
    doubtful = {"bump": 0.9}
    sure_of_none = replace(INSTRUMENT, prior_effect=1e-6, prior_pair=1e-9)
    assert verdict_on(("bump", "late"), doubtful, sure_of_none).verdict in ("none", "undetectable")


def test_whose_mark_a_signature_is(candidate) -> None:
    mark = Signature("saturation", "level", 30.0, "")
    assert made_by(mark, candidate("sensor_saturation"))
    assert made_by(mark, candidate("saturation"))
    assert not made_by(mark, candidate("drift"))


@pytest.mark.parametrize(("rules", "leader"), [(replace(INSTRUMENT, lead=3.0), "bump"), (INSTRUMENT, "rich")])
def test_the_simplest_leads_its_class_unless_it_is_much_worse(linear, candidate, rules, leader: str) -> None:
    aside = SHAPES["late"] / np.linalg.norm(SHAPES["late"])
    made = {
        "bump": lambda v: v["a"] * SHAPES["bump"],
        "rich": lambda v: v["a"] * SHAPES["bump"] + v["b"] * aside,
    }
    noise = np.random.default_rng(3).normal(size=len(T))
    noise -= (noise @ aside) * aside
    y = DESIGN @ [2.0, 1.0] + 8.0 * SHAPES["bump"] + 2.9 * aside + noise
    known = [
        candidate("bump", Parameter("a", "1", -30.0, 30.0)),
        candidate("rich", Parameter("a", "1", -30.0, 30.0), Parameter("b", "1", -4.0, 4.0)),
    ]
    verdict = judge(compare([linear(y, DESIGN, made, np.full(2, 100.0))], known), known, rules)
    assert verdict.causes[0].names[0] == leader
    assert set(verdict.causes[0].names) == {"bump", "rich"}


@pytest.mark.parametrize(("times", "named"), [(0.7, False), (1.4, True)])
def test_a_bound_is_the_strength_that_would_be_named(linear, candidate, times: float, named: bool) -> None:
    """It was told for 3 sigma where claims need five: eleven effects above their bounds went unseen."""
    known = [candidate("wave", Parameter("a", "1", -60.0, 60.0, 0.0))]
    noise = np.random.default_rng(7).normal(size=len(T))

    def compared(strength: float) -> Comparison:
        y = DESIGN @ [2.0, 1.0] + strength * SHAPES["wave"] + noise
        return compare([linear(y, DESIGN, {"wave": lambda v: v["a"] * SHAPES["wave"]}, np.full(2, 100.0))], known)

    quiet = compared(0.0)
    bound = bounds(quiet, quiet.temper(), INSTRUMENT)["wave"]
    assert judge(compared(times * bound), known).claims == named
    stated = {"wave": {"a": Tolerance(10.0 * bound, "1", "test")}}  # within twice a tolerance it is no finding
    assert bounds(quiet, quiet.temper(), INSTRUMENT, stated)["wave"] == pytest.approx(20.0 * bound)


def test_what_cannot_be_told_apart_is_so_in_its_best_form(linear, candidate) -> None:
    """A leak of one form is a gain, but not the leak that these data show."""
    made = {
        "leak[form=0]": lambda v: v["a"] * SHAPES["bump"],
        "leak[form=1]": lambda v: v["a"] * SHAPES["wave"],
        "gain": lambda v: 2.0 * v["a"] * SHAPES["wave"],
        "drag": lambda v: 3.0 * v["a"] * SHAPES["bump"],
    }
    known = [candidate(name, Parameter("a", "1", -30.0, 30.0)) for name in made]
    noise = np.random.default_rng(4).normal(size=len(T))
    y = DESIGN @ [2.0, 1.0] + 8.0 * SHAPES["bump"] + 0.5 * SHAPES["wave"] + noise
    comparison = compare([linear(y, DESIGN, made, np.full(2, 100.0))], known, suspects=known)
    assert {h.name for h in comparison.hypotheses} >= set(made)
    assert confusable(comparison, comparison.temper()) == (("drag", "leak"),)


def test_a_model_with_one_effect_more_is_never_above_the_simulation_by_itself(linear, candidate) -> None:
    """A fit that stopped in a dead end: the plain refit starts from the plain null as well."""
    y = DESIGN @ [2.0, 1.0] + np.random.default_rng(5).normal(size=len(T))
    problem = linear(y, DESIGN, {"wave": lambda v: v["a"] * SHAPES["wave"]}, np.full(2, 100.0))
    known = candidate("wave", Parameter("a", "1", 0.0, 60.0, 0.0))
    null = Hypothesis((), {"linear": fit(problem)})
    lost = fit(problem, (known,), np.array([0.9]), iterations=0)
    problem.sd_without_discrepancy = problem.prior_sd * 0.999
    answer = plain({"linear": problem}, Hypothesis((known,), {"linear": lost}), null)
    assert answer.fits["linear"].objective <= null.fits["linear"].objective + 0.02
    problem.sd_without_discrepancy = problem.prior_sd
    answer = plain({"linear": problem}, Hypothesis((known,), {"linear": lost}), null)
    assert answer.fits["linear"].objective <= null.fits["linear"].objective + 0.02


def test_the_member_that_meets_another_waveform_best_leads_its_class(linear, candidate) -> None:
    good, bad = {"waveform": Shrink(2.0, 1.2), "repeat": Shrink(2.0, 1.3)}, {"waveform": Shrink(2.0, 2.6)}
    assert best_elsewhere([bad, good], 0.02) == 1
    assert best_elsewhere([good, bad], 0.02) == 0
    assert best_elsewhere([good, {"waveform": Shrink(2.0, 1.19)}], 0.02) == 0  # no better than refits differ
    assert best_elsewhere([{}, {}], 0.02) == 0
    made = {"bump": lambda v: v["a"] * SHAPES["bump"], "twin": lambda v: v["a"] * SHAPES["twin"]}
    y = DESIGN @ [2.0, 1.0] + 8.0 * SHAPES["bump"] + np.random.default_rng(3).normal(size=len(T))
    known = [candidate(name, Parameter("a", "1", -30.0, 30.0)) for name in made]
    found = posterior(compare([linear(y, DESIGN, made, np.full(2, 100.0))], known), known, INSTRUMENT)
    second = next(h for h in found.causes[0].members if h is not found.causes[0].hypothesis)
    assert found.led_by(second).causes[0].names == found.causes[0].names[::-1]


@pytest.mark.parametrize(("apart", "effects"), [(0.5, 1), (20.0, 2)])
def test_two_events_at_once_are_one_of_another_form(linear, candidate, apart: float, effects: int) -> None:
    """Tone that came within seconds was claimed as a jump of the height and a loss of samples 0.2 s apart."""
    time = np.linspace(0.0, 60.0, 600)
    laws = {name: (lambda v, width=width: v["a"] * expit((time - v["moment"]) / width))
            for name, width in (("jump", 0.02), ("rise", 2.0))}  # fmt: skip
    own = (Parameter("a", "1", -30.0, 30.0, 0.0), Parameter("moment", "s", 0.0, 60.0))
    jump, rise = (replace(candidate(name, *own), event=True) for name in laws)
    true = [{"a": 8.0, "moment": 20.0}, {"a": 8.0, "moment": 20.0 + apart}]
    noise = np.random.default_rng(0).normal(size=len(time))
    made = laws["jump"](true[0]) + laws["rise"](true[1]) + noise
    problem = linear(made, np.ones((len(time), 1)), laws, np.full(1, 100.0))
    units = [np.array([to_unit(p, v[p.name]) for p in own]) for v in true]
    null = Hypothesis((), {"linear": fit(problem)})
    tried = [((jump,), units[0]), ((rise,), units[1]), ((jump, rise), np.concatenate(units))]
    comparison = Comparison(
        {"linear": problem}, null, [Hypothesis(h, {"linear": fit(problem, h, u)}) for h, u in tried]
    )
    assert len(posterior(comparison, [jump, rise], INSTRUMENT).causes[0].effects) == effects


@pytest.mark.parametrize(("later", "together"), [(0.2, True), (5.0, False)])
def test_one_event_in_other_words_is_one_class(linear, candidate, later: float, together: bool) -> None:
    """A tone that rose for 5 s was claimed as a leak of the rim, whose edges skin answers a little otherwise."""
    time = np.linspace(0.0, 60.0, 600)

    def spell(v, shape):
        inside = (time > v["moment"]) & (time < v["moment"] + v["duration"])
        return v["a"] * inside * (1.0 + shape * (time - v["moment"]))

    laws = {"tone": lambda v: spell(v, 0.0), "leak": lambda v: spell(v, 0.13)}
    own = (
        Parameter("a", "1", -30.0, 30.0, 0.0),
        Parameter("moment", "s", 0.0, 60.0),
        Parameter("duration", "s", 0.0, 60.0),
    )
    tone, leak = (replace(candidate(name, *own), event=True) for name in laws)
    true = {"a": 8.0, "moment": 20.0, "duration": 5.0}
    problem = linear(
        laws["tone"](true) + np.random.default_rng(0).normal(size=len(time)),
        np.ones((len(time), 1)),
        laws,
        np.full(1, 100.0),
    )
    null = Hypothesis((), {"linear": fit(problem)})
    told = [(tone, true), (leak, {**true, "moment": 20.0 + later, "a": 6.0})]
    units = [np.array([to_unit(p, v[p.name]) for p in own]) for _, v in told]
    fits = [fit(problem, (e,), u, iterations=0) for (e, _), u in zip(told, units, strict=True)]
    comparison = Comparison(
        {"linear": problem}, null, [Hypothesis((e,), {"linear": f}) for (e, _), f in zip(told, fits, strict=True)]
    )
    close = replace(INSTRUMENT, evidence_tie=1e6)
    assert (len(posterior(comparison, [tone, leak], close).causes[0].names) == 2) == together
    by_edges = replace(INSTRUMENT, evidence_tie=0.0, mark=0.0, edges_share=0.5)
    assert (len(posterior(comparison, [tone, leak], by_edges).causes[0].names) == 2) == together


@pytest.mark.parametrize(("skin_knows", "together"), [(False, True), (True, False)])
def test_skin_of_an_inexact_law_does_not_split_what_the_pressure_cannot(
    linear, candidate, skin_knows: bool, together: bool
) -> None:
    """A gauge of two slopes (3.7 %) was claimed as a leak (.92) by 6 nats of a skin whose law left 95 (seed 510010)."""
    rng = np.random.default_rng(0)
    gauge = {n: (lambda v: v["a"] * SHAPES["bump"]) for n in ("leak", "gauge_gain")}
    skin = {"leak": lambda v: 0.0 * T, "gauge_gain": lambda v: 0.1 * v["a"] * SHAPES["late"]}
    known = [
        replace(candidate(n, Parameter("a", "1", -30.0, 30.0, 0.0)), blocks=("linear", "skin"))
        for n in ("leak", "gauge_gain")
    ]
    blocks = []
    for name, made, size in (("linear", gauge, 9.0), ("skin", skin, 0.0)):
        y = DESIGN @ [2.0, 1.0] + size * SHAPES["bump"] + rng.normal(size=len(T))
        blocks.append(linear(y, DESIGN, made, np.full(2, 100.0)))
        blocks[-1].name = name
    blocks[0].sound, blocks[1].sound = np.zeros(2), np.zeros(2) if skin_knows else None
    rules = replace(INSTRUMENT, evidence_tie=0.0)
    causes = posterior(compare(blocks, known), known, rules).causes
    assert causes[0].names[0] == "leak"
    assert ("gauge_gain" in causes[0].names) == together


@pytest.mark.parametrize(("tolerance", "effects"), [(5.0, 1), (0.1, 2)])
def test_a_second_effect_within_its_tolerance_is_none(linear, candidate, tolerance: float, effects: int) -> None:
    """A lag of 1 ms, of which 10 are stated, moved lost samples out of their tolerance (seed 410004, a sound case)."""
    y = DESIGN @ [2.0, 1.0] + 9.0 * SHAPES["bump"] + 8.0 * SHAPES["late"] + np.random.default_rng(0).normal(size=len(T))
    names = ("bump", "late")
    made = {n: (lambda v, n=n: v["a"] * SHAPES[n]) for n in names}
    known = [candidate(n, Parameter("a", "1", -30.0, 30.0, 0.0)) for n in names]
    comparison = compare([linear(y, DESIGN, made, np.full(2, 100.0))], known)
    stated = {"late": {"a": Tolerance(tolerance, "1", "assumed")}}
    assert len(posterior(comparison, known, INSTRUMENT, stated=stated).causes[0].effects) == effects


@pytest.mark.parametrize("extended", [False, True])
def test_an_effect_and_its_limit_are_one_class(linear, candidate, extended: bool) -> None:
    """Dry friction was told friction that falls with speed, by 3.8 nats that a coarse simulation is worth."""
    noise = np.random.default_rng(0).normal(size=len(T))
    y = DESIGN @ [2.0, 1.0] + 8.0 * SHAPES["bump"] + 0.8 * SHAPES["late"] + noise
    changes = {
        "plain": lambda v: v["a"] * SHAPES["bump"],
        "general": lambda v: v["a"] * (SHAPES["bump"] + 0.1 * SHAPES["late"]),
    }
    known = [candidate(name, Parameter("a", "1", -30.0, 30.0)) for name in changes]
    known[1] = replace(known[1], extends=("plain",) if extended else ())
    comparison = compare([linear(y, DESIGN, changes, np.full(2, 100.0))], known)
    found = posterior(comparison, known, replace(INSTRUMENT, separable=0.0, odds=1.0), ())
    assert (set(found.causes[0].names) == set(changes)) == extended


@pytest.mark.parametrize(("least", "leader"), [(6.0, "lag"), (0.1, "resonance")])
def test_an_effect_at_the_end_of_its_strength_is_less_probable(linear, candidate, least: float, leader: str) -> None:
    """A hose of .13 s was told a resonance of the least overshoot that is tried (seed 410005)."""
    noise = np.random.default_rng(0).normal(size=len(T))
    y = DESIGN @ [2.0, 1.0] + 6.0 * SHAPES["bump"] + 0.4 * SHAPES["late"] + noise
    changes = {
        "resonance": lambda v: v["a"] * (SHAPES["bump"] + 0.1 * SHAPES["late"]),
        "lag": lambda v: v["a"] * (SHAPES["bump"] - 0.1 * SHAPES["late"]),
    }
    known = [candidate(n, Parameter("a", "1", 0.1, 60.0, 0.0, 1.0, "log")) for n in changes]
    known[0] = candidate("resonance", Parameter("a", "1", least, 60.0, 0.0, 10.0, "log"))
    comparison = compare([linear(y, DESIGN, changes, np.full(2, 100.0))], known)
    assert {h.effects[0].name for h in comparison.hypotheses if len(h.effects) == 1} == set(changes)
    assert posterior(comparison, known, INSTRUMENT).causes[0].names[0] == leader
    assert posterior(comparison, known, replace(INSTRUMENT, at_bound=0.0)).causes[0].names[0] == "resonance"


@pytest.mark.parametrize(("sigma", "skin", "effects"), [(1.0, False, 2), (0.8, False, 1), (1.0, True, 1)])
def test_a_second_effect_must_act_above_the_noise(linear, candidate, sigma: float, skin: bool, effects: int) -> None:
    """A clock that wanders by 2 ms was claimed beside a change of tone, in a pressure at .9 of its noise's variance
    (seed 410005); a support that slips beside a wrong zero, in a force on skin that left 1.04 of it (670120)."""
    rng = np.random.default_rng(0)
    y = DESIGN @ [2.0, 1.0] + 9.0 * SHAPES["bump"] + rng.normal(size=len(T))
    other = sigma * (0.8 * SHAPES["wave"] + rng.normal(size=len(T)))
    shapes = {n: (lambda v, n=n: v["a"] * SHAPES[n]) for n in ("bump", "wave")}
    height = linear(y, DESIGN, shapes, np.full(2, 100.0))
    pressure = linear(other, DESIGN, shapes, np.full(2, 100.0), name="pressure")
    pressure.sound = None if skin else np.zeros(2)
    a = Parameter("a", "1", -30.0, 30.0, 0.0)
    known = [candidate("bump", a), candidate("wave", a, block="pressure")]
    comparison = compare([height, pressure], known)
    likely = replace(INSTRUMENT, prior_pair=0.5, second_least=0.0, second_share=0.0)
    assert len(posterior(comparison, known, likely).causes[0].effects) == effects


def test_two_effects_earn_nothing_where_one_of_a_little_other_form_explains_more(linear, candidate) -> None:
    """The play of a valve's stem, which a little preconditioning repaired, was told hysteresis and preconditioning."""
    rng = np.random.default_rng(0)
    y = DESIGN @ [2.0, 1.0] + 60.0 * SHAPES["bump"] + 1.5 * SHAPES["wave"] + rng.normal(size=len(T))
    changes = {
        "play": lambda v: v["a"] * SHAPES["bump"],
        "repair": lambda v: v["a"] * SHAPES["wave"],
        "hysteresis": lambda v: v["a"] * (SHAPES["bump"] + 0.3 * SHAPES["late"]),
        "fading": lambda v: v["a"] * (SHAPES["late"] - 0.06 * SHAPES["wave"]),
    }
    known = [candidate(n, Parameter("a", "1", -90.0, 90.0, 0.0)) for n in changes]
    comparison = compare([linear(y, DESIGN, changes, np.full(2, 100.0))], known)
    assert {"play + repair", "hysteresis + fading"} <= {h.name for h in comparison.hypotheses}
    assert posterior(comparison, known, INSTRUMENT).causes[0].names == ("play",)


def test_no_certainty_of_none_beside_a_small_block_that_nothing_explains(linear, candidate) -> None:
    """A reference of few rows that is left unexplained is lost in the gap of all rows."""
    comparison, known = weak_wave(linear, candidate, 0.0)
    (_, fit_of_null), *_ = comparison.null.fits.items()
    rows = 30
    for size, said in ((1.0, "none"), (1.7, "undetectable")):
        left = size * np.sign(np.sin(np.arange(rows)))
        small = replace(
            fit_of_null, residual=left, chi2=float(left @ left), jacobian=fit_of_null.jacobian[:rows],
            effect_jacobian=fit_of_null.effect_jacobian[:rows],
        )  # fmt: skip
        beside = [replace(h, fits={**h.fits, "reference": small}) for h in (comparison.null, *comparison.hypotheses)]
        found = posterior(replace(comparison, null=beside[0], hypotheses=beside[1:]), known, INSTRUMENT)
        assert found.gap_before < INSTRUMENT.quiet_gap
        assert quiet(Findings(found, INSTRUMENT)) == said
    assert found.foreign > 0.15
