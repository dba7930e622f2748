"""Sentences for people: no skin where there is none, no share of the noise, times on the plots' clock."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from gap.decision.classes import Cause
from gap.decision.gaps import Shrink
from gap.decision.thresholds import INSTRUMENT
from gap.decision.verdict import NOISY, Verdict
from gap.inference.evidence import Hypothesis
from gap.inference.least_squares import fit
from gap.null.doubts import Doubt
from gap.report.document import cause_as_json, probable_set
from gap.report.parameters import of_cause
from gap.report.sentences import sentences
from sim_devices.chain import Parameter

T = np.linspace(0.0, 1.0, 200)


def diagnosis(linear, verdict: str, excess: float, open_law: bool, **more):
    """As much of a diagnosis as sentences look at: one block, ``excess`` times the noise off."""
    y = excess * np.random.default_rng(0).normal(size=len(T))
    problem = linear(y, np.ones((len(T), 1)), {}, np.full(1, 1e-6), name="pressure")
    problem.open_law = open_law
    null = Hypothesis((), {"pressure": fit(problem)})
    gap = float(np.sqrt(np.mean(y**2)))
    posterior = SimpleNamespace(none=0.9, outside=0.1, causes=())
    said = Verdict(verdict, posterior, ("not seen: …",))
    return SimpleNamespace(
        problems={"pressure": problem}, null=null, best=null, gap_before=gap, gap_after=gap, verdict=said,
        signatures=(), bounds={}, shrinks=(), thresholds=INSTRUMENT, **more,
    )  # fmt: skip


@pytest.mark.parametrize(("open_law", "skin"), [(True, True), (False, False)])
def test_a_pressure_is_never_laid_to_skin(linear, open_law: bool, skin: bool) -> None:
    told = " ".join(sentences(diagnosis(linear, "undetectable", 1.5, open_law)))
    assert ("Skin of another law" in told) == skin
    assert skin or "skin plays no part in pressure" in told


def test_a_tolerance_that_explains_the_gap_is_said_to(linear, candidate) -> None:
    """ "No effect stands out" was said of a leak of 30 sigma that came first."""
    d = diagnosis(linear, "undetectable", 1.5, open_law=False)
    leak = Cause(Hypothesis((candidate("leak", Parameter("share", "1", 0.0, 1.0)),), {}), ("leak",), 0.45, 30.0)
    d.verdict.posterior.causes = (leak,)
    d.verdict = replace(d.verdict, rules=("within tolerance: 0.4 stated tolerances <= 2",))
    told = " ".join(sentences(d))
    assert "Leak would explain what stands out, and is within twice a stated tolerance" in told
    assert "No effect stands out" not in told


def test_an_effect_that_may_be_a_wrong_reference_is_said_to_be_either(linear) -> None:
    """Crosstalk that a block which gives way explains as well was "not shown to be the cause", and a term was looked
    for."""
    doubt = Doubt("rigid block", 400.0, (0,), "crosstalk")
    d = diagnosis(linear, "unknown", 3.0, open_law=False, doubts=(str(doubt),), term=None)
    d.verdict = replace(d.verdict, rules=(f"in doubt: {doubt}", *d.verdict.rules))
    told = " ".join(sentences(d))
    assert "Rigid block: it is not as stated" in told
    assert "or crosstalk acts" in told
    assert "Check the specimen" in told
    assert "Nothing in the library" not in told


def test_the_set_is_the_smallest_with_nine_tenths() -> None:
    empty = Hypothesis((), {})
    causes = (Cause(empty, ("leak", "gain"), 0.6, 9.0), Cause(empty, ("drift",), 0.15, 9.0))
    posterior = SimpleNamespace(causes=causes, none=0.05, outside=0.2)
    assert probable_set(posterior, 0.9) == ["leak", "gain", "outside", "drift"]
    assert probable_set(posterior, 0.7) == ["leak", "gain", "outside"]
    assert probable_set(SimpleNamespace(causes=(), none=0.95, outside=0.05), 0.9) == ["none"]


def test_an_event_is_told_on_the_clock_of_its_recording(linear, candidate, recording) -> None:
    jump = Parameter("moment", "s", 0.0, 200.0)
    problem = linear(T, np.ones((len(T), 1)), {"shift": lambda v: v["moment"] * 0 * T}, runs=2)
    effect = replace(candidate("shift", jump), event=True)
    fitted = fit(problem, (effect,), np.array([0.65]), iterations=0)
    cause = Cause(Hypothesis((effect,), {"linear": fitted}), ("shift",), 0.9, 9.0)
    runs = [recording({"flow": T}, T, name=name) for name in ("r01", "r02")]
    d = SimpleNamespace(
        problems={"linear": problem}, recordings=runs,
        verdict=SimpleNamespace(posterior=SimpleNamespace(temper={"linear": 1.0})),
    )  # fmt: skip
    entry = of_cause(d, cause)["moment"]
    assert entry["value"] == pytest.approx(130.0)
    assert entry["recording"] == "r02"  # which begins at 100 s of the session
    assert entry["in_recording"] == pytest.approx(30.0)


@pytest.mark.parametrize(
    ("rule", "by_chance", "sized"), [(NOISY, False, False), (NOISY, True, True), ("sure", False, True)]
)
def test_what_is_told_by_its_noise_has_no_size(
    linear, candidate, recording, rule: str, by_chance: bool, sized: bool
) -> None:
    """A breath told by its power was listed with the amplitude of a sine, 22 ± 3 µm, which it is not. One that is
    fitted as noise of a narrow band has that of its own."""
    effect = candidate("breath", Parameter("amplitude", "m", 0.0, 1.0))
    problem = linear(T, np.ones((len(T), 1)), {"breath": lambda v: v["amplitude"] * T})
    fitted = fit(problem, (effect,))
    problem.noise_scale = lambda active: np.ones(len(T)) if by_chance else None
    cause = Cause(Hypothesis((effect,), {"linear": fitted}), ("breath",), 0.9, 9.0)
    verdict = Verdict("effect", SimpleNamespace(temper={"linear": 1.0}), (f"{rule}: …",))
    d = SimpleNamespace(
        recordings=[recording({"flow": T}, T)],
        verdict=verdict,
        shrinks=({"fitted": Shrink(3.0, 1.1)},),
        problems={"linear": problem},
    )
    entry = cause_as_json(d, cause, 0)
    assert entry["told_by_noise"] is not sized
    assert list(entry["parameters"]) == ["amplitude"] * sized
    assert entry["shrink"]["fitted"] == (pytest.approx(0.95) if sized else None)


def test_shrinks_near_the_noise_are_not_told() -> None:
    assert Shrink(1.01, 1.29).value is None
    assert Shrink(2.0, 1.1).value == pytest.approx(0.9)
