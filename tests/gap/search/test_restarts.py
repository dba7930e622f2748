"""Effects of several parameters are found where the points of the screening lead nowhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gap.effects.load import library
from gap.inference.evidence import Hypothesis
from gap.inference.hypothesis import Candidate
from gap.inference.least_squares import fit
from gap.search.compare import Effort, compare
from gap.search.refits import refit
from gap.search.restarts import all_or_nothing, begun_anew
from gap.search.screening import Screened
from sim_devices.chain import Parameter
from sim_devices.stages import kernels
from tests.gap.conftest import LinearProblem

TIME = np.arange(0.0, 120.0, 0.1)
TRUE = {"draw": 0.08, "capacity": 33.5e3, "bleed": 0.008, "fill": 40.0, "soft": 20.0}
STORE = ("draw", "reference", "capacity", "bleed", "fill", "soft")


def asked() -> np.ndarray:
    """Suction of four loadings, the last two to what the store hardly gives, Pa."""
    q = np.zeros(len(TIME))
    for begin, top in ((5.0, 15e3), (30.0, 25e3), (55.0, 31e3), (85.0, 33e3)):
        q = np.maximum(q, top * np.clip(np.minimum((TIME - begin) / 2.0, (begin + 18.0 - TIME) / 2.0), 0.0, 1.0))
    return -q


def given(values) -> np.ndarray:
    out = np.empty(len(TIME))
    parameters = np.array([(values | {"reference": 30e3})[name] for name in STORE])
    kernels.limited_store(np.zeros(8), TIME, asked(), parameters, out)
    return out


def problem(noise: float = 50.0) -> LinearProblem:
    y = given(TRUE) + noise * np.random.default_rng(0).normal(size=len(TIME))
    design = np.column_stack([np.ones(len(TIME)), 0.01 * asked()]) / noise
    return LinearProblem((y - asked()) / noise, design, {"reservoir_depletion": lambda v: (given(v) - asked()) / noise})


@pytest.fixture(scope="module")
def store() -> Candidate:
    effect = library("cutometer")["reservoir_depletion[form=2]"]
    return Candidate(effect.name, effect.name, effect.stage, effect.parameters, ("linear",))


@pytest.mark.parametrize(("anew", "found"), [(0, False), (4, True)])
def test_a_store_is_found_between_the_points_of_the_screening(store: Candidate, anew: int, found: bool) -> None:
    best = compare([problem()], [store], replace(Effort(), anew=anew)).hypotheses[0].fits["linear"]
    assert (best.chi2 < 1.2 * len(TIME)) is found
    if found:
        values = best.active[store]
        assert values["capacity"] == pytest.approx(TRUE["capacity"], rel=0.02)
        assert values["fill"] == pytest.approx(TRUE["fill"], rel=0.3)


def test_a_simulation_that_diverges_is_no_start_and_no_end(store: Candidate) -> None:
    """A sound robot session ended with 'array must not contain infs or NaNs': one friction of hundreds diverged."""
    data = problem()
    known = data.effects["reservoir_depletion"]

    def diverging(v) -> np.ndarray:
        return known(v) if v["fill"] > 20.0 else np.full(len(TIME), np.nan)

    data = replace(data, effects={"reservoir_depletion": diverging})
    best = compare([data], [store], Effort()).hypotheses[0].fits["linear"]
    assert best.chi2 < 1.2 * len(TIME)


@pytest.mark.parametrize(("seen", "parameters", "expected"), [
    ((0.0, 0.5, 300.0), 2, True),
    ((0.0, 0.5, 300.0), 1, False),  # a fit of a limit alone begins at many places anyhow
    ((0.0, 40.0, 300.0), 2, False),
    ((0.0, 0.5, 30.0), 2, False),
])  # fmt: skip
def test_what_does_nothing_or_much_is_known(
    store: Candidate, seen: tuple[float, ...], parameters: int, expected: bool
) -> None:
    candidate = replace(store, parameters=store.parameters[:parameters])
    looked = [(np.zeros(parameters), d) for d in seen]
    assert all_or_nothing(Screened(candidate, (), 0.0, {}, {}, detectability=looked)) is expected


def test_a_limit_is_begun_anew_wherever_it_ranks(store: Candidate) -> None:
    """Of three outside authors' stores two were claimed as leaks: hardly a point of the screening meets such a limit,
    and what others explained was refitted."""
    data = problem()
    wave = np.sin(TIME) / 50.0
    data = replace(data, effects=data.effects | {"wave": lambda v: v["a"] * wave})
    weak = Candidate("wave", "wave", "actuator", (Parameter("a", "1", 0.0, 1.0, 0.0, 0.5),), ("linear",))
    hidden = replace(Effort(), quick_fits=0, refit_singles=0, far_fits=0, known_law=0, imitators=0, pair_bases=0)
    found = compare([data], [weak, store], replace(hidden, anew=1), suspects=[weak]).hypotheses
    assert min(h.fits["linear"].chi2 for h in found if store in h.effects) < 1.2 * len(TIME)


def test_one_begun_anew_has_a_start_in_each_block(store: Candidate) -> None:
    """Two outside sessions ended with 'max() arg is an empty sequence': the block of which most was left hardly saw
    the effect, and the other had nowhere to begin."""
    strange = 500.0 * np.sign(np.sin(23 * TIME))
    blind = replace(problem(), measured=strange, effects={"reservoir_depletion": lambda v: 0.0 * TIME})
    blocks = {"linear": blind, "second": replace(problem(), name="second")}
    null = Hypothesis((), {name: fit(p) for name, p in blocks.items()})
    asked_for = replace(store, blocks=tuple(blocks))
    units = (np.full(len(store.parameters), 0.5),)
    widths = {name: p.prior_sd for name, p in blocks.items()}
    screened = Screened(asked_for, units, 0.0, {name: units for name in blocks}, widths)
    there, _ = begun_anew(null, screened, blocks)
    assert list(there.starts) == ["linear", "second"]
    fits, _ = refit(blocks, null, there)
    assert set(fits) == set(blocks)
