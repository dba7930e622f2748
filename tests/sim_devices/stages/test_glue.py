"""Glue between probe and sheet: it gives at once, creeps, and closes, as its equations say."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from sim_devices.chain import FloatArray
from sim_devices.stages.robot import xyz
from sim_devices.stages.sheet import Glue, Sheet
from sim_devices.stages.tissues import SheetTissue

STIFFNESS = 800.0
TIME = np.arange(0.0, 3.0, 1e-3)
PATH = 5e-4 * np.sin(2 * np.pi * 0.8 * TIME)


def _pushed(glue: Glue) -> FloatArray:
    """Force along x on a probe that moves along `PATH` on a spring, through glue."""
    law = SheetTissue((STIFFNESS,) * 3, angle=0.0, relaxation=(), times=(), exponent=0.0, softening=0.0)
    sheet = Sheet("tissue", "tissue", xyz("skin"), xyz("reaction"), law, glue)
    signals = dict(zip(xyz("skin"), (PATH, np.zeros(len(TIME)), np.zeros(len(TIME))), strict=True))
    sheet.advance(sheet.fresh(), TIME, signals)
    return signals[xyz("reaction")[0]]


def _expected(glue: Glue) -> FloatArray:
    """The same by another integrator and a root of the force at each of its steps."""

    def force(u: float, crept: float) -> float:
        def off(f: float) -> float:
            given = glue.plane * ((1 - glue.creeps) * f / (1 + glue.closes * abs(f)) + glue.creeps * crept)
            return f + STIFFNESS * (u + given)

        return float(brentq(off, -2.0, 2.0, xtol=1e-13))

    def change(t: float, s: FloatArray) -> list[float]:
        f = force(float(np.interp(t, TIME, PATH)), float(s[0]))
        return [(f / (1 + glue.closes * abs(f)) - float(s[0])) / glue.within]

    crept = solve_ivp(change, (0.0, TIME[-1]), [0.0], t_eval=TIME, rtol=1e-8, atol=1e-10, max_step=5e-3).y[0]
    return np.array([force(u, c) for u, c in zip(PATH, crept, strict=True)])


@pytest.mark.parametrize(
    "glue",
    [
        Glue(2e-4, 1e-4),
        Glue(2e-4, 1e-4, creeps=0.6, within=0.4),
        Glue(2e-4, 1e-4, closes=3.0),
        Glue(2e-4, 1e-4, creeps=0.7, within=0.05, closes=1.5),
    ],
    ids=["elastic", "creeping", "closing", "both"],
)
def test_the_force_through_glue_is_that_of_its_equations(glue: Glue) -> None:
    found = _pushed(glue)
    assert np.max(np.abs(found - _pushed(Glue()))) > 0.02  # N: glue matters here
    np.testing.assert_allclose(found, _expected(glue), atol=5e-4)


def test_glue_gives_in_the_end_by_its_compliance_and_less_where_it_has_closed() -> None:
    time = np.linspace(0.0, 50.0, 501)
    force = np.zeros((3, len(time)))
    force[0], force[2] = 0.5, 0.25
    given = Glue(2e-4, 1e-4, creeps=0.5, within=2.0, closes=2.0).gives(time, force)
    share = 1 / (1 + 2.0 * np.hypot(0.5, 0.25))
    assert given[:, -1] == pytest.approx([2e-4 * 0.5 * share, 0.0, 1e-4 * 0.25 * share])
