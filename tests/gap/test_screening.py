"""The screening: where it looks, and what it sees through several widths of the nuisance's prior."""

from __future__ import annotations

import numpy as np
import pytest

from gap.rhythms import lines
from gap.screening import grid, screen
from gap.solve import Hypothesis, fit
from sim_devices.chain import Parameter

T = np.linspace(0.0, 1.0, 400)


def test_the_grid_surrounds_a_value_that_does_nothing(candidate) -> None:
    signed = candidate("a", Parameter("a", "1", -2.0, 2.0))
    values = [signed.values(u)["a"] for u in grid(signed)]
    assert min(values) < 0 < max(values)
    assert min(abs(v) for v in values) < 0.05


def test_lines_of_a_residual_are_found() -> None:
    rng = np.random.default_rng(0)
    time = np.sort(rng.uniform(0, 200, 1500))
    residual = np.sin(2 * np.pi * 1.13 * time) + rng.normal(size=len(time))
    assert lines(time, residual, 0.15, 2.0)[0] == pytest.approx(1.13, abs=0.01)


def test_what_a_wide_prior_swallows_is_seen_through_a_narrow_one(linear, candidate) -> None:
    wave = np.sin(9 * T)
    design = np.column_stack([np.ones_like(T), wave + 0.02 * T])  # nuisance that can nearly do what the effect does
    y = 3 * wave + np.random.default_rng(1).normal(size=len(T))
    wide, narrow = np.array([10.0, 10.0]), np.array([10.0, 0.01])
    problem = linear(y, design, {"wave": lambda v: v["a"] * wave, "none": lambda v: v["a"] * np.cos(40 * T)}, wide)
    problem.alternatives = (wide, narrow)
    known = [candidate(n, Parameter("a", "1", -30.0, 30.0)) for n in ("wave", "none")]
    base = Hypothesis((), {"linear": fit(problem)})
    found, _ = screen({"linear": problem}, base, known)
    first = found[0]
    assert first.candidate.name == "wave"
    assert first.gain > 1.0
    assert first.widths["linear"] is narrow
