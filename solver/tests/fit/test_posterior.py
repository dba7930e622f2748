"""Posteriors against closed forms and against each other, and what they say where they failed."""

from __future__ import annotations

import json
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recovery import Recording
from scipy import integrate

from skinrig_solver.api import Array
from skinrig_solver.fit import FitResult, SpecError, read_spec
from skinrig_solver.fit import sampling as sampling_module
from skinrig_solver.fit.cases import cases
from skinrig_solver.fit.posterior import posterior
from skinrig_solver.fit.priors import log_prior
from skinrig_solver.fit.problem import Problem
from skinrig_solver.fit.run import fit
from skinrig_solver.fit.sampling import log_evidence, sample, split_rhat
from skinrig_solver.fit.surrogate import emulated
from skinrig_solver.fit.target import Emulated, Noise, Target
from skinrig_solver.fit.variables import Free

Record = Callable[..., Recording]
TRUTH = {"a": 1e-4, "b": 2e-5, "c": 6e-5, "tau": 1.5}
MEAN, COVARIANCE = np.array([1.0, -2.0, 0.5]), np.array([[1.0, 0.7, 0.0], [0.7, 2.0, 0.3], [0.0, 0.3, 0.5]])


def normal(z: Array) -> Array:
    off = z - MEAN
    return -0.5 * np.einsum("bi,ij,bj->b", off, np.linalg.inv(COVARIANCE), off)


def test_draws_from_a_normal_density_are_normal() -> None:
    starts = np.random.default_rng(0).standard_normal((100, 3)) * 3.0
    chain = sample(normal, starts, seed=1)
    assert chain.converged
    assert chain.effective > 1000
    assert chain.draws.mean(axis=0) == pytest.approx(MEAN, abs=0.12)
    assert np.cov(chain.draws.T) == pytest.approx(COVARIANCE, abs=0.2)
    value, error = log_evidence(normal, chain.draws, seed=2)
    exact = 0.5 * np.log(np.linalg.det(2.0 * np.pi * COVARIANCE))
    assert abs(value - exact) < max(4.0 * error, 0.02)
    assert error < 0.05


def test_humps_far_apart_are_drawn_by_their_weight() -> None:
    """Walkers begin half and half; the humps, ten deviations apart, hold 80 and 20 %."""

    def humps(z: Array) -> Array:
        off = z[:, None, :] - np.array([[-5.0, 0.0], [5.0, 0.0]])
        return np.asarray(np.logaddexp(*(-0.5 * (off**2).sum(axis=2) + np.log([0.8, 0.2])).T))

    starts = np.random.default_rng(0).standard_normal((200, 2))
    starts[:, 0] += np.where(np.arange(200) % 2, 5.0, -5.0)
    chain = sample(humps, starts, seed=1)
    assert chain.converged
    assert (chain.draws[:, 0] > 0.0).mean() == pytest.approx(0.2, abs=0.03)


def test_a_chain_that_is_too_short_is_not_called_converged() -> None:
    far = 1e3 + np.random.default_rng(0).standard_normal((40, 3))
    assert not sample(normal, far, seed=0, most=80).converged
    parts = np.random.default_rng(1).standard_normal((4, 100, 8, 1))
    assert split_rhat(parts)[0] < 1.02
    parts[0] += 2.0
    assert split_rhat(parts)[0] > 1.2


@pytest.mark.parametrize(
    "prior",
    [
        None,
        {"normal": {"mean": 3.0, "sd": 0.5}},
        {"lognormal": {"median": 3.0, "factor": 1.5}},
        {"uniform": {"lower": 1, "upper": 4}},
    ],
)
@pytest.mark.parametrize("log", [True, False])
def test_a_prior_integrates_to_one_over_the_coordinate(prior: Any, log: bool, dashpot: Any) -> None:
    spec = read_spec(
        {
            "model": "dashpot",
            "parameters": {
                "tau": {"start": 2.0, "lower": 0.5, "upper": 20, "scale": "log" if log else "linear"}
                | ({"prior": prior} if prior else {})
            },
        },
        dashpot.info,
    )
    (free,) = spec.variables(dashpot.info).free
    low, high = free.coordinate(free.lower), free.coordinate(free.upper)
    edges = [free.coordinate(x) for x in (1.0, 4.0)]
    mass = integrate.quad(
        lambda z: float(np.exp(log_prior(free, np.array([z]))[0])), low, high, points=edges, limit=200
    )[0]
    assert mass == pytest.approx(1.0, abs=1e-6)
    assert log_prior(free, np.array([high + 0.1]))[0] == -np.inf


@pytest.mark.parametrize(
    ("prior", "words"),
    [
        ({"gauss": {"mean": 1, "sd": 1}}, "a prior is one of normal, lognormal, uniform"),
        ({"normal": {"mean": 1}}, "normal needs mean and sd"),
        ({"normal": {"mean": 1, "sd": -1}}, "sd -1.0 must be positive"),
        ({"lognormal": {"median": 1, "factor": 0.5}}, "median 1.0 must be positive and factor 0.5 above 1"),
        ({"uniform": {"lower": 2, "upper": 1}}, "lower 2.0 is not below upper 1.0"),
        ({"normal": {"mean": "3 kPa", "sd": 1}}, "'3 kPa' is not a number in"),
        ({"uniform": {"lower": 200, "upper": 300}}, "no probability between"),
    ],
)
def test_faults_of_a_prior_name_the_parameter(prior: Any, words: str, dashpot: Any) -> None:
    with pytest.raises(SpecError, match=r"parameters\.tau: ") as caught:
        read_spec({"model": "dashpot", "parameters": {"tau": {"prior": prior}}}, dashpot.info)
    assert words in str(caught.value)


def test_a_linear_model_has_the_posterior_of_the_closed_form(dashpot: Any, record: Record) -> None:
    """b and c enter linearly: with normal priors the posterior is normal, and so is its evidence known."""
    prior = {"b": (1e-5, 4e-6), "c": (5e-5, 3e-6)}
    free: dict[str, Any] = {n: {"start": m, "prior": {"normal": {"mean": m, "sd": s}}} for n, (m, s) in prior.items()}
    known = {"zero": "fixed", "parameters": {"a": 1e-4, "tau": 1.5, **free}}
    spec = read_spec({"model": "dashpot", **known}, dashpot.info)
    problem = Problem(dashpot, cases([record(TRUTH, noise=0.3)], spec, dashpot.info), spec.variables(dashpot.info))
    noise = Noise((4e-5,), (1.0,))
    here = problem.evaluate(problem.variables.start)
    found = posterior(problem, problem.variables.start, noise)
    result, data = here.results[0], problem.cases[0].data["apex_height"]
    values = dashpot.info.defaults | {"a": 1e-4, "tau": 1.5} | {n: m for n, (m, _) in prior.items()}
    slopes = dashpot.simulate(problem.cases[0].experiment, values, ["b", "c"]).sensitivities["apex_height"]
    mean, sd = (np.array([p[i] for p in prior.values()]) for i in (0, 1))
    rest = data - result.channels["apex_height"] + slopes @ (np.array([values["b"], values["c"]]) - mean)
    covariance = np.linalg.inv(slopes.T @ slopes / 4e-5**2 + np.diag(sd**-2.0))
    exact = mean + covariance @ slopes.T @ rest / 4e-5**2
    deviation = np.sqrt(np.diag(covariance))
    assert found.trusted
    for k, marginal in enumerate(found.marginals):
        assert marginal.mean == pytest.approx(exact[k], abs=0.1 * deviation[k])
        assert marginal.deviation == pytest.approx(deviation[k], rel=0.08)
        assert marginal.laplace_value == pytest.approx(exact[k], abs=0.02 * deviation[k])
        assert marginal.laplace_deviation == pytest.approx(deviation[k], rel=0.01)
        assert marginal.interval == pytest.approx(
            exact[k] + 1.96 * deviation[k] * np.array([-1, 1]), abs=0.25 * deviation[k]
        )
    # evidence: the data are normal with covariance noise + slopes prior slopesᵀ
    total = slopes @ np.diag(sd**2) @ slopes.T + 4e-5**2 * np.eye(data.size)
    log_z = -0.5 * (rest @ np.linalg.solve(total, rest) + np.linalg.slogdet(2.0 * np.pi * total)[1])
    assert found.log_evidence[0] == pytest.approx(log_z, abs=0.05)
    assert found.log_evidence[2] == pytest.approx(log_z, abs=0.05)


@pytest.fixture(scope="module")
def found(dashpot: Any, record: Record) -> FitResult:
    spec = {"parameters": {"a": {"start": 3e-4}, "b": {"start": 1e-4}, "c": {"start": 2e-5}, "tau": {"start": 0.4}}}
    return fit([record(TRUTH)], spec, model=dashpot, posterior=True)


def test_mcmc_and_laplace_agree_where_curves_are_nearly_linear(found: FitResult) -> None:
    assert found.posterior is not None
    assert found.posterior.trusted
    assert not found.posterior.warnings
    for marginal, estimate in zip(found.posterior.marginals, found.estimates, strict=True):
        assert marginal.deviation == pytest.approx(marginal.laplace_deviation, rel=0.12)
        assert marginal.deviation == pytest.approx(estimate.standard_error, rel=0.2)
        assert abs(marginal.mean - TRUTH[estimate.free.symbol]) < 4.0 * marginal.deviation
        low, high = marginal.profile_interval
        assert (high - low) == pytest.approx(2 * 1.96 * marginal.deviation, rel=0.15)
        assert marginal.rhat < 1.01


def test_the_emulator_stays_within_its_error_and_says_what_it_cost(found: FitResult) -> None:
    assert found.posterior is not None
    check = found.posterior.check
    assert check.good
    assert check.curve_error < 0.1
    assert found.posterior.full_solves < 60
    assert found.posterior.evaluations > 1000 * found.posterior.full_solves
    assert found.posterior.microseconds < 1000.0


def test_bands_hold_the_data_as_often_as_they_say(found: FitResult) -> None:
    assert found.posterior is not None
    curve, band = found.curves[0], found.posterior.bands[0]
    inside = np.mean((curve.data >= band[0]) & (curve.data <= band[2]))
    assert 0.92 < inside < 0.98
    assert np.all(band[0] < band[1])
    assert np.all(band[1] < band[2])


def test_page_and_json_hold_the_posterior(found: FitResult, tmp_path: Path) -> None:
    data = json.loads(json.dumps(found.as_dict()))["posterior"]
    assert data["trusted"]
    assert data["mcmc"]["converged"]
    assert len(data["draws"]) >= 400
    assert [p["prior"] for p in data["parameters"]] == ["flat between the bounds"] * 4
    page = found.write_page(tmp_path / "fit.html").read_text()
    assert "<h2>Posterior</h2>" in page
    assert "posterior: 2000 draws" in found.in_words()


def test_beyond_its_region_the_full_model_answers_and_is_counted(
    found: FitResult, dashpot: Any, record: Record
) -> None:
    spec = read_spec(
        {"model": "dashpot", "parameters": {"b": "free", "c": "free"} | {"a": 1e-4, "tau": 1.5}}, dashpot.info
    )
    problem = Problem(dashpot, cases([record(TRUTH, noise=0.3)], spec, dashpot.info), spec.variables(dashpot.info))
    target = Target(problem, Noise((4e-5,), (1.0,)))
    emulator, draws, _ = emulated(target, problem.variables.start, 0, lambda _: None)
    tight = replace(emulator, region=replace(emulator.region, upper=draws.mean(axis=0)))
    density, before = Emulated(target, tight, strict=False), target.full_solves
    beyond = draws[~tight.inside(draws)][:5]
    values = density(np.concatenate([draws[tight.inside(draws)][:5], beyond]))
    assert (target.beyond, target.full_solves - before) == (5, 5)
    assert values[5:] == pytest.approx(Emulated(target, emulator, strict=True)(beyond), abs=0.3)
    assert np.all(Emulated(target, tight, strict=True)(beyond) == -np.inf)


def test_a_posterior_that_did_not_converge_says_so(
    monkeypatch: pytest.MonkeyPatch, dashpot: Any, record: Record
) -> None:
    spec = read_spec({"model": "dashpot", "parameters": {"b": "free", "c": "free"}}, dashpot.info)
    problem = Problem(dashpot, cases([record(TRUTH)], spec, dashpot.info), spec.variables(dashpot.info))
    monkeypatch.setattr(sampling_module, "LENGTHS", 1e9)
    monkeypatch.setattr(sampling_module, "MOST", 300)
    monkeypatch.setattr("skinrig_solver.fit.posterior.sample", lambda *a: sample(*a, most=300))
    late = posterior(problem, problem.variables.start, Noise((2e-6,), (1.0,)))
    assert not late.trusted
    assert "did not converge: R-hat" in late.warnings[0]
    assert not late.as_dict()["mcmc"]["converged"]


def test_the_posterior_is_the_same_whoever_runs_the_model(dashpot: Any, record: Record) -> None:
    spec = read_spec({"model": "dashpot", "parameters": {"b": "free", "c": "free"}}, dashpot.info)
    problem = Problem(dashpot, cases([record(TRUTH)], spec, dashpot.info), spec.variables(dashpot.info))
    noise = Noise((2e-6,), (1.0,))
    alone = posterior(problem, problem.variables.start, noise)
    with ThreadPoolExecutor(2) as pair:
        shared = posterior(problem, problem.variables.start, noise, executor=pair)
    assert np.array_equal(alone.draws, shared.draws)
    assert alone.check == shared.check
    assert alone.full_solves == shared.full_solves


def test_a_model_object_needs_no_registration(dashpot: Any, record: Record) -> None:
    assert fit([record(TRUTH)], {"parameters": {"a": "free"}}, model=dashpot).info.name == "dashpot"
    assert Free("a", 1.0, 0.5, 2.0, True).prior is None
