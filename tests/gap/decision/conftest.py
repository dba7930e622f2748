"""Verdicts on small linear problems."""

from __future__ import annotations

import numpy as np
import pytest

from gap.decision.thresholds import INSTRUMENT
from gap.decision.verdict import Verdict
from gap.search.compare import compare
from sim_devices.chain import Parameter
from tests.gap.decision.waves import DESIGN, SHAPES, T, judge


@pytest.fixture
def verdict_on(linear, candidate):
    """``verdict_on(names, strengths)``: judge data made with ``strengths``, candidates ``names``."""

    def run(names, strengths, t=INSTRUMENT, marks=(), extra=0.0, seed=0) -> Verdict:
        noise = np.random.default_rng(seed).normal(size=len(T))
        y = DESIGN @ [2.0, 1.0] + sum((a * SHAPES[n] for n, a in strengths.items()), 0 * T) + noise + extra
        effects = {n: (lambda v, n=n: v["a"] * SHAPES[n.split("[")[0]]) for n in names}
        problem = linear(y, DESIGN, effects, np.full(2, 100.0))
        known = [candidate(n, Parameter("a", "1", -30.0, 30.0)) for n in names]
        return judge(compare([problem], known), known, t, marks)

    return run
