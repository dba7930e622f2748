"""Fits under several widths of the prior, of which a straight line from one tells the others wrongly."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gap.inference.evidence import Hypothesis
from gap.inference.hypothesis import Active, Candidate, Evaluation
from gap.inference.least_squares import fit, under
from gap.search.compare import Comparison, _finish_null
from gap.search.refits import refit
from gap.search.screening import Screened
from tests.gap.conftest import LinearProblem

N = 80
WAVE = np.sin(np.arange(N))
NARROW, WIDE = np.array([1.0, 1e-12]), np.array([1.0, 3.0])
"""Prior widths: of a simple law, without its second parameter, and of one that has it."""


class Bent(LinearProblem):
    """y = c0 + g(c1) wave: ``bend`` is g and ``slope`` its derivative."""

    def __init__(self, bend: Callable[[float], float], slope: Callable[[float], float]) -> None:
        noise = np.random.default_rng(4).normal(size=N)
        super().__init__(noise, np.ones((N, 2)), {"wave": lambda v: 0.0 * WAVE})
        self.bend, self.slope = bend, slope
        self.prior_sd, self.prior_scales = WIDE, (NARROW, WIDE)
        self.likelihood_powers = (1.0, 1.0)

    def evaluate(self, nuisance: np.ndarray, active: Active, want_jacobian: bool = True) -> Evaluation:
        predicted = nuisance[0] + self.bend(nuisance[1]) * WAVE
        jacobian = np.column_stack([np.ones(N), self.slope(nuisance[1]) * WAVE])
        return Evaluation(self.measured - predicted, jacobian if want_jacobian else np.zeros((0, 0)))


def test_the_null_is_fitted_under_a_law_that_an_effect_s_fit_has_found(candidate: Callable[..., Candidate]) -> None:
    """The second parameter leads to where a straight line says that it cannot be without: an effect of no strength that
    was fitted without it earned nats by that."""
    problem = Bent(lambda b: 0.2 * b + np.exp(20 * (b - 2.2)), lambda b: 0.2 + 20 * np.exp(20 * (b - 2.2)))
    problem.measured = problem.measured + (0.6 - problem.measured @ WAVE / (WAVE @ WAVE)) * WAVE
    null = fit(problem, nuisance=np.zeros(2), tolerance=1e-5)
    assert null.nuisance[1] > 1.0
    simple = fit(under(problem, problem.prior_mean, NARROW), (candidate("wave"),), np.array([0.5]), np.zeros(2))
    comparison = Comparison({"linear": problem}, Hypothesis((), {"linear": null}))
    comparison.hypotheses.append(Hypothesis((candidate("wave"),), {"linear": simple}))

    def earned() -> float:
        weight = comparison.weighed({"linear": 1.0})
        return weight[id(comparison.hypotheses[0])].evidence - weight[id(comparison.null)].evidence

    assert earned() > 1.0
    _finish_null(comparison)
    assert earned() < 0.2


def test_a_refit_that_loses_under_a_likelier_law_goes_on_under_its_own(candidate: Callable[..., Candidate]) -> None:
    """Far from nought the second parameter does nothing, so that a straight line lets it go there, where it does: a
    lost sample was fitted with a chi2 of 1900, from 830."""
    problem = Bent(lambda b: 60.0 * (abs(b) < 0.5), lambda b: 0.0)
    base = fit(problem, nuisance=np.array([0.0, 2.0]))
    assert base.best_prior(problem.prior_scales) is NARROW
    wave = candidate("wave")
    screened = Screened(wave, (np.array([0.5]),), 10.0, {"linear": (np.array([0.5]),)}, {"linear": WIDE})
    fits, _ = refit({"linear": problem}, Hypothesis((), {"linear": base}), screened)
    assert fits["linear"].chi2 < 1.5 * N
