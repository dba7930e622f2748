"""The micro-robot's finite-element sheet as the diagnosis uses it: a potential, its glue, its anchor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np

from gap.null.fe_sheet import FREE, POWERS, FeForceBlock, PotentialSheet, gradients, sheet_law
from gap.null.fe_solver import FeModel
from sim_devices.stages.robot import xyz
from sim_devices.stages.sheet import Glue, Sheet
from sim_devices.stages.tissues import SheetTissue

START = {"mu1": 2e4, "mu2": 1.0, "alpha2": 40.0, "sx": 8e4, "sy": 6e4, "bulk": 1e6}


class Spring:
    """A closed-form sheet with a solver's interface: forces of a quartic potential whose stiffness is the stress."""

    info = SimpleNamespace(
        problem="sheet", symbols=(*FREE, "gbar", "gbar2"), channels=xyz("force"), defaults=START,
    )  # fmt: skip

    def simulate(self, experiment: Any, parameters: Mapping[str, float], sensitivities: Sequence[str] = ()) -> Any:
        force = self._force(experiment, parameters)
        slopes = {}
        for axis in xyz("force"):
            columns = []
            for s in sensitivities:
                step = 1e-5 * parameters[s]
                up, down = ({**parameters, s: parameters[s] + k * step} for k in (1, -1))
                columns.append((self._force(experiment, up)[axis] - self._force(experiment, down)[axis]) / (2 * step))
            slopes[axis] = np.column_stack(columns) if columns else None
        return SimpleNamespace(channels=force, sensitivities=slopes)

    @staticmethod
    def _force(experiment: Any, p: Mapping[str, float]) -> dict[str, np.ndarray]:
        u = np.stack([experiment.drive[s] for s in xyz("probe")])
        stiffness = np.array([p["sx"], p["sy"], 0.3 * (p["sx"] + p["sy"])]) / 100.0 + p["mu1"] / 1e3
        stretch = np.sum(stiffness[:, None] * u**2, axis=0) / (5e-8 * p["mu1"])
        return dict(zip(xyz("force"), -stiffness[:, None] * u * (1 + stretch), strict=True))


def block() -> FeForceBlock:
    made = FeForceBlock.__new__(FeForceBlock)
    made.model, made._start_law, made._reach = FeModel("spring", Spring()), START, 1.5e-3
    return made


def test_gradients_belong_to_a_potential() -> None:
    rng = np.random.default_rng(1)
    c = rng.normal(size=len(POWERS))

    def potential(u: np.ndarray) -> np.ndarray:
        return np.asarray(np.prod(u[None] ** (2 * POWERS[:, :, None]), axis=1).T @ c)

    u = rng.uniform(-1, 1, (3, 20))
    for axis in range(3):
        step = np.zeros((3, 1))
        step[axis] = 1e-6
        expected = -(potential(u + step) - potential(u - step)) / 2e-6
        np.testing.assert_allclose((gradients(u) @ c)[axis], expected, rtol=1e-5, atol=1e-7)


def test_potential_meets_the_model_off_its_rays() -> None:
    b = block()
    anchor = b._anchored(np.zeros(5))
    u = np.random.default_rng(2).uniform(-0.8e-3, 0.8e-3, (3, 30))
    drive = dict(zip(xyz("probe"), u, strict=True))
    expected = Spring._force(SimpleNamespace(drive=drive), sheet_law(np.zeros(5), START))
    made = gradients(u / b._reach) @ anchor.coefficients
    np.testing.assert_allclose(made, np.stack(list(expected.values())), atol=1e-6)


def test_slopes_of_the_potential() -> None:
    b = block()
    x, step = np.array([0.1, 0.0, 0.0, 0.2, -0.1]), np.array([0.0, 0.0, 0.0, 1e-3, -2e-3])
    anchor, up, down = b._anchored(x), b._anchored(x + step), b._anchored(x - step)
    u = np.array([[0.9e-3], [0.4e-3], [0.5e-3]]) / b._reach
    change = gradients(u) @ (up.coefficients - down.coefficients)
    np.testing.assert_allclose(gradients(u) @ (anchor.slopes @ (2 * step)), change, rtol=1e-4)


def test_scale_multiplies_every_force() -> None:
    b = block()
    one, two = b._anchored(np.zeros(5)), b._anchored(np.array([np.log(2.0), 0, 0, 0, 0]))
    u = np.array([[0.5e-3], [0.5e-3], [0.2e-3]]) / b._reach
    np.testing.assert_allclose(gradients(u) @ two.coefficients, 2 * gradients(u) @ one.coefficients, rtol=1e-9)


def test_glue_and_sheet_share_the_displacement() -> None:
    stiffness, compliance = 800.0, 5e-4
    c = np.zeros(len(POWERS))
    for p in ((1, 0, 0), (0, 1, 0), (0, 0, 1)):
        c[np.flatnonzero((p == POWERS).all(axis=1))] = 0.5 * stiffness * 1e-3
    sheet = PotentialSheet(
        "tissue", "tissue", xyz("skin"), xyz("reaction"), c, 1e-3, 0.4, (1.0, -0.2, 1.0), Glue(compliance, compliance)
    )
    time = np.linspace(0, 1e-6, 5)
    signals = {s: np.linspace(0, 1e-3, 5) * k for s, k in zip(xyz("skin"), (1.0, -0.5, 0.3), strict=True)}
    given = {k: v.copy() for k, v in signals.items()}
    sheet.advance(sheet.fresh(), time, signals)
    together = 1.0 / (1.0 / stiffness + compliance)
    for skin, reaction in zip(xyz("skin"), xyz("reaction"), strict=True):
        np.testing.assert_allclose(signals[reaction], -together * given[skin], rtol=1e-3, atol=1e-9)


def test_glue_creeps_and_closes_under_either_sheet() -> None:
    """The sheets solve one equation of glue, each its own way: all at once, and step by step."""
    stiffness, glue = 800.0, Glue(2e-4, 1e-4, creeps=0.6, within=0.2, closes=1.5)
    c = np.zeros(len(POWERS))
    for p in ((1, 0, 0), (0, 1, 0), (0, 0, 1)):
        c[np.flatnonzero((p == POWERS).all(axis=1))] = 0.5 * stiffness * 1e-3
    law = SheetTissue((stiffness,) * 3, angle=0.0, relaxation=(), times=(), exponent=0.0, softening=0.0)
    names = ("tissue", "tissue", xyz("skin"), xyz("reaction"))
    time, forces = np.arange(0.0, 1.5, 1e-3), []
    for sheet in (PotentialSheet(*names, c, 1e-3, 0.0, (1.0, 0.0, 1.0), glue), Sheet(*names, law, glue)):
        signals = {s: 5e-4 * k * np.sin(5.0 * time) for s, k in zip(xyz("skin"), (1.0, -0.5, 0.3), strict=True)}
        sheet.advance(sheet.fresh(), time, signals)
        forces.append(np.stack([signals[s] for s in xyz("reaction")]))
    assert np.max(np.abs(forces[0])) > 0.3
    np.testing.assert_allclose(forces[0], forces[1], atol=2e-3)
