"""The Ogden sheet against felupe, an independent finite element library with automatic differentiation.

felupe has no membrane: a thin solid, half its thickness on a mirror plane, is one in plane. Half the ring by symmetry.
"""

from __future__ import annotations

import felupe as fem
import numpy as np
import tensortrax.math as tm
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from skinrig_solver.laws import LAWS
from skinrig_solver.sheet.equilibrium import Sheet
from skinrig_solver.sheet.mesh import ring
from skinrig_solver.sheet.prestress import Prestress, stretch

Array = NDArray[np.float64]
INNER, OUTER, THICKNESS, THIN = 2e-3, 20e-3, 1.5e-3, 1e-4
REACH = np.array([0.5, 0.9, 1.3]) * 1e-3


def felupe_forces(p: Array, state: Prestress, radial: int, around: int) -> Array:
    """Force along x on the probe [N] for the displacements REACH."""

    def energy(C, mu1, alpha1, mu2, alpha2, bulk):  # type: ignore[no-untyped-def]
        square = tm.linalg.det(C)
        squares = tm.linalg.eigvalsh(C) * square ** (-1 / 3)
        terms = [mu / a * (tm.sum(squares ** (a / 2)) - 3) for mu, a in ((mu1, alpha1), (mu2, alpha2))]
        return terms[0] + terms[1] + bulk / 8 * tm.log(square) ** 2

    flat = fem.Rectangle(a=(0, 0), b=(1, np.pi), n=(radial + 1, around + 1))
    mesh = fem.mesh.expand(flat, n=2, z=THIN / 2)
    share, angle, z = mesh.points.T.copy()
    r = INNER * (OUTER / INNER) ** share
    mesh.points[:] = np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1)
    field = fem.FieldContainer([fem.Field(fem.RegionHexahedron(mesh), dim=3)])
    stretched = mesh.points * (np.array([*state.stretches, np.sqrt(state.c33)]) - 1.0)
    field[0].values[:] = stretched
    probe, held = np.isclose(share, 0.0), np.isclose(share, 1.0)
    mirror = np.isclose(angle % np.pi, 0.0, atol=1e-9) & ~probe & ~held
    names = ("mu1", "alpha1", "mu2", "alpha2", "bulk")
    body = fem.SolidBody(fem.Hyperelastic(energy, **dict(zip(names, p, strict=True))), field)
    forces = []
    for reach in REACH:
        edge = probe | held
        x = stretched[:, 0] + reach * probe
        bounds = {
            "x": fem.Boundary(field[0], mask=edge, skip=(0, 1, 1), value=x[edge]),
            "y": fem.Boundary(field[0], mask=edge, skip=(1, 0, 1), value=stretched[edge, 1]),
            "mirror": fem.Boundary(field[0], mask=mirror, skip=(1, 0, 1)),
            "middle": fem.Boundary(field[0], mask=np.isclose(z, 0.0), skip=(1, 1, 0)),
        }
        dof0, dof1 = fem.dof.partition(field, bounds)
        ext0 = fem.dof.apply(field, bounds, dof0)
        fem.newtonraphson(items=[body], dof0=dof0, dof1=dof1, ext0=ext0, verbose=0, tol=1e-8)
        nodal = body.results.force.toarray().reshape(-1, 3)
        forces.append(4.0 * THICKNESS / THIN * nodal[probe, 0].sum())  # two mirror planes
    return -np.array(forces)


def test_ogden_sheet_agrees_with_felupe() -> None:
    law = LAWS["ogden"]
    p = np.array([q.default for q in law.parameters])
    state = stretch(law, p, np.array([84e3, 61e3]))
    body = Sheet(law, p, ring(INNER, OUTER, 6, 16), THICKNESS, state)
    ours = []
    for reach in REACH:
        body.move(np.array([reach, 0.0, 0.0]))
        ours.append(body.force[0])
    coarse, fine = felupe_forces(p, state, 8, 12), felupe_forces(p, state, 16, 24)
    assert_allclose(fine, ours, rtol=0.01)
    assert_allclose((4.0 * fine - coarse) / 3.0, ours, rtol=0.003)  # extrapolated: linear elements, error of order h^2
