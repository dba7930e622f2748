"""An effect by chance is claimed where it scatters every sample, not where wide noise hides a misfit."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from gap.decision.settle import Case, believed, settle
from gap.decision.thresholds import INSTRUMENT
from gap.decision.transfer import plain
from gap.inference.evidence import Fit
from gap.inference.hypothesis import Active, Candidate, Evaluation
from gap.search.compare import compare
from sim_devices.chain import Parameter
from tests.gap.conftest import LinearProblem, candidate
from tests.gap.decision.waves import DESIGN, T

FloatArray = NDArray[np.float64]


@dataclass
class Scattered(LinearProblem):
    """A linear problem whose effect widens the noise of every sample to √(1 + a²), and walks by so many ``nats``."""

    nats: float = np.inf

    def walk_log_bayes(self, fitted: Fit) -> float:
        return self.nats if fitted.active else np.inf

    def noise_scale(self, active: Active) -> FloatArray | None:
        a = next((v["a"] for v in active.values()), 0.0)
        return np.full(len(self.measured), np.sqrt(1.0 + a * a)) if active else None

    def evaluate(self, nuisance: FloatArray, active: Active, want_jacobian: bool = True) -> Evaluation:
        times = self.noise_scale(active)
        wide = np.ones(len(self.measured)) if times is None else times
        return Evaluation(
            (self.measured - self.design @ nuisance) / wide,
            self.design / wide[:, None] if want_jacobian else np.zeros((0, 0)),
        )


def said(misfit: FloatArray, sparse: bool = False, nats: float = np.inf) -> tuple[str, str]:
    """The verdict and its rule where ``misfit`` (n,) is left and noise of every sample is the only effect known."""
    y = DESIGN @ [2.0, 1.0] + np.random.default_rng(0).normal(size=len(T)) + misfit
    known: list[Candidate] = [replace(candidate("jitter", Parameter("a", "1", 0.1, 30.0, 0.5)), sparse=sparse)]
    comparison = compare([Scattered(y, DESIGN, nats=nats)], known)
    case = Case(comparison, known, (), plain(comparison.problems, comparison.null), {}, {})
    verdict = settle(believed(case, INSTRUMENT)[0], INSTRUMENT).verdict
    return verdict.verdict, verdict.rules[0]


def test_scatter_of_every_sample_is_claimed() -> None:
    verdict, rule = said(4.0 * np.random.default_rng(1).normal(size=len(T)))
    assert verdict == "effect"
    assert rule.startswith("claimed")


@pytest.mark.parametrize("share", [0.05, 0.1])
def test_a_misfit_of_few_samples_is_no_scatter_of_all(share: float) -> None:
    rng = np.random.default_rng(2)
    few = np.where(rng.uniform(size=len(T)) < share, 30.0 * rng.normal(size=len(T)), 0.0)
    assert said(few) == ("unknown", "nothing to name: no effect was fitted")
    assert said(few, sparse=True)[0] == "effect"


def test_a_misfit_that_neighbours_share_is_no_scatter() -> None:
    rng = np.random.default_rng(3)
    alone = 8.0 * rng.normal(size=len(T))
    shared = np.convolve(rng.normal(size=len(T) + 9), np.full(10, 8.0 / np.sqrt(10.0)), "valid")
    assert said(alone, sparse=True)[0] == "effect"
    assert said(shared, sparse=True) == ("unknown", "nothing to name: no effect was fitted")


def test_a_reading_walks_only_where_nothing_else_explains_as_much() -> None:
    misfit = 4.0 * np.random.default_rng(1).normal(size=len(T))
    assert said(misfit, nats=INSTRUMENT.chance_walk + 1.0)[0] == "effect"
    assert said(misfit, nats=INSTRUMENT.chance_walk - 1.0) == ("unknown", "nothing to name: no effect was fitted")
