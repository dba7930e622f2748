"""The sheet's mechanics: patch test, rotations, tangents, closed forms of small displacements, mesh convergence."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from skinrig_solver.laws import LAWS
from skinrig_solver.sheet.equilibrium import Sheet
from skinrig_solver.sheet.mesh import ring
from skinrig_solver.sheet.prestress import Prestress, stretch, unstretched
from skinrig_solver.sheet.system import matrix, system

Array = NDArray[np.float64]
THICKNESS = 1.5e-3
LAW = pytest.mark.parametrize("name", list(LAWS))


def defaults(name: str) -> Array:
    return np.array([p.default for p in LAWS[name].parameters])


def prestress(name: str) -> Prestress:
    return stretch(LAWS[name], defaults(name), np.array(LAWS[name].prestress))


def sheet(name: str, layers: int = 0, spatial: bool = False, initial: Array | None = None) -> Sheet:
    mesh = ring(2e-3, 20e-3, 3, 8, layers, THICKNESS)
    state = prestress(name) if initial is None else unstretched(defaults(name))
    return Sheet(LAWS[name], defaults(name), mesh, THICKNESS, state, spatial, initial)


def forces(body: Sheet) -> Array:
    """Internal forces (n, 3) of the present displacements."""
    body._assemble(system(body.mesh))
    return body.f.copy()


@pytest.mark.parametrize("layers", [0, 2])
def test_ring_has_its_area_and_reproduces_linear_fields(layers: int) -> None:
    mesh = ring(2e-3, 20e-3, 6, 16, layers, THICKNESS)
    measure = np.pi * (20e-3**2 - 2e-3**2) * (THICKNESS if layers else 1.0)
    assert mesh.weights.sum() == pytest.approx(measure, rel=1e-4)
    assert_allclose(mesh.gradients.sum(axis=2), 0.0, atol=1e-8)
    slope = np.einsum("eqad,eac->eqdc", mesh.gradients, mesh.nodes[mesh.cells])
    assert_allclose(slope, np.broadcast_to(np.eye(mesh.dimension), slope.shape), atol=1e-10)


@LAW
@pytest.mark.parametrize("layers", [0, 1])
@pytest.mark.parametrize("spatial", [False, True])
def test_patch_a_pre_stretched_sheet_is_in_equilibrium(name: str, layers: int, spatial: bool) -> None:
    body = sheet(name, layers, spatial)
    f = forces(body)
    inside = ~(body.mesh.probe | body.mesh.support)
    assert np.abs(f[inside]).max() <= 1e-11 * np.abs(f).max()
    # what the ring hands to the probe's edge is the homogeneous stress on that edge: no resultant
    assert np.abs(f[body.mesh.probe].sum(axis=0)).max() <= 1e-11 * np.abs(f).max()


@LAW
@pytest.mark.parametrize("layers", [0, 1])
def test_forces_turn_with_the_sheet(name: str, layers: int) -> None:
    body = sheet(name, layers)
    rng = np.random.default_rng(3)
    body.u[:] = 1e-5 * rng.standard_normal(body.u.shape)
    straight = forces(body)
    axis = np.array([1.0, -2.0, 0.5]) / np.sqrt(5.25)
    K = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    turn = np.eye(3) + np.sin(0.7) * K + (1.0 - np.cos(0.7)) * K @ K
    rest = np.zeros_like(body.u)
    rest[:, : body.mesh.dimension] = body.mesh.nodes
    stretched = rest @ np.pad(body.F0, ((0, 0), (0, 3 - body.mesh.dimension))).T
    body.u = (stretched + body.u) @ turn.T - stretched
    assert_allclose(forces(body), straight @ turn.T, atol=1e-9 * np.abs(straight).max())


@LAW
@pytest.mark.parametrize("layers", [0, 1])
def test_tangent_is_the_derivative_of_the_forces(name: str, layers: int) -> None:
    body = sheet(name, layers)
    numbers = system(body.mesh)
    free = numbers.equations >= 0
    rng = np.random.default_rng(4)
    body.u[free] = 1e-6 * rng.standard_normal(int(free.sum()))
    _, K, _, _ = body._assemble(numbers)
    tangent = matrix(numbers, K)
    way = rng.standard_normal(numbers.size)
    start = body.u.copy()
    h = 1e-9
    sides = []
    for sign in (1.0, -1.0):
        body.u = start.copy()
        body.u[free] += sign * h * way
        sides.append(forces(body)[free])
    rate = (sides[0] - sides[1]) / (2.0 * h)
    assert_allclose(tangent @ way, rate, atol=2e-5 * np.abs(rate).max())


@LAW
def test_prestress_balances_its_loads_and_knows_its_derivatives(name: str) -> None:
    law, p, loads = LAWS[name], defaults(name), np.array(LAWS[name].prestress)
    state = stretch(law, p, loads)
    assert_allclose(state.stretches * state.elastic[:2], loads, rtol=1e-8)
    for k in range(p.size + 2):
        at = np.concatenate([p, loads])
        sides = []
        for sign in (1.0, -1.0):
            moved = at.copy()
            moved[k] *= 1.0 + 1e-5 * sign
            sides.append(stretch(law, moved[: p.size], moved[p.size :]).stretches)
        rate = (sides[0] - sides[1]) / (2e-5 * at[k])
        assert_allclose(state.derivatives[k], rate, rtol=1e-4, atol=1e-9 / at[k])


def test_normal_stiffness_of_a_tense_membrane() -> None:
    """A rigid disc lifted out of a sheet under uniform tension T: k = 2 pi T / ln(R / r)."""
    tension = 40e3
    mesh = ring(2e-3, 20e-3, 6, 16)
    body = Sheet(
        LAWS["yeoh"], defaults("yeoh"), mesh, THICKNESS, unstretched(defaults("yeoh")), initial=np.full(2, tension)
    )
    body.move(np.array([0.0, 0.0, 1e-7]))
    expected = 2.0 * np.pi * tension * THICKNESS / np.log(10.0) * 1e-7
    assert -body.force[2] == pytest.approx(expected, rel=3e-4)


def rigid_disc_stiffness(inner: float, outer: float, shear: float, bulk: float) -> float:
    """In-plane force per thickness and displacement of a rigid disc in a clamped elastic ring, plane stress.

    First harmonic u = (U cos, V sin) of Navier's equations: dilatation c r + d / r, the solutions of each below, and
    the force on a circle is 2 pi d times the plane-stress modulus M = lambda + 2 mu.
    """
    lame = bulk - 2.0 / 3.0 * shear
    modulus = 2.0 * shear * lame / (lame + 2.0 * shear) + 2.0 * shear
    b = modulus / shear

    def columns(r: float) -> list[list[float]]:
        log = np.log(r / outer)
        return [
            [(3.0 - b) / 8.0 * r**2, 0.5 * (1.0 + b) * log + 0.5 * (1.0 - b), 1.0, 1.0 / r**2],
            [(3.0 * b - 1.0) / 8.0 * r**2, -0.5 * (1.0 + b) * log, -1.0, 1.0 / r**2],
        ]

    d = np.linalg.solve(columns(inner) + columns(outer), [1.0, -1.0, 0.0, 0.0])[1]
    return float(abs(2.0 * np.pi * modulus * d))


def test_in_plane_stiffness_of_an_elastic_ring() -> None:
    p = defaults("yeoh")
    body = Sheet(LAWS["yeoh"], p, ring(2e-3, 20e-3, 6, 16), THICKNESS, unstretched(p))
    tangent, _ = body.linearise()
    expected = THICKNESS * rigid_disc_stiffness(2e-3, 20e-3, 2.0 * p[0], p[3])
    assert_allclose(-np.diag(tangent)[:2], expected, rtol=1e-3)


def test_a_flat_membrane_that_would_wrinkle_names_no_normal_stiffness() -> None:
    body = Sheet(LAWS["ogden"], defaults("ogden"), ring(2e-3, 20e-3, 4, 12), THICKNESS, prestress("ogden"))
    assert body.linearise()[0][2, 2] < 0.0
    for reach in (0.5e-3, 1e-3, 1.5e-3):
        body.move(np.array([reach, 0.0, 0.0]))
    assert np.isnan(body.linearise()[0][2, 2])
    assert not body.u[:, 2].any()


def test_mesh_converges() -> None:
    """The default mesh is within 0.2 % of one with four times the nodes, 1.3 mm out; a coarser one within 1 %."""
    law, p, state = LAWS["ogden"], defaults("ogden"), prestress("ogden")
    force = []
    for radial, around in ((12, 32), (6, 16), (4, 12)):
        body = Sheet(law, p, ring(2e-3, 20e-3, radial, around), THICKNESS, state)
        for share in (0.4, 0.7, 1.0):
            body.move(share * np.array([0.8e-3, 0.3e-3, 1.0e-3]))
        force.append(body.force)
    assert_allclose(force[1], force[0], rtol=2e-3)
    assert_allclose(force[2], force[0], rtol=1e-2)


def test_a_solid_bends_and_a_membrane_is_softer() -> None:
    """The membrane is softer than a solid: by a few percent in plane and by more in the normal force."""
    law, p, state = LAWS["ogden"], defaults("ogden"), prestress("ogden")
    low = []
    for way in (np.array([1.3e-3, 0.0, 0.0]), np.array([0.0, 0.0, 1.3e-3])):
        size = []
        for layers in (0, 1):
            body = Sheet(law, p, ring(2e-3, 20e-3, 4, 12, layers, THICKNESS), THICKNESS, state)
            body.move(0.5 * way)
            body.move(way)
            size.append(np.linalg.norm(body.force))
        low.append(1.0 - size[0] / size[1])
    assert 0.01 < low[0] < 0.05
    assert 0.04 < low[1] < 0.12
