"""Where a coil's limit is looked for."""

from __future__ import annotations

import numpy as np
import pytest

from gap.design import simulated as own
from gap.effects.load import library
from gap.null.robot import robot_problems
from gap.null.robot_axes import QUANTITIES

JUMP, KP = 7e-4, 1800.0  # m, N/m


@pytest.mark.parametrize("rise", [0.0, 0.5])
def test_a_limit_is_looked_for_up_to_what_a_jump_asks_of_a_coil(rise: float) -> None:
    """A coil of 1.25 N under a load of .3 N, whose set-point jumps by .7 mm, was told drag."""
    time = np.array([0.0, 2.0, 2.0 + rise, 4.0, 4.0 + rise, 7.0])
    way = JUMP * np.array([0.0, 0.0, 1.0, 1.0, 0.0, 0.0])
    leg = own.Leg({q: (time, way * (q == "probe_x")) for q in QUANTITIES}, 7.0)
    limits = {k: e for k, e in library("microrobot").items() if e.name in ("force_saturation", "integral_windup")}
    _, known = robot_problems(own.robot_session(np.random.default_rng(3), legs=[leg, leg]), limits)
    reach = [c.parameters[0].high for c in known if c.parameters[0].name == "limit"]
    assert reach
    assert all((high > KP * JUMP) is (rise == 0.0) for high in reach)
