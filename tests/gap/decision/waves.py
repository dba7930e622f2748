"""Shapes in time that effects may have, and comparisons in which one of them acts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gap.decision.findings import Findings
from gap.decision.gaps import Shrink
from gap.decision.posterior import posterior
from gap.decision.thresholds import INSTRUMENT, Thresholds
from gap.decision.verdict import Verdict, decide
from gap.search.compare import Comparison, compare
from sim_devices.chain import Parameter

T = np.linspace(0.0, 1.0, 400)
SHAPES = {
    "bump": np.exp(-(((T - 0.3) / 0.05) ** 2)),
    "late": np.exp(-(((T - 0.7) / 0.05) ** 2)),
    "wave": np.sin(40 * T),
    "twin": np.exp(-(((T - 0.3) / 0.0502) ** 2)),
}
DESIGN = np.column_stack([np.ones_like(T), T])


def judge(comparison: Comparison, known, t: Thresholds = INSTRUMENT, marks=(), **tests) -> Verdict:
    """The verdict with all of a cause's ``tests`` passed but those given."""
    return decide(Findings(posterior(comparison, known, t, marks), t, **tests))


def total(v: Verdict) -> float:
    return v.posterior.none + sum(c.probability for c in v.causes) + v.posterior.outside


def taking(share: float) -> Shrink:
    """A gap of 2 of which ``share`` of what lies above the noise goes."""
    return Shrink(2.0, 2.0 - share)


def weak_wave(linear, candidate, strength: float, *more: Parameter, event: bool = False):
    """A comparison and its candidate, where a wave acts."""
    noise = np.random.default_rng(0).normal(size=len(T))
    y = DESIGN @ [2.0, 1.0] + strength * SHAPES["wave"] / 5 + noise
    problem = linear(y, DESIGN, {"wave": lambda v: v["a"] * SHAPES["wave"]}, np.full(2, 100.0))
    known = [replace(candidate("wave", Parameter("a", "1", -60.0, 60.0, 0.0), *more), event=event)]
    return compare([problem], known), known
