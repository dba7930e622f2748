"""Effects within tolerance are the simulation's, and others are found beside them."""

from __future__ import annotations

import re

import numpy as np
import pytest

from gap.data.tolerances import Tolerance
from gap.decision.posterior import posterior
from gap.decision.settle import Case, believed, settle
from gap.decision.thresholds import INSTRUMENT
from gap.decision.tolerated import beside, told, tolerated
from gap.decision.transfer import plain
from gap.search.compare import Comparison, compare
from sim_devices.chain import Parameter
from tests.gap.decision.waves import DESIGN, SHAPES, T

LIMIT = {"bump": {"a": Tolerance(4.0, "1", "of a test")}}
"""A bump of 8 is two tolerances."""


@pytest.fixture
def two_channels(linear, candidate):
    """``two_channels(bump, late, wave)``: a comparison where ``bump`` and ``late`` act in the first channel and
    ``wave`` in the second, with such strengths; and its candidates."""

    def made(bump: float, late: float = 0.0, wave: float = 0.0) -> tuple[Comparison, list]:
        noise = np.random.default_rng(1).normal(size=(2, len(T)))
        y = DESIGN @ [2.0, 1.0] + noise
        y[0] += bump * SHAPES["bump"] + late * SHAPES["late"]
        y[1] += wave * SHAPES["wave"]
        effects = {n: (lambda v, n=n: v["a"] * SHAPES[n]) for n in ("bump", "late", "wave")}
        problems = [linear(y[k], DESIGN, effects, np.full(2, 100.0), name=name) for k, name in enumerate(("p", "h"))]
        size = Parameter("a", "1", -30.0, 30.0, 0.0)
        known = [candidate(n, size, block=b) for n, b in (("bump", "p"), ("late", "p"), ("wave", "h"))]
        return compare(problems, known), known

    return made


def _case(comparison: Comparison, known: list) -> Case:
    return Case(comparison, known, (), plain(comparison.problems, comparison.null), {}, LIMIT)


def test_an_effect_within_tolerance_hides_none_in_another_channel(two_channels) -> None:
    """A rate limited within tolerance came first in most sessions of another author, and a late height second."""
    comparison, known = two_channels(bump=7.0, wave=1.0)
    before = settle(_case(comparison, known), INSTRUMENT).verdict
    assert before.causes[0].names == ("bump",)
    assert not before.claims
    case, words = believed(_case(comparison, known), INSTRUMENT)
    after = settle(case, INSTRUMENT).verdict
    assert after.verdict == "effect"
    assert after.causes[0].names == ("wave",)
    assert re.fullmatch(r"the simulation takes on bump of 1\.\d stated tolerances, which is no finding", *words)


def test_an_effect_within_tolerance_hides_none_in_its_own_channel(two_channels) -> None:
    comparison, known = two_channels(bump=7.0, late=4.0)
    case, _ = believed(_case(comparison, known), INSTRUMENT)
    verdict = settle(case, INSTRUMENT).verdict
    assert verdict.causes[0].names == ("late",)
    fitted = verdict.causes[0].hypothesis.fits["p"]
    assert {e.name for e in fitted.hypothesis} == {"bump", "late"}
    effect = verdict.causes[0].effects[0]
    assert fitted.active[effect]["a"] == pytest.approx(4.0, abs=1.0)
    assert -30.0 + 60.0 * fitted.unit[fitted.place(effect)] == pytest.approx(fitted.active[effect]["a"])


def test_the_form_of_one_within_tolerance_is_not_repaired_by_another(two_channels) -> None:
    """A lag within tolerance left a sixtieth of what it explained, which creep took away, and was claimed for."""
    comparison, _ = two_channels(bump=7.0, late=4.0)
    taken = tolerated(comparison, LIMIT, 2.0, 3.0)
    both = [h for h in comparison.hypotheses if {e.name for e in h.effects} == {"bump", "late"}]
    first = taken[0].hypothesis
    share = (first.deviance - both[0].deviance) / (comparison.null.deviance - first.deviance)
    for least, kept in ((0.9 * share, True), (1.1 * share, False)):
        pairs = [h for h in beside(comparison, taken, least).hypotheses if h.fits["p"] is both[0].fits["p"]]
        assert bool(pairs) == kept


def test_alone_it_is_the_simulation(two_channels) -> None:
    comparison, known = two_channels(bump=7.0)
    case, _ = believed(_case(comparison, known), INSTRUMENT)
    settled = settle(case, INSTRUMENT)
    assert settled.verdict.causes[0].names == ("bump",)
    assert settled.verdict.settled_by == "within tolerance"
    assert settled.verdict.verdict == "undetectable"
    assert 0.3 < settled.verdict.causes[0].probability <= 0.45
    assert settled.trials[0].answer is case.null
    total = settled.verdict.posterior
    assert total.none + total.named + total.outside == pytest.approx(1.0)
    assert sum(total.stages.values()) == pytest.approx(total.named)
    found = posterior(case.comparison, known, INSTRUMENT)
    assert found.none > 0.7  # of three effects that might act, one has become as probable as before the data
    assert posterior(comparison, known, INSTRUMENT).none < 0.01
    assert case.null.fits["p"].chi2 < comparison.null.fits["p"].chi2


@pytest.mark.parametrize("bump", [0.0, 12.0])
def test_nothing_and_more_than_a_tolerance_stay(two_channels, bump: float) -> None:
    comparison, known = two_channels(bump=bump)
    case = _case(comparison, known)
    there, words = believed(case, INSTRUMENT)
    assert there.comparison == comparison
    assert there.null is case.null
    assert not words


def test_one_that_references_have_shown_stays(two_channels) -> None:
    comparison, _ = two_channels(bump=7.0)
    assert tolerated(comparison, LIMIT, 2.0, 3.0)
    assert not tolerated(comparison, LIMIT, 2.0, 3.0, known=lambda h: h.name == "bump")


def test_a_stronger_one_in_the_same_channel_is_not_hidden(two_channels) -> None:
    comparison, _ = two_channels(bump=4.0, late=12.0)
    assert not tolerated(comparison, LIMIT, 2.0, 3.0)


def test_every_hypothesis_is_compared_with_it(two_channels) -> None:
    """No effect of another channel has the fits without it."""
    comparison, _ = two_channels(bump=7.0, wave=1.0)
    taken = tolerated(comparison, LIMIT, 2.0, 3.0)
    there = beside(comparison, taken, least=0.0)
    assert there.null.effects == ()
    assert told(taken)
    for h in there.hypotheses:
        if "p" not in {b for e in h.effects for b in e.blocks}:
            assert h.fits["p"] is there.null.fits["p"]
    singles = [h.name for h in there.hypotheses]
    assert len(singles) == len(set(singles))


def test_one_that_hardly_stands_out_is_not_taken_on(two_channels) -> None:
    """A rate limit that explained 0.8 nats halved the probability that nothing acts."""
    comparison, _ = two_channels(bump=0.85)
    (cause,) = tolerated(comparison, LIMIT, 2.0, 0.0)
    assert 0.0 < cause.detectability < 3.0
    assert not tolerated(comparison, LIMIT, 2.0, 3.0)


def test_one_that_stands_out_more_comes_before_a_cause_that_is_not_named(two_channels) -> None:
    """A rate limited within tolerance (18.8 σ) came behind a low-pass of 6.4 σ that was no finding either."""
    comparison, known = two_channels(bump=7.0, wave=0.4)
    case, _ = believed(_case(comparison, known), INSTRUMENT)
    verdict = settle(case, INSTRUMENT).verdict
    assert not verdict.claims
    bump, wave = verdict.causes[:2]
    assert (bump.names, wave.names) == (("bump",), ("wave",))
    assert bump.tolerated
    assert bump.detectability > wave.detectability
    assert bump.probability > wave.probability > 0.0
    p = verdict.posterior
    assert p.none + p.outside + sum(c.probability for c in verdict.causes) == pytest.approx(1.0)
