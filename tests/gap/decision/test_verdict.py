"""The posterior and the verdict on small linear problems: which effect, which class, one or two, or none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gap.data.signatures import HUM, Signature
from gap.data.tolerances import Tolerance, tolerances
from gap.decision.limits import confusable
from gap.decision.marks import explains_marks, made_by
from gap.decision.posterior import posterior
from gap.decision.settle import Case, settle
from gap.decision.thresholds import INSTRUMENT, RIG, Thresholds, provenance
from gap.decision.tolerance import Stated, in_tolerances
from gap.decision.transfer import Shrink, best_elsewhere, plain
from gap.decision.verdict import RULES, Findings, Verdict, decide, weakest, without_skin
from gap.inference.evidence import Hypothesis
from gap.inference.least_squares import fit
from gap.search.compare import Comparison, compare
from sim_devices.chain import Parameter

T = np.linspace(0.0, 1.0, 400)
SHAPES = {
    "bump": np.exp(-(((T - 0.3) / 0.05) ** 2)),
    "late": np.exp(-(((T - 0.7) / 0.05) ** 2)),
    "wave": np.sin(40 * T),
    "twin": np.exp(-(((T - 0.3) / 0.0502) ** 2)),
}
DESIGN = np.column_stack([np.ones_like(T), T])


@pytest.fixture
def verdict_on(linear, candidate):
    """``verdict_on(names, strengths)``: judge data made with ``strengths``, candidates ``names``."""

    def run(names, strengths, t=INSTRUMENT, marks=(), extra=0.0, seed=0) -> Verdict:
        noise = np.random.default_rng(seed).normal(size=len(T))
        y = DESIGN @ [2.0, 1.0] + sum((a * SHAPES[n] for n, a in strengths.items()), 0 * T) + noise + extra
        effects = {n: (lambda v, n=n: v["a"] * SHAPES[n.split("[")[0]]) for n in names}
        problem = linear(y, DESIGN, effects, np.full(2, 100.0))
        known = [candidate(n, Parameter("a", "1", -30.0, 30.0)) for n in names]
        return judge(compare([problem], known), known, t, marks)

    return run


def judge(comparison: Comparison, known, t: Thresholds = INSTRUMENT, marks=(), **tests) -> Verdict:
    """The verdict with all of a cause's ``tests`` passed but those given."""
    return decide(Findings(posterior(comparison, known, t, marks), t, **tests))


def total(v: Verdict) -> float:
    return v.posterior.none + sum(c.probability for c in v.causes) + v.posterior.outside


def test_the_effect_that_acts_is_named(verdict_on) -> None:
    v = verdict_on(("bump", "late", "wave"), {"bump": 8.0})
    assert v.verdict == "effect"
    assert v.causes[0].names == ("bump",)
    assert v.causes[0].probability > 0.8
    assert v.posterior.gap_before > v.posterior.gap_after
    assert v.posterior.gap_after == pytest.approx(1.0, abs=0.1)
    assert next(iter(v.posterior.stages)) == "actuator"
    assert sum(v.posterior.stages.values()) == pytest.approx(v.posterior.named)
    assert v.rules[0].startswith("claimed: posterior")


def test_nothing_is_found_where_nothing_is(verdict_on) -> None:
    for seed in range(5):
        v = verdict_on(("bump", "late", "wave"), {}, seed=seed)
        assert v.verdict in ("none", "undetectable")
        assert v.posterior.none > 0.5


def test_effects_with_equal_traces_are_one_class(verdict_on) -> None:
    v = verdict_on(("bump", "late", "twin"), {"bump": 8.0})
    assert v.verdict == "effect"
    assert set(v.causes[0].names) == {"bump", "twin"}
    assert v.causes[0].probability > 0.8  # together: never a coin toss between them


def test_forms_of_one_concept_share_its_prior(verdict_on) -> None:
    v = verdict_on(("bump[form=0]", "bump[form=1]", "late"), {"bump": 8.0})
    assert v.causes[0].names == ("bump",)
    assert v.causes[0].probability > 0.8


def test_two_effects_are_told_as_several(verdict_on) -> None:
    v = verdict_on(("bump", "late", "wave"), {"bump": 9.0, "wave": 4.0})
    assert v.verdict == "several"
    assert {e.name for e in v.causes[0].effects} == {"bump", "wave"}


def test_a_second_effect_must_earn_its_place(verdict_on) -> None:
    """What the first one's form error leaves is worth some χ² to any second one."""
    strange = 1.5 * np.sign(np.sin(23 * T))
    doubtful = verdict_on(("bump", "late"), {"bump": 15.0, "late": 1.2}, extra=strange)
    assert len(doubtful.causes[0].effects) == 1
    assert {e.name for e in doubtful.causes[1].effects} == {"bump", "late"}  # what to look for next, and no more
    assert doubtful.causes[1].probability < 0.05
    assert len(verdict_on(("bump", "late"), {"bump": 15.0, "late": 4.0}).causes[0].effects) == 2


@pytest.mark.parametrize(("tolerance", "said"), [(1.0, "effect"), (5.0, "undetectable")])
def test_what_cannot_be_told_from_a_tolerance_is_no_finding(linear, candidate, tolerance, said) -> None:
    y = DESIGN @ [2.0, 1.0] + 2.5 * SHAPES["bump"] + np.random.default_rng(0).normal(size=len(T))
    effects = {n: (lambda v, n=n: v["a"] * SHAPES[n]) for n in ("bump", "twin")}
    known = [candidate(n, Parameter("a", "1", -30.0, 30.0, null=0.0)) for n in effects]
    comparison = compare([linear(y, DESIGN, effects, np.full(2, 100.0))], known)
    for name in effects:  # whichever of the two leads
        stated = {name: {"a": Tolerance(tolerance, "1", "test")}}
        case = Case(comparison, known, (), plain(comparison.problems, comparison.null), {}, stated)
        assert settle(case, INSTRUMENT).verdict.verdict == said


def test_what_the_library_lacks_is_unknown_and_not_the_nearest_name(verdict_on) -> None:
    strange = 8.0 * np.sign(np.sin(23 * T))
    v = verdict_on(("bump", "late", "wave"), {}, extra=strange)
    assert v.verdict in ("unknown", "undetectable", "none")
    assert v.posterior.unexplained > 0.5


def test_a_hum_is_unknown_where_nothing_else_is_found(verdict_on) -> None:
    hum = Signature(HUM, "pressure", 30.0, "pressure has a line at 12.5 Hz")
    assert verdict_on(("bump", "late"), {}, marks=(hum,)).verdict == "unknown"
    assert verdict_on(("bump", "late"), {"bump": 8.0}, marks=(hum,)).verdict == "effect"


def taking(share: float) -> Shrink:
    """A gap of 2 of which ``share`` of what lies above the noise goes."""
    return Shrink(2.0, 2.0 - share)


def weak_wave(linear, candidate, strength: float, *more: Parameter, event: bool = False):
    """A comparison and its candidate, where a wave acts."""
    noise = np.random.default_rng(0).normal(size=len(T))
    y = DESIGN @ [2.0, 1.0] + strength * SHAPES["wave"] / 5 + noise
    problem = linear(y, DESIGN, {"wave": lambda v: v["a"] * SHAPES["wave"]}, np.full(2, 100.0))
    known = [replace(candidate("wave", Parameter("a", "1", -60.0, 60.0, 0.0), *more), event=event)]
    return compare([problem], known), known


@pytest.mark.parametrize(
    ("strength", "gap", "transfer", "said"),
    [
        (2.5, 2.0, 0.9, "effect"),
        (2.5, 2.0, 0.05, "unknown"),  # repairs what it was fitted to, and no more
        (2.5, 1.0, 0.05, "effect"),  # nothing is left to take away
        (2.5, 2.0, None, "effect"),  # one waveform only
        (30.0, 2.0, 0.05, "effect"),  # beyond what skin could leave
    ],
)
def test_a_device_effect_must_carry_over_where_skin_is_in_play(
    linear, candidate, strength: float, gap: float, transfer: float | None, said: str
) -> None:
    comparison, known = weak_wave(linear, candidate, strength)
    held_out = {} if transfer is None else {"waveform": taking(transfer)}
    fitted = Shrink(gap, 0.8 * gap)
    free = without_skin(posterior(comparison, known, INSTRUMENT).causes[0], comparison, comparison.temper())
    assert free == np.inf
    assert judge(comparison, known, fitted=fitted, held_out=held_out, without_skin=free).verdict == "effect"
    comparison.problems["linear"].open_law = True
    skin = without_skin(posterior(comparison, known, INSTRUMENT).causes[0], comparison, comparison.temper())
    assert skin == 0.0
    final = judge(comparison, known, fitted=fitted, held_out=held_out, without_skin=skin)
    assert final.verdict == said
    assert (final.causes[0].probability > 0.5) == (said == "effect")  # what is not named is not likelier than not
    assert total(final) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("split", "before", "after", "said"),
    [
        ("repeat", 2.0, 2.2, "effect"),
        ("repeat", 2.0, 2.4, "unknown"),
        ("repeat", 0.8, 1.1, "effect"),  # all noise
        ("waveform", 2.0, 2.1, "effect"),
        ("waveform", 2.0, 2.64, "unknown"),  # a shrink of -.64 was claimed with .93
    ],
)
def test_what_makes_withheld_recordings_worse_is_not_claimed(linear, candidate, split, before, after, said) -> None:
    comparison, known = weak_wave(linear, candidate, 2.5)
    verdict = judge(comparison, known, held_out={split: Shrink(before, after)})
    assert verdict.verdict == said
    assert verdict.rules[0].startswith("claimed" if said == "effect" else "worse")


def test_nothing_foretells_an_event_in_a_repeat(linear, candidate) -> None:
    comparison, known = weak_wave(linear, candidate, 4.0, event=True)
    assert judge(comparison, known, held_out={"repeat": Shrink(2.0, 4.0)}).verdict == "effect"


def test_patches_that_leave_a_gap_are_no_explanation(linear, candidate) -> None:
    comparison, known = weak_wave(linear, candidate, 4.0)
    found = posterior(comparison, known, INSTRUMENT, ())
    first = found.causes[0]
    for event, gap, rule in ((False, 3.0, "claimed"), (True, 1.5, "claimed"), (True, 3.0, "patched")):
        effects = tuple(replace(e, event=event) for e in 2 * first.effects)
        pair = replace(first, hypothesis=replace(first.hypothesis, effects=effects))
        patched = replace(found, causes=(pair,), gap_after=gap, unexplained=0.0)
        assert decide(Findings(patched, INSTRUMENT)).rules[0].startswith(rule)


@pytest.mark.parametrize(
    ("after", "elsewhere", "said"),
    [
        (0.93, (0.93, 0.93), "undetectable"),
        (0.93, (1.3, 1.1), "effect"),
        (0.85, (0.93, 0.9), "effect"),
        (0.93, None, "effect"),
    ],
)
def test_what_takes_little_away_must_help_elsewhere(linear, candidate, after, elsewhere, said) -> None:
    """Uneven counts were told a lag, which took .02 of a gap of .95 and nothing of a withheld waveform's."""
    comparison, known = weak_wave(linear, candidate, 2.5)
    held_out = {} if elsewhere is None else {"waveform": Shrink(*elsewhere)}
    assert judge(comparison, known, fitted=Shrink(0.95, after), held_out=held_out).verdict == said


@pytest.mark.parametrize(("effects", "left", "said"), [(1, 1.53, "effect"), (2, 1.53, "unknown"), (2, 1.1, "several")])
def test_a_pair_is_named_only_where_it_leaves_no_gap(linear, candidate, effects, left, said) -> None:
    """Preconditioning of another form was told drag and a change of tone, which left 1.53 of 2.60."""
    comparison, known = weak_wave(linear, candidate, 2.5)
    found = posterior(comparison, known, INSTRUMENT)
    first = found.causes[0]
    several = replace(first, hypothesis=replace(first.hypothesis, effects=effects * first.effects))
    findings = Findings(replace(found, causes=(several,)), INSTRUMENT, fitted=Shrink(2.6, left))
    assert decide(findings).verdict == said


def test_an_event_must_stand_out_further_since_it_may_begin_anywhere(linear, candidate) -> None:
    for event, said in ((False, "effect"), (True, "undetectable")):
        comparison, known = weak_wave(linear, candidate, 2.4, event=event)
        verdict = judge(comparison, known)
        assert INSTRUMENT.seen < verdict.causes[0].detectability < INSTRUMENT.seen_event
        assert verdict.verdict == said


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        (1.31, 1.30, "unknown"),
        (1.08, 1.08, "undetectable"),
        (1.08, 1.05, "effect"),
        (2.0, 1.9, "unknown"),
        (2.0, 1.2, "effect"),
    ],
)
def test_a_claim_lowers_the_gap_that_it_explains(linear, candidate, before, after, said) -> None:
    comparison, known = weak_wave(linear, candidate, 2.5)
    verdict = judge(comparison, known, fitted=Shrink(before, after))
    assert verdict.verdict == said
    assert said == "effect" or verdict.rules[0].startswith("takes nothing away")


def test_an_effect_within_twice_a_stated_tolerance_is_no_finding(linear, candidate) -> None:
    comparison, known = weak_wave(linear, candidate, 2.5)
    found = posterior(comparison, known, INSTRUMENT)
    h = found.causes[0].hypothesis
    size = abs(h.fits["linear"].active[h.effects[0]]["a"])

    def large(stated: Stated) -> tuple[float, float]:
        return in_tolerances(comparison.problems, comparison.null, [h], stated, found.temper)

    assert large({})[0] == np.inf
    assert large({"wave": {"a": Tolerance(size, "1", "test")}}) == pytest.approx((1.0, 0.0))
    jump = replace(h.effects[0], event=True)  # what happens at one moment is no tolerance
    jumping = Hypothesis((jump,), {"linear": replace(h.fits["linear"], hypothesis=(jump,))})
    stated = {"wave": {"a": Tolerance(size, "1", "test")}}
    assert in_tolerances(comparison.problems, comparison.null, [jumping], stated, found.temper)[0] == np.inf
    assert judge(comparison, known, tolerances=1.0).verdict == "undetectable"
    assert judge(comparison, known, tolerances=3.0).verdict == "effect"
    assert judge(comparison, known, tolerances=1.0, beyond=9.0).verdict == "effect"
    assert tolerances("cutometer")["gauge_gain"]["error"].value == 5e-3
    assert tolerances("some rig") == {}


def test_a_channel_may_be_a_little_bent_but_not_late(linear, candidate) -> None:
    """A function of the channel's own value is its scale's; a delay is not, however small."""
    line = 3.0 + 40.0 * T
    made = {"bend": lambda v: v["a"] * (T - 0.5) ** 2, "wave": lambda v: v["a"] * SHAPES["wave"]}
    stated = {"channels": {"-": Tolerance(1.0, "1", "test")}}
    for name, strength, small in (("bend", 4.0, True), ("bend", 40.0, False), ("wave", 0.9, False)):
        y = line + made[name]({"a": strength}) + 0.1 * np.random.default_rng(0).normal(size=len(T))
        problem = linear(y, DESIGN, made, np.full(2, 100.0))
        known = [candidate(name, Parameter("a", "1", -60.0, 60.0, 0.0))]
        comparison = compare([problem], known)
        h = comparison.hypotheses[0]
        times, beyond = in_tolerances(comparison.problems, comparison.null, [h], stated, {"linear": 0.01})
        assert (times <= INSTRUMENT.tolerances and beyond < INSTRUMENT.seen) == small, (name, strength)


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


def test_every_threshold_has_a_unit_a_meaning_and_a_source() -> None:
    for name, entry in provenance().items():
        assert hasattr(INSTRUMENT, name)
        assert all(str(entry[k]) for k in ("value", "unit", "meaning", "source")), name


def test_every_rule_has_a_name_of_its_own_and_the_last_always_holds() -> None:
    assert len({r.name for r in RULES}) == len(RULES)
    assert RULES[-1].name == "claimed"


def test_a_signature_decides_between_equals(verdict_on) -> None:
    marks = (Signature("twin", "height", 30.0, "twin's mark"),)
    v = verdict_on(("bump", "late", "twin"), {"bump": 8.0}, marks=marks)
    assert v.causes[0].names[0] == "twin"


def test_a_prior_for_no_effect_wins_on_weak_evidence(verdict_on) -> None:
    doubtful = {"bump": 0.9}
    sure_of_none = replace(INSTRUMENT, prior_effect=1e-6, prior_pair=1e-9)
    assert verdict_on(("bump", "late"), doubtful, sure_of_none).verdict in ("none", "undetectable")


def test_whose_mark_a_signature_is(candidate) -> None:
    mark = Signature("saturation", "level", 30.0, "")
    assert made_by(mark, candidate("sensor_saturation"))
    assert made_by(mark, candidate("saturation"))
    assert not made_by(mark, candidate("drift"))


def test_what_is_as_weak_as_may_be_must_help_somewhere(linear, candidate) -> None:
    noise = np.random.default_rng(0).normal(size=len(T))
    y = DESIGN @ [2.0, 1.0] + 1.01 * SHAPES["wave"] + noise
    weak = Parameter("a", "1", 1.0, 100.0, null=0.0, default=10.0, scale="log")
    problem = linear(y, DESIGN, {"wave": lambda v: v["a"] * SHAPES["wave"]}, np.full(2, 100.0))
    known = [candidate("wave", weak)]
    comparison = compare([problem], known)
    verdict = judge(comparison, known, held_out={"level": taking(0.4)})
    assert verdict.verdict == "effect"
    assert weakest(verdict.causes[0].hypothesis, INSTRUMENT.weakest)
    for held_out in ({"level": taking(-3.0)}, {"level": taking(0.002)}, {}):
        assert judge(comparison, known, held_out=held_out).verdict == "undetectable"


def test_a_second_effect_must_explain_more_than_some_pair_always_does(linear, candidate) -> None:
    noise = np.random.default_rng(0).normal(size=len(T))
    y = DESIGN @ [2.0, 1.0] + 3.0 * SHAPES["bump"] + 0.6 * SHAPES["wave"] + noise
    effects = {n: (lambda v, n=n: v["a"] * SHAPES[n]) for n in ("bump", "wave")}
    problem = linear(y, DESIGN, effects, np.full(2, 100.0))
    known = [candidate(n, Parameter("a", "1", -9.0, 9.0)) for n in effects]
    comparison = compare([problem], known)
    assert any(len(h.effects) == 2 for h in comparison.hypotheses)
    likely = replace(INSTRUMENT, prior_pair=0.5, second_least=0.0)
    assert judge(comparison, known, likely).verdict == "several"
    assert judge(comparison, known, replace(likely, second_least=1e4)).verdict == "effect"


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
    problem.plain_sd = problem.prior_sd * 0.999
    answer = plain({"linear": problem}, Hypothesis((known,), {"linear": lost}), null)
    assert answer.fits["linear"].objective <= null.fits["linear"].objective + 0.02
    problem.plain_sd = problem.prior_sd
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


def _named(linear, candidate) -> Comparison:
    y = DESIGN @ [2.0, 1.0] + 8.0 * SHAPES["bump"] + np.random.default_rng(0).normal(size=len(T))
    problem = linear(y, DESIGN, {n: (lambda v, n=n: v["a"] * SHAPES[n]) for n in ("bump", "late")}, np.full(2, 100.0))
    return compare([problem], [candidate(n, Parameter("a", "1", -30.0, 30.0)) for n in ("bump", "late")])


def test_a_claim_on_a_rig_carries_over_and_no_rival_does_better(linear, candidate) -> None:
    comparison = _named(linear, candidate)
    known = [h.effects[0] for h in comparison.hypotheses]
    fitted, good, poor = Shrink(5.0, 1.2), Shrink(5.0, 1.4), Shrink(5.0, 4.5)

    def said(held_out: Shrink, rival: Shrink | None = None, t: Thresholds = RIG) -> str:
        others = {"rival": {"waveform": rival}} if rival else {}
        v = judge(comparison, known, t, fitted=fitted, held_out={"waveform": held_out}, **others)
        return v.rules[0].split(":")[0]

    assert said(good) == "claimed"
    assert said(poor) == "stays behind"
    assert said(good, rival=Shrink(5.0, 1.38)) == "claimed"
    assert said(good, rival=Shrink(5.0, 1.1)) == "outdone by a rival"
    assert said(good, rival=Shrink(5.0, 1.1), t=INSTRUMENT) == "claimed"


def test_nothing_is_claimed_on_a_rig_within_its_noise_that_no_withheld_recording_shows(linear, candidate) -> None:
    comparison = _named(linear, candidate)
    known = [h.effects[0] for h in comparison.hypotheses]
    tests = {"fitted": Shrink(1.03, 1.0)}
    assert judge(comparison, known, RIG, **tests).rules[0].startswith("within the noise")
    assert judge(comparison, known, INSTRUMENT, **tests).claims
    elsewhere = {"waveform": Shrink(1.2, 1.0)}
    assert judge(comparison, known, RIG, **tests, held_out=elsewhere).claims
