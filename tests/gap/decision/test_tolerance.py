"""How many stated tolerances an effect is large."""

from __future__ import annotations

import numpy as np
import pytest

from gap.data.tolerances import Tolerance
from gap.decision.tolerance import in_stated
from gap.inference.hypothesis import Candidate
from gap.search.compare import Effort, compare
from sim_devices.chain import Parameter
from tests.gap.decision.waves import T


def test_the_size_of_an_effect_is_what_the_block_says_that_tells_it_best(linear) -> None:
    """A gauge 5.5 % off was within tolerance: the pressure, which its loop holds at the command, said 0 and knew
    nothing, and the manometer beside it was not asked."""
    noise = np.random.default_rng(11).normal(size=(2, len(T)))
    blocks = {
        name: linear(
            a * np.sin(9 * T) + own,
            np.ones((len(T), 1)),
            {"gauge": lambda v, a=b: a * v["a"] * np.sin(9 * T)},
            name=name,
        )
        for name, a, b, own in (("pressure", 0.0, 1e-3, noise[0]), ("manometer", 5.0, 1.0, noise[1]))
    }
    gauge = Candidate("gauge", "gauge", "actuator", (Parameter("a", "1", -10.0, 10.0),), tuple(blocks), "gauge", "")
    found = compare(list(blocks.values()), [gauge], Effort(pair_bases=0))
    h = next(h for h in found.hypotheses if h.effects == (gauge,))
    assert h.surest(gauge) == "manometer"
    assert in_stated(gauge, h, {"gauge": {"a": Tolerance(1.0, "1", "of a test")}}) == pytest.approx(5.0, abs=0.5)
