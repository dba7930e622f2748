"""How many stated tolerances an effect is large."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gap.data.tolerances import Tolerance
from gap.decision.findings import Findings
from gap.decision.gaps import Shrink
from gap.decision.posterior import posterior
from gap.decision.thresholds import INSTRUMENT
from gap.decision.tolerance import as_sure, in_stated, least, strained
from gap.decision.verdict import decide
from gap.inference.hypothesis import Candidate
from gap.search.compare import Effort, compare
from sim_devices.chain import Parameter
from tests.gap.decision.waves import T, judge


def test_the_size_of_an_effect_is_what_the_block_says_that_tells_it_best(linear) -> None:
    """A gauge 5.5 % off was within tolerance: the pressure, which its loop holds at the command, said 0 and knew
    nothing, and the manometer beside it was not asked."""
    noise = np.random.default_rng(11).normal(size=(2, len(T)))
    blocks = {
        name: linear(
            a * np.sin(9 * T) + own,
            np.ones((len(T), 1)),
            {"gauge": lambda v, a=b: a * v["a"] * np.sin(9 * T)},
            name=name,
        )
        for name, a, b, own in (("pressure", 0.0, 1e-3, noise[0]), ("manometer", 5.0, 1.0, noise[1]))
    }
    gauge = Candidate("gauge", "gauge", "actuator", (Parameter("a", "1", -10.0, 10.0),), tuple(blocks), "gauge", "")
    found = compare(list(blocks.values()), [gauge], Effort(pair_bases=0))
    h = next(h for h in found.hypotheses if h.effects == (gauge,))
    assert h.surest(gauge) == "manometer"
    assert in_stated(gauge, h, found.null, {"gauge": {"a": Tolerance(1.0, "1", "of a test")}}) == pytest.approx(
        5.0, abs=0.5
    )


def test_what_is_known_together_only_is_as_small_as_it_may_be() -> None:
    """Gains of three transducers on skin alone: .149, .147 and .140, each within .2, and a false alarm of 15 sigma of
    their differences, which are within a tolerance of .005."""
    common, apart = 0.2**2, 1e-4**2
    spread = common * np.ones((3, 3)) + apart * np.eye(3)
    nearest = least(np.array([0.149, 0.147, 0.140]), spread)
    assert np.max(np.abs(nearest)) < 2 * 0.005
    assert np.ptp(nearest) == pytest.approx(0.009, abs=2e-4)


@pytest.mark.parametrize(
    ("value", "sd", "nearest"), [(3.0, 0.5, 2.5), (-3.0, 0.5, -2.5), (0.3, 0.5, 0.0), (3.0, 0.0, 3.0)]
)
def test_a_single_parameter_is_one_standard_deviation_nearer(value: float, sd: float, nearest: float) -> None:
    assert least(np.array([value]), np.array([[sd * sd]])) == pytest.approx([nearest])


@pytest.mark.parametrize(("width", "rule"), [(0.017, "patched"), (0.2, "claimed")])
def test_an_event_as_short_as_may_be_is_what_a_step_leaves(linear, width: float, rule: str) -> None:
    """A tension of half a second, the least that is looked for, was claimed for what a law of skin left behind a step
    of the quickest recording."""
    noise = np.random.default_rng(0).normal(size=len(T))
    lasting = Parameter("duration", "1", 0.02, 1.0, default=0.1, scale="log", null=None)
    spell = Candidate(
        "spell", "spell", "sensor", (Parameter("a", "1", -60.0, 60.0), lasting), ("linear",), "s", "", event=True
    )
    shapes = {"spell": lambda v: v["a"] * np.exp(-(((T - 0.4) / v["duration"]) ** 2))}
    y = 25.0 * np.exp(-(((T - 0.4) / width) ** 2)) + noise
    comparison = compare([linear(y, np.ones((len(T), 1)), shapes)], [spell], Effort(pair_bases=0))
    assert judge(comparison, [spell]).rules[0].startswith(rule)
    at_noise = replace(posterior(comparison, [spell], INSTRUMENT), gap_before=0.78, gap_after=0.74, unexplained=0.0)
    final = decide(Findings(at_noise, INSTRUMENT, fitted=Shrink(1.04, 0.95)))
    assert final.verdict == ("undetectable" if rule == "patched" else "effect")


@pytest.mark.parametrize(("law_parameters", "strains"), [(0, True), (1, False)])
def test_what_a_person_s_law_is_strained_by_is_no_tolerance(linear, law_parameters: int, strains: bool) -> None:
    """Sound skin of a simple law, which has no discrepancy, was told a stiffening, its penalty being a gauge's."""
    noise = np.random.default_rng(11).normal(size=len(T))
    wave = np.sin(9 * T)
    block = linear(8.0 * wave + noise, wave[:, None], {"gauge": lambda v: v["a"] * wave}, np.ones(1))
    block.law_parameters = law_parameters
    gauge = Candidate("gauge", "gauge", "actuator", (Parameter("a", "1", -10.0, 10.0),), ("linear",), "gauge", "")
    found = compare([block], [gauge], Effort(pair_bases=0))
    h = next(h for h in found.hypotheses if h.effects == (gauge,))
    assert strained(found.problems, found.null, h) == strains


@pytest.mark.parametrize(("gained", "nearest"), [(0.0, 0.0), (1.0, 0.0), (0.04, 0.0), (400.0, 2.85), (1e6, 2.997)])
def test_a_flat_optimum_is_as_sure_as_the_fit_without_is_worse(gained: float, nearest: float) -> None:
    """A valve that sleeps within 2.6 mbar stood out by 37 sigma, and was 0.0 tolerances large: its fit was flat."""
    value, covariance = np.array([3.0]), np.array([[25.0]])
    assert least(value, as_sure(value, covariance, gained)) == pytest.approx([nearest], abs=1e-3)
