"""A fit while the run goes on: trained on set-points beforehand, refined where the data lead."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest

from skinrig_solver.fit.live import Estimate, LiveFit
from skinrig_solver.fit.ranges import RISE, as_curve

STEPS = np.array([0.0, 1.0, 1.0, 5.0, 5.0, 7.0, 9.0, 10.0])  # a jump up and down, then a ramp to another level
SUCTION = -1e4 * np.array([0.0, 0.0, 2.0, 2.0, 0.0, 0.0, 3.0, 3.0])
TRUTH = {"a": 1.5e-4, "b": 3e-5, "c": 8e-5, "tau": 1.6}
Run = Mapping[str, tuple[np.ndarray, np.ndarray]]
Prepared = tuple[LiveFit, Callable[..., Run]]


@pytest.fixture
def prepared(dashpot: Any) -> Prepared:
    """A trained fit, and run(truth, noise=, until=) -> samples of a run of its protocol."""
    fit = LiveFit(dashpot, "cutometer", STEPS, {"pressure": SUCTION}, spec={"parameters": dict.fromkeys(TRUTH, "free")})
    fit.train()

    def run(truth: Mapping[str, float], noise: float = 0.005, until: float = 10.0) -> Run:
        experiment = fit.case.experiment
        height = dashpot.simulate(experiment, truth).channels["apex_height"]
        height = height + noise * height.max() * np.random.default_rng(3).standard_normal(height.size)
        seen = experiment.time <= until
        drive = experiment.drive["pressure"]
        return {"apex_height": (experiment.time[seen], height[seen]), "pressure": (experiment.time[seen], drive[seen])}

    return fit, run


def followed(fit: LiveFit, rounds: int = 12) -> Estimate:
    for _ in range(rounds):
        assert fit.update() is not None
        fit.refine()
    found = fit.update()
    assert found is not None
    return found


def test_a_run_is_followed_and_found(prepared: Prepared) -> None:
    fit, run = prepared
    fit.take(run(TRUTH, until=0.4))
    assert fit.update() is None
    fit.begin()
    fit.take(run(TRUTH, until=4.0))
    early = followed(fit, 4)
    fit.begin()
    fit.take(run(TRUTH))
    late = followed(fit)
    assert early.samples < late.samples
    assert early.errors[3] > late.errors[3]  # the time constant is learnt as time goes by
    for value, error, symbol in zip(late.values, late.errors, late.symbols, strict=True):
        assert abs(value - TRUTH[symbol]) < 3.5 * error
    assert all(late.known)
    assert late.explained > 0.99
    assert late.off < 0.01
    assert late.curves["apex_height"].shape == late.time.shape  # to the end of the protocol


def test_errors_are_those_of_repeated_runs(prepared: Prepared) -> None:
    """Standard errors against the scatter of estimates over noise."""
    fit, run = prepared
    fit.take(run(TRUTH))
    followed(fit)
    clean = run(TRUTH, noise=0.0)
    time, height = clean["apex_height"]
    far = []
    for seed in range(40):
        fit.begin()
        noise = 0.005 * height.max() * np.random.default_rng(seed).standard_normal(height.size)
        fit.take({**clean, "apex_height": (time, height + noise)})
        e = fit.update()
        assert e is not None
        far.append((np.array(e.values) - [TRUTH[s] for s in e.symbols]) / e.errors)
    assert np.all(np.std(far, axis=0) < 1.5)
    assert np.all(np.std(far, axis=0) > 0.6)


def test_a_truth_beyond_the_range_widens_it(prepared: Prepared) -> None:
    fit, run = prepared
    beyond = {**TRUTH, "a": 7e-4}  # trained up to 4e-4
    fit.take(run(beyond))
    first = fit.update()
    assert first is not None
    assert "a" in first.edge
    assert dict(zip(first.symbols, first.rows(), strict=True))["a"][3] == "at the range's end"
    last = followed(fit, 40)
    assert last.values[0] == pytest.approx(7e-4, rel=0.02)
    assert not last.edge


def test_samples_that_did_not_follow_the_command_are_left_out(prepared: Prepared) -> None:
    fit, run = prepared
    whole = run(TRUTH)
    time, height = whole["apex_height"]
    late = (time > 1.0) & (time < 2.0)
    fit.take(
        {
            "apex_height": (time, np.where(late, 0.0, height)),
            "pressure": (time, np.where(late, 0.0, whole["pressure"][1])),
        }
    )
    found = fit.update()
    assert found is not None
    assert np.isnan(found.data["apex_height"][(found.time > 1.05) & (found.time < 1.95)]).all()
    assert np.isfinite(found.data["apex_height"][(found.time > 2.05) & (found.time < 4.9)]).all()


def test_refining_ends_where_the_emulator_is_right(prepared: Prepared) -> None:
    fit, run = prepared
    assert not fit.refine()  # nothing was measured: nothing leads anywhere
    fit.take(run(TRUTH))
    followed(fit)
    assert any(not fit.refine() for _ in range(60))


def test_a_jump_stays_one() -> None:
    time, found = as_curve(STEPS, {"pressure": SUCTION})
    assert time == pytest.approx([0.0, 1.0, 1.0 + RISE, 5.0, 5.0 + RISE, 7.0, 9.0, 10.0])
    assert found["pressure"] == pytest.approx([0.0, 0.0, -2e4, -2e4, 0.0, 0.0, -3e4, -3e4])


def test_what_cannot_be_fitted_says_so(dashpot: Any) -> None:
    with pytest.raises(ValueError, match="not one of a microrobot"):
        LiveFit(dashpot, "microrobot", STEPS, {"pressure": SUCTION})
    fit = LiveFit(dashpot, "cutometer", STEPS, {"pressure": SUCTION}, spec={"parameters": {"a": {"start": "50 mm"}}})
    with pytest.raises(ValueError, match="could be run at 0 of"):
        fit.train(count=8)
    with pytest.raises(ValueError, match="trained before"):
        fit.update()


@pytest.mark.slow
def test_suction_on_finite_elements() -> None:
    """The Cutometer's default live parameters on a coarse mesh: the emulator comes to the full model's curve."""
    coarse = {"mesh": 0.4, "steps": 0.5}
    time = np.array([0.0, 1.0, 1.0, 9.0, 9.0, 12.0])
    suction = -1e4 * np.array([0.0, 0.0, 2.0, 2.0, 0.0, 0.0])
    fit = LiveFit("suction_yeoh_qlv", "cutometer", time, {"pressure": suction}, spec={"geometry": coarse})
    fit.train(count=32)
    truth = {"G": 3.1e4, "c20": 1.5e4, "g1": 0.2, "g2": 0.12, "g3": 0.05}
    experiment = fit.case.experiment
    height = fit.model.simulate(experiment, truth).channels["apex_height"]
    noisy = height + 0.01 * height.max() * np.random.default_rng(1).standard_normal(height.size)
    fit.take({"apex_height": (experiment.time, noisy), "pressure": (experiment.time, experiment.drive["pressure"])})
    found = followed(fit, 10)
    assert found.off < 0.005
    for value, error, symbol in zip(found.values, found.errors, found.symbols, strict=True):
        assert abs(value - truth[symbol]) < 3.5 * error
