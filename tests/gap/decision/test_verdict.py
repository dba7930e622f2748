"""The verdict on small linear problems: which effect, which class, one or two, or none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gap.data.signatures import HUM, Signature
from gap.decision.transfer import Shrink
from gap.decision.verdict import Judgement, Verdict, borne_out, judge, made_by, weakest
from gap.diagnosis import confusable
from gap.search.compare import compare
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

    def run(names, strengths, rules=Judgement(), marks=(), extra=0.0, seed=0) -> Verdict:
        noise = np.random.default_rng(seed).normal(size=len(T))
        y = DESIGN @ [2.0, 1.0] + sum((a * SHAPES[n] for n, a in strengths.items()), 0 * T) + noise + extra
        effects = {n: (lambda v, n=n: v["a"] * SHAPES[n.split("[")[0]]) for n in names}
        problem = linear(y, DESIGN, effects, np.full(2, 100.0))
        known = [candidate(n, Parameter("a", "1", -30.0, 30.0)) for n in names]
        return judge(compare([problem], known), known, rules, marks)

    return run


def test_the_effect_that_acts_is_named(verdict_on) -> None:
    v = verdict_on(("bump", "late", "wave"), {"bump": 8.0})
    assert v.verdict == "effect"
    assert v.causes[0].names == ("bump",)
    assert v.causes[0].probability > 0.8
    assert v.gap_before > v.gap_after
    assert v.gap_after == pytest.approx(1.0, abs=0.1)
    assert next(iter(v.stages)) == "actuator"
    assert sum(v.stages.values()) == pytest.approx(1 - Judgement().outside)


def test_nothing_is_found_where_nothing_is(verdict_on) -> None:
    for seed in range(5):
        v = verdict_on(("bump", "late", "wave"), {}, seed=seed)
        assert v.verdict in ("none", "undetectable")
        assert v.probability_none > 0.5


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


def test_what_the_library_lacks_is_unknown_and_not_the_nearest_name(verdict_on) -> None:
    strange = 8.0 * np.sign(np.sin(23 * T))
    v = verdict_on(("bump", "late", "wave"), {}, extra=strange)
    assert v.verdict in ("unknown", "undetectable", "none")
    assert v.unexplained > 0.5


def test_a_hum_is_unknown_where_nothing_else_is_found(verdict_on) -> None:
    hum = Signature(HUM, "pressure", 30.0, "pressure has a line at 12.5 Hz")
    assert verdict_on(("bump", "late"), {}, marks=(hum,)).verdict == "unknown"
    assert verdict_on(("bump", "late"), {"bump": 8.0}, marks=(hum,)).verdict == "effect"


def taking(share: float) -> Shrink:
    """A gap of 2 of which ``share`` of what lies above the noise goes."""
    return Shrink(2.0, 2.0 - share)


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
    noise = np.random.default_rng(0).normal(size=len(T))
    y = DESIGN @ [2.0, 1.0] + strength * SHAPES["wave"] / 5 + noise
    problem = linear(y, DESIGN, {"wave": lambda v: v["a"] * SHAPES["wave"]}, np.full(2, 100.0))
    known = [candidate("wave", Parameter("a", "1", -60.0, 60.0))]
    comparison = compare([problem], known)
    verdict = judge(comparison, known)
    assert verdict.verdict == "effect"
    shrinks = {"fitted": Shrink(gap, 0.9 * gap), **({} if transfer is None else {"waveform": taking(transfer)})}
    assert borne_out(verdict, comparison, shrinks).verdict == "effect"  # no skin in this block
    grown = shrinks | {"fitted": Shrink(gap, gap + 0.01)}
    assert borne_out(verdict, comparison, grown).verdict in ("unknown", "undetectable")
    for times, then in ((1.1, "effect"), (1.2, "unknown")):  # on repeats of what it was fitted to
        assert borne_out(verdict, comparison, shrinks | {"repeat": Shrink(2.0, 2.0 * times)}).verdict == then
    assert borne_out(verdict, comparison, shrinks | {"repeat": Shrink(0.8, 1.1)}).verdict == "effect"  # all noise
    jump = candidate("wave", Parameter("a", "1", -60.0, 60.0), Parameter("moment", "s", 0.0, 1.0))
    jumping = replace(verdict.causes[0], hypothesis=replace(verdict.causes[0].hypothesis, effects=(jump,)))
    at_once = replace(verdict, causes=(jumping,))  # its repeats foretell nothing of it
    assert borne_out(at_once, comparison, shrinks | {"repeat": Shrink(2.0, 4.0)}).verdict == "effect"
    for times, then in ((1.4, "effect"), (1.6, "unknown")):  # on another waveform
        assert borne_out(verdict, comparison, shrinks | {"waveform": Shrink(2.0, 2.0 * times)}).verdict == then
    problem.plain_sd = np.full(2, 1.0)
    final = borne_out(verdict, comparison, shrinks)
    assert final.verdict == said
    assert (final.causes[0].probability > 0.5) == (said == "effect")  # what is not named is not likelier than not


def test_a_signature_decides_between_equals(verdict_on) -> None:
    marks = (Signature("twin", "height", 30.0, "twin's mark"),)
    v = verdict_on(("bump", "late", "twin"), {"bump": 8.0}, marks=marks)
    assert v.causes[0].names[0] == "twin"


def test_a_prior_for_no_effect_wins_on_weak_evidence(verdict_on) -> None:
    doubtful = {"bump": 0.9}
    sure_of_none = Judgement(prior_effect=1e-6, prior_pair=1e-9)
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
    verdict = judge(comparison, known)
    assert verdict.verdict == "effect"
    assert weakest(verdict.causes[0].hypothesis)
    fitted = {"fitted": Shrink(1.05, 1.0)}
    assert borne_out(verdict, comparison, fitted | {"level": taking(0.4)}).verdict == "effect"
    assert borne_out(verdict, comparison, fitted | {"level": taking(-3.0)}).verdict == "undetectable"
    assert borne_out(verdict, comparison, fitted | {"level": taking(0.002)}).verdict == "undetectable"
    assert borne_out(verdict, comparison, fitted).verdict == "undetectable"


def test_a_second_effect_must_explain_more_than_some_pair_always_does(linear, candidate) -> None:
    noise = np.random.default_rng(0).normal(size=len(T))
    y = DESIGN @ [2.0, 1.0] + 3.0 * SHAPES["bump"] + 0.6 * SHAPES["wave"] + noise
    effects = {n: (lambda v, n=n: v["a"] * SHAPES[n]) for n in ("bump", "wave")}
    problem = linear(y, DESIGN, effects, np.full(2, 100.0))
    known = [candidate(n, Parameter("a", "1", -9.0, 9.0)) for n in effects]
    comparison = compare([problem], known)
    assert any(len(h.effects) == 2 for h in comparison.hypotheses)
    likely = Judgement(prior_pair=0.5, second_least=0.0)
    assert judge(comparison, known, likely).verdict == "several"
    assert judge(comparison, known, Judgement(prior_pair=0.5, second_least=1e4)).verdict == "effect"


@pytest.mark.parametrize(("rules", "leader"), [(Judgement(lead=3.0), "bump"), (Judgement(), "rich")])
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
