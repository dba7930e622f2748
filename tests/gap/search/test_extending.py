"""An effect that becomes the best one in a limit of its parameters is fitted from there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from gap.inference.evidence import Fit
from gap.inference.hypothesis import Candidate
from gap.search.compare import Effort, compare
from sim_devices.chain import Parameter
from tests.gap.conftest import LinearProblem

TIME = np.linspace(0.0, 1.0, 400)
PACE = Parameter("pace", "1", 20.0, 400.0, null=None, default=40.0)
SHARE = Parameter("share", "1", -3.0, 3.0)


@pytest.mark.parametrize("extends", [True, False])
def test_it_begins_where_the_best_effect_is(candidate: Callable[..., Candidate], extends: bool) -> None:
    """A coil's soft limit whose integral runs on in part was told the soft limit alone: of both parameters no point of
    the screening was near."""

    def wave(v) -> np.ndarray:
        return 6.0 * np.sin(v["pace"] * TIME) + v.get("share", 0.0) * np.cos(v["pace"] * TIME)

    data = wave({"pace": 217.3, "share": 2.0}) + np.random.default_rng(0).normal(size=len(TIME))
    problem = LinearProblem(data, np.ones((len(TIME), 1)), {"simple": wave, "whole": wave})
    simple = candidate("simple", replace(PACE, low=216.0, high=219.0))
    whole = replace(candidate("whole", PACE, SHARE), extends=("simple",) if extends else ())
    effort = replace(Effort(), anew=0, pair_bases=0, quick_fits=0, far_fits=0)
    found = compare([problem], [simple, whole], effort)
    left = {h.name: h.fits["linear"].chi2 / len(TIME) for h in found.hypotheses}
    assert left["simple"] > 1.4
    assert (left.get("whole", np.inf) < 1.2) is extends


def test_an_effect_that_does_not_do_its_name_is_no_hypothesis(candidate: Callable[..., Candidate]) -> None:
    """A resonance that delays and does not overshoot was told an overshoot, and the delay came second."""

    class Belying(LinearProblem):
        def belies(self, fitted: Fit) -> bool:
            return any(c.name == "simple" for c in fitted.active)

    def wave(v) -> np.ndarray:
        return 6.0 * np.sin(v["pace"] * TIME)

    data = wave({"pace": 217.3}) + np.random.default_rng(0).normal(size=len(TIME))
    problem = Belying(data, np.ones((len(TIME), 1)), {"simple": wave, "whole": wave})
    near = replace(PACE, low=210.0, high=225.0)
    found = compare([problem], [candidate("simple", near), candidate("whole", near)], Effort())
    assert {e.name for h in found.hypotheses for e in h.effects} == {"whole"}
