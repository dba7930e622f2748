"""Windows of an event that multiplies a signal about nought are found though nuisance hides part of it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from gap.data.rhythms import spells
from gap.inference.evidence import Hypothesis
from gap.inference.least_squares import fit
from gap.search.starts import starting_points
from gap.search.windows import answered, to_the_end
from sim_devices.chain import FloatArray, Parameter
from sim_devices.effects.build import for_a_while
from tests.gap.conftest import LinearProblem, candidate

TIME = np.arange(600.0)
SIGNAL = 10.0 * np.sin(2 * np.pi * TIME / 25.0)
BEGIN, LENGTH = 310.0, 60.0


def tone(values: Mapping[str, float]) -> FloatArray:
    begin, length = values["moment"], values["duration"]
    return np.asarray(values["change"] * SIGNAL * ((begin <= TIME) & (begin + length > TIME)))


@pytest.fixture
def stiffer() -> LinearProblem:
    """A signal whose size is free, and is another for a minute."""
    acts = tone({"change": 0.3, "moment": BEGIN, "duration": LENGTH})
    noise = np.random.default_rng(50002).normal(size=600)
    return LinearProblem(2.0 * SIGNAL + acts + noise, SIGNAL[:, None], {"tone": tone}, runs=2)


def test_a_window_is_told_by_what_the_effect_would_change(stiffer: LinearProblem) -> None:
    base = fit(stiffer)
    begin, length = answered(base, stiffer.rows, SIGNAL)
    assert begin == pytest.approx(BEGIN, abs=3.0)
    assert length == pytest.approx(LENGTH, abs=8.0)
    by_level = spells(TIME, base.residual, stiffer.rows.recording)
    assert all(abs(b - BEGIN) > 8.0 or abs(n - LENGTH) > 8.0 for b, n in by_level)


def test_the_screening_looks_there(stiffer: LinearProblem) -> None:
    event = candidate("tone", Parameter("change", "1", -0.6, 0.6, default=0.2), *for_a_while(), block="linear")
    points, _ = starting_points(event, {"linear": stiffer}, Hypothesis((), {"linear": fit(stiffer)}))
    found = [event.values(p) for p in points]
    assert any(abs(v["moment"] - BEGIN) < 3.0 and abs(v["duration"] - LENGTH) < 8.0 for v in found)


def test_lost_samples_are_looked_for_where_all_is_ahead_until_the_end() -> None:
    """One sample of 10 ms, lost on the way: the residual is the signal's speed, of no level, to the recording's end."""

    def ahead(values: Mapping[str, float]) -> FloatArray:
        end = 300.0 if values["moment"] < 300.0 else 600.0
        return np.asarray(values["lost"] * SIGNAL * ((values["moment"] <= TIME) & (end > TIME)))

    y = ahead({"lost": 0.3, "moment": 170.0}) + np.random.default_rng(50004).normal(size=600)
    problem = LinearProblem(y, np.ones((600, 1)), {"loss": ahead}, runs=2)
    burst = Parameter("lost", "s", 2e-3, 3.0, 0.0, 0.2, "log"), Parameter("moment", "s", 1.0, 3600.0, None, 10.0, "log")
    event = candidate("loss", *burst, block="linear")
    points, _ = starting_points(event, {"linear": problem}, Hypothesis((), {"linear": fit(problem)}))
    assert min(abs(event.values(p)["moment"] - 170.0) for p in points) < 8.0


def test_two_moments_of_one_recording_are_looked_at() -> None:
    """The gain has a peak at each: where the nuisance has taken on much of a burst, the right one was the second, and
    only the first was tried (a burst of .32 s of a camera, unknown; now .93)."""
    acts = SIGNAL * (0.5 * (TIME >= 380.0) + 0.8 * (TIME >= 520.0))
    noise = np.random.default_rng(50003).normal(size=600)
    problem = LinearProblem(2.0 * SIGNAL + acts + noise, SIGNAL[:, None], {"tone": tone}, runs=2)
    assert {round(m, -1) for m in to_the_end(fit(problem), problem.rows, SIGNAL)[:3]} >= {380.0, 520.0}
