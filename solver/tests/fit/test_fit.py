"""Whole fits of a model whose answers are known."""

from __future__ import annotations

import json
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
from recovery import Recording

from skinrig_solver.fit import FitError, FitResult, Progress, SpecError, read_spec
from skinrig_solver.fit.cases import cases
from skinrig_solver.fit.problem import Problem
from skinrig_solver.fit.run import fit

Record = Callable[..., Recording]
TRUTH = {"a": 1e-4, "b": 2e-5, "c": 6e-5, "tau": 1.5}
START = {"a": {"start": 3e-4}, "b": {"start": 1e-4}, "c": {"start": 2e-5}, "tau": {"start": 0.4}}


@pytest.fixture(autouse=True)
def _known(named: Callable[..., None], dashpot: Any) -> None:
    """Specifications may name the test's model."""
    named(dashpot.info)


@pytest.fixture
def run(dashpot: Any, record: Record) -> Callable[..., FitResult]:
    def go(
        runs: list[Recording] | None = None, /, executor: Any = None, progress: Any = None, **spec: Any
    ) -> FitResult:
        spec = {"parameters": START, **spec}
        return fit(runs or [record(TRUTH)], spec, model=dashpot, executor=executor, progress=progress)

    return go


Run = Callable[..., FitResult]


def values(result: FitResult) -> dict[str, float]:
    return {e.free.symbol: e.value for e in result.estimates}


def test_jacobian_is_that_of_the_residual(dashpot: Any, record: Record) -> None:
    spec = read_spec({"model": "dashpot", "parameters": START | {"twin": {"tied": "c", "factor": 0.5}}})
    variables = spec.variables(dashpot.info)
    problem = Problem(dashpot, cases([record(TRUTH), record(TRUTH, seed=1)], spec, dashpot.info), variables)
    z = variables.start
    exact = problem.evaluate(z).jacobian
    assert exact is not None
    for k in range(z.size):
        step = np.zeros(z.size)
        step[k] = 1e-6
        differences = (problem.evaluate(z + step).residual - problem.evaluate(z - step).residual) / 2e-6
        assert exact[:, k] == pytest.approx(differences, abs=1e-6 * np.abs(exact[:, k]).max())


@pytest.mark.parametrize("optimiser", ["trust-region", "slsqp", "nelder-mead"])
def test_every_optimiser_finds_the_same_place(run: Run, optimiser: str) -> None:
    result = run(optimiser=optimiser)
    assert result.converged
    assert result.vaf > 0.999
    reference = run()
    for e in reference.estimates:
        assert values(result)[e.free.symbol] == pytest.approx(e.value, abs=0.1 * e.standard_error)
    assert (result.effort.forward_runs > 100) == (optimiser == "nelder-mead")


def test_truth_lies_within_three_standard_errors_as_often_as_it_should(run: Run, record: Record) -> None:
    distances = []
    for seed in range(20):
        result = run([record(TRUTH, seed=seed)])
        assert all(e.identifiable for e in result.estimates)
        distances += [(e.value - TRUTH[e.free.symbol]) / e.standard_error for e in result.estimates]
    assert np.abs(distances).max() < 4.0
    assert 0.75 < np.std(distances) < 1.3


def test_standard_errors_do_not_depend_on_how_a_fit_weighs(run: Run, record: Record) -> None:
    one, two = record(TRUTH, noise=0.002), record(TRUTH, noise=0.05, seed=1, instrument="aspiration")
    for weight in (1e-3, 1e3):
        result = run([one, two], recordings={"aspiration": {"weight": weight}})
        alone = run([two if weight > 1 else one])
        for mine, own in zip(result.estimates, alone.estimates, strict=True):
            assert mine.standard_error == pytest.approx(own.standard_error, rel=0.1)


def test_what_cannot_be_told_apart_is_said(run: Run) -> None:
    result = run(parameters={"a": "free", "twin": {"start": 1e-5}, "tau": 1.5, "c": 6e-5, "b": 2e-5})
    assert not any(e.identifiable for e in result.estimates)
    assert any("say nothing about a and twin" in w or "cannot be told apart" in w for w in result.warnings)


def test_a_bound_that_was_hit_is_said_and_held(run: Run) -> None:
    result = run(parameters=START | {"tau": {"start": 0.4, "upper": 0.8}})
    tau = result.estimates[3]
    assert (tau.at, tau.identifiable) == ("upper", False)
    assert np.isnan(tau.standard_error)
    assert any(w.startswith("tau ended on its upper bound, 0.8 s") for w in result.warnings)
    assert all(np.isfinite(e.standard_error) for e in result.estimates[:3])


def test_a_wrong_model_is_called_systematic(run: Run, record: Record) -> None:
    result = run([record(TRUTH, noise=0.001)], parameters={"a": "free", "c": 0.0, "b": 0.0})
    assert any("systematic, not noise" in w for w in result.warnings)
    assert result.curves[0].persistence > 3.0


def test_a_model_that_leaves_more_than_noise_is_not_trusted_and_tries_more_starts(run: Run, record: Record) -> None:
    wrong = {"a": {"start": 1e-4}, "b": -5e-5, "c": 0.0}
    result = run([record(TRUTH, noise=0.001)], parameters=wrong)
    assert not result.trusted
    assert not any(e.identifiable for e in result.estimates)
    assert result.warnings[0].startswith("not to be trusted: the model leaves")
    assert len(result.starts) == 3  # two further ones, which agree
    assert len(run([record(TRUTH, noise=0.001)], parameters=wrong, starts=1).starts) == 1
    assert run().trusted
    assert len(run().starts) == 1


def test_profile_agrees_with_the_linear_theory_where_the_problem_is_linear(run: Run) -> None:
    result = run(profile=["b", "tau"])
    by_name = {e.free.symbol: e for e in result.estimates}
    assert by_name["a"].profile is None
    b = by_name["b"]
    assert b.profile_interval == pytest.approx(b.interval, rel=2e-2)
    low, high = by_name["tau"].profile_interval or (0.0, 0.0)
    assert low < by_name["tau"].value < high


def test_a_profile_without_an_end_is_open(run: Run, record: Record) -> None:
    short = record({"a": 1e-4, "b": 2e-5, "c": 1e-6, "tau": 1.5}, noise=0.05)
    result = run([short], parameters={"a": "free", "c": {"start": 1e-5, "upper": 1e-3}, "tau": "free"}, profile="all")
    tau = next(e for e in result.estimates if e.free.symbol == "tau")
    assert not tau.identifiable


def test_stages_move_what_they_name(run: Run) -> None:
    result = run(stages=["viscous", "elastic", "all"])
    assert [s.split(";")[0] for s in result.stages] == ["viscous: tau", "elastic: a, b, c", "all: a, b, c, tau"]
    assert values(result) == pytest.approx(values(run()), rel=1e-3)
    assert result.estimates[0].free.start == START["a"]["start"]
    with pytest.raises(SpecError, match="stage last: 'twin' is not free"):
        run(stages=[{"name": "last", "free": ["twin"]}])
    with pytest.raises(FitError, match="fits no recording"):
        run(stages=[{"name": "last", "recordings": ["aspiration"]}])


def test_several_starts_end_together_or_are_reported(run: Run) -> None:
    seen: list[Progress] = []
    result = run(starts=4, progress=seen.append)
    assert len(result.starts) == 4
    assert values(result) == pytest.approx(values(run()), rel=1e-3)
    assert seen[-1].forward_runs == result.effort.forward_runs > 20
    with ThreadPoolExecutor(2) as pool:
        again = run(starts=4, executor=pool)
    assert values(again) == pytest.approx(values(result), rel=1e-6)
    assert again.effort.forward_runs == result.effort.forward_runs


def test_recordings_of_two_instruments_are_fitted_together(run: Run, record: Record) -> None:
    both = [record(TRUTH), record(TRUTH, seed=1, instrument="aspiration")]
    with ThreadPoolExecutor(2) as pool:
        result = run(both, executor=pool)
    assert [c.instrument for c in result.curves] == ["cutometer", "aspiration"]
    alone = run(both[:1])
    for mine, one in zip(result.estimates, alone.estimates, strict=True):
        assert mine.standard_error < one.standard_error


def test_steps_to_where_the_model_breaks_are_taken_back(run: Run) -> None:
    result = run(parameters=START | {"a": {"start": 9e-3}})
    assert values(result)["a"] == pytest.approx(values(run())["a"], rel=1e-3)
    with pytest.raises(FitError, match=r"cannot be run at the start: run-0: it broke \(at t = 1 s\)"):
        run(parameters=START | {"a": {"start": 2e-2}}, starts=1)


def test_a_start_at_which_the_model_breaks_is_left_for_others(run: Run) -> None:
    result = run(parameters=START | {"a": {"start": 2e-2}})
    assert result.trusted
    assert values(result)["a"] == pytest.approx(values(run())["a"], rel=1e-3)
    assert any(w.startswith("the model could not be run at ") for w in result.warnings)
    with pytest.raises(FitError, match=r"cannot be run at the start: run-0: it broke"):
        run(parameters=START | {"a": {"start": 0.05, "lower": 0.02, "upper": 0.1}})


def test_tied_parameters_follow(run: Run) -> None:
    result = run(parameters={"a": "free", "b": {"tied": "c", "factor": 1 / 3}, "c": "free", "tau": "free"})
    assert result.parameters["b"] == pytest.approx(result.parameters["c"] / 3)
    assert result.parameters["c"] == pytest.approx(TRUTH["c"], rel=0.1)


def test_an_optimiser_that_ran_out_of_evaluations_says_so(run: Run) -> None:
    result = run(evaluations=2)
    assert not result.converged
    assert result.warnings[0].startswith("the optimiser stopped before it converged")


def test_result_is_plain_json_and_words(run: Run) -> None:
    result = run(profile=["b"], parameters=START | {"tau": {"start": 0.4, "upper": 0.8}})
    data = json.loads(json.dumps(result.as_dict(), allow_nan=False))
    assert data["schema"] == "skinrig-fit/1"
    assert [p["symbol"] for p in data["parameters"]] == ["a", "b", "c", "tau"]
    assert data["parameters"][3]["at_bound"] == "upper"
    assert data["parameters"][3]["standard_error"] is None
    assert len(data["recordings"][0]["channels"]["apex_height"]["residual"]) == 401
    assert "channels" in result.as_dict(curves=False)["recordings"][0]
    assert "at its upper bound" in result.in_words()


def test_a_specification_for_another_model_is_refused(dashpot: Any, record: Record) -> None:
    with pytest.raises(SpecError, match="is for suction_yeoh_qlv, not for dashpot"):
        fit([record(TRUTH)], {"model": "suction_yeoh_qlv", "parameters": START}, model=dashpot)


def test_page_is_whole_and_shows_text_as_text(run: Run, record: Record, tmp_path: Any) -> None:
    result = run([record(TRUTH, id="<script>alert(1)</script>")], profile=["tau"], starts=2)
    page = result.write_page(tmp_path / "fit.html").read_text()
    assert "&lt;script&gt;" in page
    assert "<script" not in page
    assert "http" not in page
    assert page.count("data:image/png;base64,") == 3  # correlations, profile, curves; this model has no mesh


def test_a_curve_without_weight_has_no_vaf(run: Run, record: Record, tmp_path: Any) -> None:
    both = [record(TRUTH), record(TRUTH, seed=1, instrument="aspiration")]
    result = run(both, recordings={"aspiration": {"weight": 0}})
    assert result.curves[0].vaf > 0.999
    assert np.isnan(result.curves[1].vaf)
    assert result.as_dict()["recordings"][1]["channels"]["apex_height"]["vaf"] is None
    assert values(result) == pytest.approx(values(run(both[:1])), rel=1e-3)
    result.write_page(tmp_path / "fit.html")
