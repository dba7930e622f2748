"""A cascade of two loops: the pressure's controller asks for a flow, which a loop of its own brings about."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from acquire.recording.model import Recording
from gap.effects.load import library
from gap.inference.least_squares import fit
from gap.null.groups import GroupedSession
from gap.null.suction_pressure import PressureBlock
from tests.gap.null.regulators import CORNERS, STEP, SUCTION, TIME, session_of


def cascaded(asked: np.ndarray, soft: float) -> np.ndarray:
    """Suction (n,) Pa by a controller of 12/s that asks for a flow, softly up to ``soft`` Pa/s, and a loop about that
    flow of 75/s, which is damped by .6."""
    p = flow = speed = 0.0
    out, own, damping = np.empty(len(asked)), 75.0, 0.6
    for k, u in enumerate(asked):
        out[k] = p
        wanted = soft * np.tanh(12.0 * (u - p) / soft)
        speed += STEP * (own**2 * (wanted - flow) - 2.0 * damping * own * speed)
        flow += STEP * speed
        p = max(p + STEP * flow, 0.0)
    return out


def test_a_cascade_of_loops_is_sound(recording: Callable[..., Recording]) -> None:
    """Two sessions of an outside author, a sound one among them, were told an overshoot (.72, .90)."""
    taken = session_of(recording, cascaded(np.interp(TIME, CORNERS, SUCTION), 2.6e5))
    block = PressureBlock(GroupedSession([taken], ("pressure",)), library("cutometer"))
    found = fit(block)
    assert found.chi2 / len(found.residual) < 1.1
    assert found.penalty < 25
    inertia, unit = block.quantities(found.nuisance)["regulator_inertia"]
    assert inertia == pytest.approx(1.0 / (2.0 * 0.6) ** 2, rel=0.15)
    assert unit == "1"


def inert(asked: np.ndarray) -> np.ndarray:
    """Suction (n,) Pa by a PI loop (11.7/s, integral 1.5/s) about a valve of 24 ms whose own mass makes it overshoot
    (m = .7), and whose flow falls with suction and grows while it vents."""
    p = x = speed = z = 0.0
    out, late = np.empty(len(asked)), 0.0237
    for k, u in enumerate(asked):
        out[k] = p
        error = u - p
        z = 0.0 if u == 0.0 and p < 50.0 else z + STEP * 11.7 * 1.5 * error
        speed += STEP * (11.7 * error + z - x - late * speed) / (0.7 * late**2)
        x += STEP * speed
        p = max(p + STEP * x * (1.0 - 0.2 * p / 5e4 if x > 0.0 else 1.0 + 0.1 * p / 5e4), 0.0)
    return out


def test_a_valve_that_swings_is_found_though_none_without_mass_comes_near(recording: Callable[..., Recording]) -> None:
    """A sound session of an outside author was of an unknown regulator: 3.5 of the gap were left, after minutes."""
    taken = session_of(recording, inert(np.interp(TIME, CORNERS, SUCTION)))
    block = PressureBlock(GroupedSession([taken], ("pressure",)), library("cutometer"))
    found = fit(block)
    assert found.chi2 / len(found.residual) < 1.1
    assert block.quantities(found.nuisance)["regulator_inertia"][0] == pytest.approx(0.7, rel=0.1)
