"""A plan's promise is kept by the measurement."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from recovery import Recording

from skinrig_solver import Experiment
from skinrig_solver.fit.plan import Candidate, known, plan
from skinrig_solver.fit.run import fit

TRUTH = {"a": 1e-4, "b": 2e-5, "c": 6e-5, "tau": 1.5}
FREE = {"a": {"start": 3e-4}, "b": {"start": 1e-4}, "c": {"start": 2e-5}, "tau": {"start": 0.4}}


def candidate(name: str, pressure: Callable[[Any], Any], seconds: float) -> Candidate:
    time = np.linspace(0.0, seconds, 401)
    return Candidate(name, Experiment("cutometer", time, {"pressure": pressure(time)}), seconds / 60.0)


@pytest.fixture(scope="module")
def before(dashpot: Any, record: Callable[..., Recording]) -> dict[str, Any]:
    return fit([record(TRUTH)], {"parameters": FREE}, model=dashpot).as_dict()


def test_repeating_the_measurement_halves_the_variance(dashpot: Any, record: Any, before: dict[str, Any]) -> None:
    drive = record(TRUTH).streams["pressure"]
    same = candidate("same", lambda t: np.interp(t, drive.time, drive.value), 20.0)
    (gain,) = plan(dashpot, known(before), [same], "tau")
    assert gain.narrowing == pytest.approx(1.0 - np.sqrt(0.5), abs=0.03)
    both = fit([record(TRUTH), record(TRUTH, seed=1)], {"parameters": FREE}, model=dashpot)
    assert gain.deviation == pytest.approx(both.estimates[3].standard_error, rel=0.15)
    assert gain.per_minute == pytest.approx(0.5 * np.log(2.0) * 3.0, rel=0.1)


def test_steps_tell_a_time_constant_and_slow_ramps_do_not(dashpot: Any, before: dict[str, Any]) -> None:
    step = candidate("step", lambda t: np.where(t > 1.0, -3e4, 0.0), 20.0)
    ramp = candidate("ramp", lambda t: -3e4 * t / 600.0, 600.0)
    gains = plan(dashpot, known(before), [ramp, step], "tau")
    assert [g.name for g in gains] == ["step", "ramp"]
    assert gains[0].per_minute > 5.0 * gains[1].per_minute


def test_what_cannot_be_run_is_said_and_comes_last(dashpot: Any, before: dict[str, Any]) -> None:
    step = candidate("step", lambda t: np.where(t > 1.0, -3e4, 0.0), 20.0)
    broken = {
        **before,
        "parameters": [{**row, "value": 5e-2} if row["symbol"] == "a" else row for row in before["parameters"]],
    }
    (gain,) = plan(dashpot, known(broken), [step], "tau")
    assert "it broke" in gain.trouble
    assert gain.narrowing == 0.0


def test_faults_are_named(dashpot: Any, before: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"'G' was not free in this fit; free were a, b, c, tau"):
        plan(dashpot, known(before), [], "G")
    with pytest.raises(ValueError, match="not the data of a fit"):
        known({"schema": "x"})


def test_an_unknown_parameter_is_as_wide_as_its_bounds(before: dict[str, Any]) -> None:
    blind = {
        **before,
        "covariance": [
            [None if 3 in (i, j) else x for j, x in enumerate(row)] for i, row in enumerate(before["covariance"])
        ],
    }
    width = before["parameters"][3]["bounds"]
    assert known(blind).covariance[3, 3] == pytest.approx((width[1] - width[0]) ** 2 / 12.0)
