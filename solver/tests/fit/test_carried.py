"""Errors of parameters that a hardly known one carries along, further to one side than its derivative shows."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from recovery import ALL, distance

from skinrig_solver import Parameter
from skinrig_solver.fit import FitResult
from skinrig_solver.fit import run as run_module
from skinrig_solver.fit.statistics import doubts

TRUTH = {"k": 1.0, "b": 0.02}


def soft(p: Mapping[str, float], s: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """(k + b) s + ln(b) cos(9 s) / 1000: b is known to a factor, k goes along with its value."""
    wave = 1e-3 * np.cos(9.0 * s)
    return (p["k"] + p["b"]) * s + np.log(p["b"]) * wave, {"k": s, "b": s + wave / p["b"]}


@pytest.fixture
def fitted(curve: Callable[..., Any]) -> Callable[[int], FitResult]:
    model = curve(
        soft,
        Parameter("k", "m", 0.1, 10.0, 1.0, "slope", "test"),
        Parameter("b", "m", 1e-6, 10.0, 0.1, "softness", "test", "log"),
    )
    return lambda seed: model.fit(TRUTH, 0.02, seed, parameters={"k": "free", "b": "free"})


def off(result: FitResult) -> float:
    return abs(distance(result.estimates[0], TRUTH["k"]))


def test_the_value_of_a_hardly_known_parameter_carries_others_beyond_their_straight_errors(
    fitted: Callable[[int], FitResult], monkeypatch: pytest.MonkeyPatch
) -> None:
    walked = {seed: fitted(seed) for seed in range(20)}
    known = [seed for seed, result in walked.items() if result.estimates[0].identifiable]
    assert len(known) >= 6
    assert max(off(result) for result in walked.values()) < 3.0
    monkeypatch.setattr(run_module, "traced", lambda problem, optimum, known: known)
    straight = {seed: fitted(seed) for seed in walked}
    assert max(off(straight[seed]) for seed in known) > 4.0
    for seed, result in straight.items():
        assert result.estimates[0].value == walked[seed].estimates[0].value
        assert result.estimates[0].standard_error <= walked[seed].estimates[0].standard_error
        assert walked[seed].effort.forward_runs <= result.effort.forward_runs + 6


def test_a_soft_layer_known_to_a_factor_does_not_hide_in_the_error_of_the_skin() -> None:
    """Cutometer, plastic skin: SMAS from 0.1 to 15 kPa explains the curve, the skin's modulus falling by 6 % with it.

    By the straight error, 0.5 %, the truth was 3.06 standard errors off.
    """
    setting = next(s for s in ALL if s.name == "cutometer plastic")
    errors = setting.errors(setting.run(4, 0.02, 0.5))
    assert set(errors) == {"skin.mu0", "skin.r2"}
    assert max(abs(x) for x in errors.values()) < 1.5


def test_an_error_far_beyond_a_value_is_not_told_to_the_digit() -> None:
    """A relaxation of which nothing was known was "too uncertain (±3409813 %)"."""
    found = [
        SimpleNamespace(free=SimpleNamespace(symbol=name), value=1.0, standard_error=error, at="")
        for name, error in (("G", 0.96), ("g2", 34098.0), ("c10", 1e-3))
    ]
    assert doubts(found) == ["too uncertain to be called identified: G (±96 %), g2 (over ±1000 %)"]  # type: ignore[arg-type]
