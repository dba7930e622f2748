"""The verdict on small linear problems: which effect, one or two, unknown, or none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gap.data.signatures import HUM, MAINS, Signature
from gap.data.tolerances import Tolerance, tolerances
from gap.decision.classes import nats_without_skin
from gap.decision.findings import Findings
from gap.decision.gaps import Shrink
from gap.decision.posterior import posterior
from gap.decision.settle import Case, settle
from gap.decision.thresholds import INSTRUMENT, RIG, Thresholds, provenance
from gap.decision.tolerance import Size, Stated, in_tolerances, weakest
from gap.decision.transfer import plain
from gap.decision.verdict import ALIKE, RULES, decide
from gap.inference.evidence import Hypothesis
from gap.inference.hypothesis import slope
from gap.search.compare import Comparison, compare
from sim_devices.chain import Parameter
from tests.gap.decision.waves import DESIGN, SHAPES, T, judge, taking, total, weak_wave


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


def test_two_effects_are_told_as_several(verdict_on) -> None:
    v = verdict_on(("bump", "late", "wave"), {"bump": 9.0, "wave": 4.0})
    assert v.verdict == "several"
    assert {e.name for e in v.causes[0].effects} == {"bump", "wave"}


def test_a_second_effect_must_earn_its_place(verdict_on) -> None:
    """The form error of the first one is worth some χ² to any second one."""
    strange = 1.5 * np.sign(np.sin(23 * T))
    doubtful = verdict_on(("bump", "late"), {"bump": 15.0, "late": 1.2}, extra=strange)
    assert len(doubtful.causes[0].effects) == 1
    assert {e.name for e in doubtful.causes[1].effects} == {"bump", "late"}  # to be looked for next, and no more
    assert doubtful.causes[1].probability < 0.05
    assert len(verdict_on(("bump", "late"), {"bump": 15.0, "late": 4.0}).causes[0].effects) == 2


@pytest.mark.parametrize(("event", "said"), [(False, "several"), (True, "effect")])
def test_a_second_effect_must_be_seen_itself(linear, candidate, event: bool, said: str) -> None:
    """For a while many things stand out by six sigma, which is much for an effect that acts all the time."""
    y = (
        DESIGN @ [2.0, 1.0]
        + 15.0 * SHAPES["bump"]
        + 2.1 * SHAPES["late"]
        + np.random.default_rng(0).normal(size=len(T))
    )
    effects = {n: (lambda v, n=n: v["a"] * SHAPES[n]) for n in ("bump", "late")}
    known = [replace(candidate(n, Parameter("a", "1", -30.0, 30.0)), event=event and n == "late") for n in effects]
    comparison = compare([linear(y, DESIGN, effects, np.full(2, 100.0))], known)
    assert judge(comparison, known, replace(INSTRUMENT, second_above=1.0)).verdict == said


@pytest.mark.parametrize(
    ("tolerance", "strength", "said"), [(1.0, 3.15, "effect"), (5.0, 3.15, "undetectable"), (5.0, 9.0, "undetectable")]
)
def test_what_cannot_be_told_from_a_tolerance_is_no_finding(linear, candidate, tolerance, strength, said) -> None:
    y = DESIGN @ [2.0, 1.0] + strength * SHAPES["bump"] + np.random.default_rng(0).normal(size=len(T))
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


def test_mains_in_the_noise_leave_the_verdict_alone(verdict_on) -> None:
    mains = Signature(MAINS, "pressure", 30.0, "pressure has a line at 50.0 Hz")
    found, without = (verdict_on(("bump", "late"), {}, marks=marks) for marks in ((mains,), ()))
    assert found.verdict == without.verdict != "unknown"
    assert found.posterior.none == without.posterior.none


@pytest.mark.parametrize(
    ("strength", "gap", "transfer", "said"),
    [
        (3.15, 2.0, 0.9, "effect"),
        (3.15, 2.0, 0.05, "unknown"),  # repairs the fitted recordings, and no more
        (3.15, 1.0, 0.05, "effect"),  # nothing is left to take away
        (3.15, 2.0, None, "effect"),  # one waveform only
        (3.15, 3.0, 0.9, "unknown"),  # leaves a gap of 2.4
        (30.0, 2.0, 0.05, "effect"),  # beyond the rest that skin could leave
    ],
)
def test_a_device_effect_must_carry_over_where_skin_is_in_play(
    linear, candidate, strength: float, gap: float, transfer: float | None, said: str
) -> None:
    comparison, known = weak_wave(linear, candidate, strength)
    held_out = {} if transfer is None else {"waveform": taking(transfer)}
    fitted = Shrink(gap, 0.8 * gap)
    free = nats_without_skin(
        posterior(comparison, known, INSTRUMENT).causes[0], comparison, comparison.temper(), INSTRUMENT.unusual_gap
    )
    assert free["linear"] > 0.0
    assert judge(comparison, known, fitted=fitted, held_out=held_out, without_skin=np.inf).verdict == "effect"
    comparison.problems["linear"].open_law = True
    skin = nats_without_skin(
        posterior(comparison, known, INSTRUMENT).causes[0], comparison, comparison.temper(), INSTRUMENT.unusual_gap
    )
    assert skin == {}
    final = judge(comparison, known, fitted=fitted, held_out=held_out, without_skin=0.0)
    assert final.verdict == said
    assert (final.causes[0].probability > 0.5) == (
        said == "effect"
    )  # an effect that is not named is not likelier than not
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
    comparison, known = weak_wave(linear, candidate, 3.15)
    verdict = judge(comparison, known, held_out={split: Shrink(before, after)})
    assert verdict.verdict == said
    assert verdict.rules[0].startswith("claimed" if said == "effect" else "worse")


def test_nothing_foretells_an_event_in_a_repeat(linear, candidate) -> None:
    comparison, known = weak_wave(linear, candidate, 4.0, event=True)
    assert judge(comparison, known, held_out={"repeat": Shrink(2.0, 4.0)}).verdict == "effect"
    there = Shrink(1.25, 1.0)
    assert judge(comparison, known, fitted=there, held_out={"waveform": Shrink(1.2, 1.2001)}).verdict == "effect"


@pytest.mark.parametrize(("left", "rule"), [(2.56, "takes nothing away"), (2.4, "claimed")])
def test_a_claim_lowers_the_gap_of_the_whole_session(linear, candidate, left: float, rule: str) -> None:
    """Muscle tone that left a gap of 2.58 was claimed as a wandering clock, which took .07 of the pressure's 1.24."""
    comparison, known = weak_wave(linear, candidate, 4.0)
    found = replace(posterior(comparison, known, INSTRUMENT, ()), gap_before=2.58, gap_after=left, unexplained=0.0)
    assert decide(Findings(found, INSTRUMENT, fitted=Shrink(1.24, 1.1))).rules[0].startswith(rule)


@pytest.mark.parametrize(("after", "said"), [(1.42, "unknown"), (1.12, "effect")])
def test_a_claim_makes_no_other_channel_worse(linear, candidate, after: float, said: str) -> None:
    """A valve that sleeps was claimed as a jump of the gauge's reading, after which the height was no longer met."""
    comparison, known = weak_wave(linear, candidate, 4.0)
    blocks = {"pressure": Shrink(4.19, 1.04), "height": Shrink(1.10, after)}
    assert judge(comparison, known, fitted=Shrink(3.07, 1.42), each=blocks).verdict == said


@pytest.mark.parametrize(
    ("after", "elsewhere", "said"),
    [
        (0.93, (0.93, 0.93), "undetectable"),
        (0.93, (1.3, 1.1), "effect"),
        (0.93, (0.98, 0.93), "effect"),
        (0.93, (0.995, 0.98, 2000), "effect"),
        (0.93, (0.995, 0.98, 1000), "undetectable"),
        (0.85, (0.93, 0.9), "effect"),
        (0.93, None, "effect"),
    ],
)
def test_what_takes_little_away_must_help_elsewhere(linear, candidate, after, elsewhere, said) -> None:
    """Uneven counts were told a lag, which took .02 of a gap of .95 and nothing of a withheld waveform's. An orifice's
    leak of 8 sigma took .02 as well, and .05 of a withheld waveform's. A pulse of 26 sigma took .03 of one of 1.01, of
    which hardly any is above the noise, and 120 of its chi2."""
    comparison, known = weak_wave(linear, candidate, 4.0)
    held_out = {} if elsewhere is None else {"waveform": Shrink(*elsewhere)}
    assert judge(comparison, known, fitted=Shrink(0.95, after), held_out=held_out).verdict == said


@pytest.mark.parametrize(("repeat", "said"), [(1.1, "claimed"), (25.0, "worse on repeats")])
def test_a_waveform_that_hardly_shows_an_effect_does_not_judge_it(linear, candidate, repeat, said) -> None:
    """Commands looked at every 52 ms took a gap of 14.4 to 1.2, one of 19.7 on repeats to .9, and made one of 2.1 on
    another waveform 2.7."""
    comparison, known = weak_wave(linear, candidate, 9.0)
    held_out = {"waveform": Shrink(2.1, 2.7), "repeat": Shrink(12.1, repeat)}
    fitted = Shrink(14.4, 1.2)
    assert judge(comparison, known, fitted=fitted, held_out=held_out).rules[0].startswith(said)
    louder = held_out | {"waveform": Shrink(6.0, 9.0)}
    assert not judge(comparison, known, fitted=fitted, held_out=louder).claims


@pytest.mark.parametrize(("far", "said"), [(True, "effect"), (False, "undetectable")])
def test_what_strains_a_tolerance_far_may_take_little_away(linear, candidate, far: bool, said: str) -> None:
    """A gauge five hundredths off takes .02 of a gap of .98, and nothing on withheld recordings, whose own fits strain
    the tolerance again; sound regulators were told an overshoot that took .01, and strained none."""
    comparison, known = weak_wave(linear, candidate, 3.15)
    tests = {"fitted": Shrink(0.98, 0.96), "held_out": {"waveform": Shrink(0.98, 0.98)}}
    assert judge(comparison, known, strained=far, **tests).verdict == said
    # With one experiment more it was claimed no longer, as it made next to nothing worse there.
    worse = {"fitted": Shrink(1.16, 1.11), "held_out": {"waveform": Shrink(1.19, 1.1901)}}
    assert judge(comparison, known, strained=far, **worse).verdict == said


@pytest.mark.parametrize(("effects", "left", "said"), [(1, 1.53, "effect"), (2, 1.53, "unknown"), (2, 1.1, "several")])
def test_a_pair_is_named_only_where_it_leaves_no_gap(linear, candidate, effects, left, said) -> None:
    """Preconditioning of another form was told drag and a change of tone, which left 1.53 of 2.60."""
    comparison, known = weak_wave(linear, candidate, 3.15)
    found = posterior(comparison, known, INSTRUMENT)
    first = found.causes[0]
    several = replace(first, hypothesis=replace(first.hypothesis, effects=effects * first.effects))
    findings = Findings(replace(found, causes=(several,)), INSTRUMENT, fitted=Shrink(2.6, left))
    assert decide(findings).verdict == said


def test_an_event_must_stand_out_further_since_it_may_begin_anywhere(linear, candidate) -> None:
    for event, said in ((False, "effect"), (True, "undetectable")):
        comparison, known = weak_wave(linear, candidate, 3.15, event=event)
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
    comparison, known = weak_wave(linear, candidate, 4.0)
    verdict = judge(comparison, known, fitted=Shrink(before, after))
    assert verdict.verdict == said
    assert said == "effect" or verdict.rules[0].startswith("takes nothing away")


def test_an_effect_within_twice_a_stated_tolerance_is_no_finding(linear, candidate) -> None:
    comparison, known = weak_wave(linear, candidate, 3.15)
    found = posterior(comparison, known, INSTRUMENT)
    h = found.causes[0].hypothesis
    size = abs(h.fits["linear"].active[h.effects[0]]["a"])

    def large(stated: Stated) -> Size:
        return in_tolerances(comparison.problems, comparison.null, [h], stated, found.temper)

    assert large({}).tolerances == np.inf
    (unit,), (sd,) = h.fits["linear"].told(h.effects[0])
    nearest = size - sd * slope(h.effects[0].parameters[0], unit)  # one standard deviation less
    assert large({"wave": {"a": Tolerance(nearest, "1", "test")}})[:2] == pytest.approx((1.0, 0.0))
    jump = replace(h.effects[0], event=True)  # an event is no tolerance
    jumping = Hypothesis((jump,), {"linear": replace(h.fits["linear"], hypothesis=(jump,))})
    stated = {"wave": {"a": Tolerance(size, "1", "test")}}
    assert in_tolerances(comparison.problems, comparison.null, [jumping], stated, found.temper) == Size()
    said = [judge(comparison, known, size=size).verdict for size in (Size(1.0), Size(3.0), Size(1.0, beyond=9.0))]
    assert said == ["undetectable", "effect", "effect"]
    assert judge(comparison, known, size=Size(0.1, of_channels=True)).settled_by == ALIKE
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
        size = in_tolerances(comparison.problems, comparison.null, [h], stated, {"linear": 0.01})
        assert size.within(INSTRUMENT.tolerances, INSTRUMENT.seen) == small, (name, strength)


def test_every_threshold_has_a_unit_a_meaning_and_a_source() -> None:
    for name, entry in provenance().items():
        assert hasattr(INSTRUMENT, name)
        assert all(str(entry[k]) for k in ("value", "unit", "meaning", "source")), name


def test_every_rule_has_a_name_of_its_own_and_the_last_always_holds() -> None:
    assert len({r.name for r in RULES}) == len(RULES)
    assert RULES[-1].name == "claimed"


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
    likely = replace(INSTRUMENT, prior_pair=0.5, second_least=0.0, second_above=1.0)
    assert judge(comparison, known, likely).verdict == "several"
    assert judge(comparison, known, replace(likely, second_least=1e4)).verdict == "effect"


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
    assert said(Shrink(5.0, 0.52), rival=Shrink(5.0, 0.48)) == "claimed", "both are within the noise"


def test_nothing_is_claimed_on_a_rig_within_its_noise_that_no_withheld_recording_shows(linear, candidate) -> None:
    comparison = _named(linear, candidate)
    known = [h.effects[0] for h in comparison.hypotheses]
    tests = {"fitted": Shrink(1.03, 1.0)}
    assert judge(comparison, known, RIG, **tests).rules[0].startswith("within the noise")
    assert judge(comparison, known, INSTRUMENT, **tests).claims
    elsewhere = {"waveform": Shrink(1.2, 1.0)}
    assert judge(comparison, known, RIG, **tests, held_out=elsewhere).claims
