"""The solver against closed forms of linear least squares."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gap.inference.evidence import NOWHERE, GaussianPrior
from gap.inference.hypothesis import FROZEN, Evaluation
from gap.inference.least_squares import autocorrelation_penalty, fit
from gap.inference.linear import Projector
from sim_devices.chain import Parameter


@pytest.fixture
def data() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    design = rng.normal(size=(60, 3))
    return design, design @ [1.0, -2.0, 0.5] + rng.normal(size=60), np.array([0.3, 1.0, np.inf])


def precision(sd: np.ndarray) -> np.ndarray:
    return np.diag(np.where(np.isfinite(sd), 1 / sd**2, 0.0))


def test_without_prior_it_is_least_squares(linear, data) -> None:
    design, y, _ = data
    found = fit(linear(y, design))
    assert found.nuisance == pytest.approx(np.linalg.lstsq(design, y, rcond=None)[0], abs=1e-4)
    assert found.penalty == 0


def test_a_prior_pulls_as_bayes_foretells(linear, data) -> None:
    design, y, sd = data
    expected = np.linalg.solve(design.T @ design + precision(sd), design.T @ y)
    found = fit(linear(y, design, sd=sd))
    assert found.nuisance == pytest.approx(expected, abs=2e-3)
    assert found.penalty == pytest.approx(float(expected @ precision(sd) @ expected), rel=1e-2)


def test_projector_foretells_the_objective_after_a_refit(linear, data) -> None:
    design, y, sd = data
    assert Projector(design, sd).chi2(y) == pytest.approx(fit(linear(y, design, sd=sd)).objective, rel=1e-3)


def test_projector_leaves_nothing_of_what_free_nuisance_explains(data) -> None:
    design, _, _ = data
    assert np.abs(Projector(design, np.full(3, np.inf)).apply(design)).max() < 1e-6


def test_evidence_of_a_linear_problem_is_the_gaussian_one(linear, data) -> None:
    design, y, _ = data
    sd = np.array([0.3, 1.0, 2.0])
    found = fit(linear(y, design, sd=sd))
    covariance = np.eye(60) + design @ np.diag(sd**2) @ design.T
    expected = -0.5 * (y @ np.linalg.solve(covariance, y) + np.linalg.slogdet(covariance)[1])
    assert found.log_evidence(1.0, (sd,)) == pytest.approx(expected, abs=1e-2)


def test_evidence_averages_over_prior_widths(linear, data) -> None:
    design, y, _ = data
    narrow, wide = np.full(3, 0.1), np.full(3, 2.0)
    found = fit(linear(y, design, sd=wide))
    each = [found.log_evidence(1.0, (sd,)) for sd in (narrow, wide)]
    both = found.log_evidence(1.0, (narrow, wide))
    assert both == pytest.approx(np.logaddexp(*each) - np.log(2))


def test_tempering_makes_evidence_milder(linear, data, candidate) -> None:
    design, y, _ = data
    bump = np.sin(np.arange(60.0))
    wrong = y + 3 * bump
    null = fit(linear(wrong, design, sd=np.ones(3)))
    right = fit(linear(wrong, design, {"bump": lambda v: v["a"] * bump}, np.ones(3)), (candidate("bump"),))

    def gain(temper: float) -> float:
        one, other = (f.log_evidence(temper, (np.ones(3),)) for f in (right, null))
        return one - other

    assert gain(1.0) > gain(4.0) > 0


def test_an_effect_is_found_with_its_standard_error(linear, data, candidate) -> None:
    design, y, _ = data
    bump = np.linspace(-1, 1, 60) ** 2
    problem = linear(y + 4 * bump, design, {"bump": lambda v: v["a"] * bump})
    found = fit(problem, (candidate("bump"),))
    value = next(iter(found.active.values()))["a"]
    se = 20 * np.sqrt(found.covariance[0, 0])  # of a prior 20 wide
    projected = Projector(design, np.full(3, np.inf)).apply(bump)
    assert se == pytest.approx(1 / np.sqrt(float(bump @ projected) + 12 / 20**2), rel=1e-2)
    assert abs(value - 4) < 4 * se


def test_effect_parameters_stay_within_their_prior(linear, data, candidate) -> None:
    design, y, _ = data
    bump = np.linspace(-1, 1, 60) ** 2
    problem = linear(y + 40 * bump, design, {"bump": lambda v: v["a"] * bump})
    found = fit(problem, (candidate("bump"),))
    assert found.unit[0] == pytest.approx(1.0)
    assert next(iter(found.active.values()))["a"] == pytest.approx(10.0)


def test_a_nonlinear_parameter_on_a_log_prior_converges(linear, candidate) -> None:
    t = np.linspace(0, 5, 200)
    rng = np.random.default_rng(0)
    decay = {"decay": lambda v: 50 * np.exp(-t / v["tau"])}
    problem = linear(50 * np.exp(-t / 0.7) + rng.normal(size=200), np.ones((200, 1)), decay)
    found = fit(problem, (candidate("decay", Parameter("tau", "s", 0.05, 20.0, None, 1.0, "log")),))
    assert next(iter(found.active.values()))["tau"] == pytest.approx(0.7, rel=0.1)


def test_a_problem_without_nuisance_works(linear, candidate) -> None:
    t = np.linspace(0, 1, 30)
    problem = linear(2 * t, np.zeros((30, 0)), {"slope": lambda v: v["a"] * t})
    found = fit(problem, (candidate("slope"),))
    assert next(iter(found.active.values()))["a"] == pytest.approx(2.0, abs=1e-2)
    assert Projector(np.zeros((30, 0)), np.zeros(0)).apply(t) is t


def test_a_belief_holds_an_effect_to_what_other_data_say(linear, candidate, data) -> None:
    design, y, sd = data
    shape = np.sin(np.arange(len(y)))
    effect = candidate("wave", Parameter("a", "1", 0.0, 10.0, null=0.0, default=1.0))
    problem = linear(y + 8 * shape, design, {"wave": lambda v: v["a"] * shape}, sd)
    free = fit(problem, (effect,))
    loose = fit(problem, (effect,), belief=GaussianPrior(np.array([0.2]), np.array([[1e-6]])))
    sure = fit(problem, (effect,), belief=GaussianPrior(np.array([0.2]), np.array([[1e8]])))
    assert effect.values(free.unit)["a"] == pytest.approx(8, abs=1)
    assert loose.unit == pytest.approx(free.unit, abs=1e-3)
    assert sure.unit == pytest.approx([0.2], abs=1e-3)
    priors = (problem.prior_sd,)
    assert sure.log_evidence(1.0, priors) < free.log_evidence(1.0, priors) - 50


def test_a_belief_grows_by_what_a_fit_found(linear, candidate, data) -> None:
    design, y, sd = data
    shape = np.sin(np.arange(len(y)))
    effect = candidate("wave", Parameter("a", "1", 0.0, 10.0, null=0.0, default=1.0))
    found = fit(linear(y + 8 * shape, design, {"wave": lambda v: v["a"] * shape}, sd), (effect,))
    belief = GaussianPrior.none(2).joined(1, found)
    assert belief.mean[2] == pytest.approx(found.unit[0])
    assert np.count_nonzero(belief.precision) == 1
    assert belief.precision[2, 2] == pytest.approx(1 / (4 * found.covariance[0, 0] + 1e-6))
    assert np.count_nonzero(GaussianPrior.none(2).joined(1).precision) == 0


def test_evidence_does_not_lead_an_effect_out_of_its_range(linear, candidate, data) -> None:
    """At a bound the residual still slopes along the effect; a straight line would earn what no value of it can."""
    design, y, _ = data
    shape = np.sin(np.arange(len(y)))
    narrow = candidate("wave", Parameter("a", "1", 0.0, 0.1, null=0.0, default=0.05))
    problem = linear(y + 8 * shape, design, {"wave": lambda v: v["a"] * shape}, np.full(3, 10.0))
    bound = fit(problem, (narrow,))
    earned = bound.log_evidence(1.0, problem.prior_scales) - fit(problem).log_evidence(1.0, problem.prior_scales)
    assert bound.unit == pytest.approx([1.0])
    assert earned < 0.5 * (fit(problem).chi2 - bound.chi2) + 1


def test_noise_that_goes_together_earns_nothing_by_being_wide() -> None:
    """As one by one it would be jitter; neighbours that are off alike are a wrong response."""
    rng = np.random.default_rng(2)
    times, recording = np.full(400, 3.0), np.repeat([0, 1], 200)
    chance = rng.normal(size=400)
    wrong = np.repeat(rng.normal(size=40), 10)
    earned = 400 * (9.0 - 1.0) - 800 * np.log(3.0)
    assert abs(autocorrelation_penalty(chance, times, recording)) < 0.25 * earned
    assert autocorrelation_penalty(wrong, times, recording) > 0.85 * (
        np.square(wrong) @ (np.square(times) - 1.0) - 800 * np.log(3.0)
    )
    assert autocorrelation_penalty(wrong, None, recording) == 0.0
    # Strong chance earns much: what its neighbours have in common by chance must not cost a share of it.
    strong = np.full(400, 20.0)
    costs = [autocorrelation_penalty(rng.normal(size=400), strong, recording) for _ in range(20)]
    assert sum(cost == 0.0 for cost in costs) > 15


def test_what_is_frozen_is_at_its_mean_wherever_a_fit_begins(linear) -> None:
    """Another law may have left a parameter where this one, which lacks it, must not have it."""
    t = np.linspace(0.0, 1.0, 50)
    problem = linear(2.0 * t, np.column_stack([t, np.ones_like(t)]), sd=np.array([10.0, FROZEN]))
    found = fit(problem, nuisance=np.array([0.5, 0.2]))
    assert found.nuisance == pytest.approx([2.0, 0.0], abs=0.02)
    assert found.penalty < 1.0


def test_a_fit_that_begins_where_the_simulation_diverges_is_a_bad_one_and_no_nan(linear) -> None:
    t = np.linspace(0.0, 1.0, 50)
    problem = linear(2.0 * t, np.column_stack([t, np.ones_like(t)]))
    sound = problem.evaluate

    def evaluate(nuisance, active, want_jacobian=True):
        made = sound(nuisance, active, want_jacobian)
        return replace(made, residual=made.residual * np.inf) if nuisance[0] > 5 else made

    problem.evaluate = evaluate
    lost = fit(problem, nuisance=np.array([6.0, 0.0]))
    assert np.isfinite(lost.log_evidence(1.0, (problem.prior_sd,)))
    assert lost.objective > 1e6 > fit(problem).objective


@pytest.mark.parametrize(("steep", "turns"), [(3, 4), (10, 2), (10, 4)])
def test_a_valley_that_turns_is_followed_to_its_end(linear, steep: float, turns: float) -> None:
    """Two parameters that make up for each other along a sine, as creep times and the amounts that creep do along some
    curve: a step along the straight line climbs its walls, and one that is damped for that gains little."""

    class Valley(linear):
        def evaluate(self, nuisance, active, want_jacobian=True):
            a, b = nuisance
            jacobian = np.array([[-turns * steep * np.cos(a), steep], [1.0, 0.0]])
            predicted = np.array([steep * (b - turns * np.sin(a)), a])
            return Evaluation(self.measured - predicted, jacobian if want_jacobian else np.zeros((0, 0)))

    valley = Valley(np.array([0.0, 4.0]), np.zeros((2, 2)))
    found = fit(valley, nuisance=np.array([-3.0, turns * np.sin(-3.0)]), iterations=60, tolerance=1e-5)
    assert found.nuisance == pytest.approx([4.0, turns * np.sin(4.0)], abs=0.1)
    assert found.objective < 0.01
    assert found.simulations < 200


def test_a_fit_that_is_stuck_has_no_evidence_of_the_gain_that_a_line_promises(linear) -> None:
    """A leak for a while (chi2 407207) outdid a wrong unit (26656): a straight line would have led it to the noise."""
    rng = np.random.default_rng(4)
    basis = rng.normal(size=(300, 2))
    problem = linear(basis @ [30.0, -20.0] + rng.normal(size=300), basis, {}, np.full(2, 50.0))
    found = fit(problem)
    assert found.chi2 < 400
    begin = problem.evaluate(np.zeros(2), {}).residual
    stuck = replace(found, nuisance=np.zeros(2), residual=begin, chi2=float(begin @ begin), penalty=0.0)
    assert found.log_evidence(1.0, (found.prior_sd,)) > stuck.log_evidence(1.0, (found.prior_sd,)) + 0.4 * stuck.chi2


def test_a_fit_under_one_law_tells_nothing_of_another(linear) -> None:
    """Of inverse Langevin skin with a tether a null of chi2 23700 outdid one of 4270: a straight line took the chains
    away again, and a discrepancy that it was never fitted with repaired the rest."""
    rng = np.random.default_rng(4)
    design = rng.normal(size=(200, 2))
    own, other = np.array([1.0, FROZEN]), np.array([FROZEN, 1.0])
    problem = linear(design @ [0.8, 0.5] + rng.normal(size=200), design, {}, own)
    problem.law_parameters = 1
    found = fit(problem)
    assert found.evidences(1.0, (own, other)) == pytest.approx([found.log_evidence(1.0, (own,)), NOWHERE])
    assert found.best_prior((other, own)) is own
    # A parameter that was not moved may be frozen, and so may one of no law.
    assert np.all(fit(linear(rng.normal(size=200), np.zeros((200, 2)), {}, own)).evidences(1.0, (other,)) > NOWHERE)
    problem.law_parameters = 0
    assert fit(problem).evidences(1.0, (other,)) > NOWHERE
