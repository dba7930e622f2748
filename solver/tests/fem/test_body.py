"""Elements, follower load and contact against closed forms, and the linear algebra behind them."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import spsolve

from skinrig_solver import SolverError
from skinrig_solver.fem.body import Body
from skinrig_solver.fem.mesh import Mesh, block, graded
from skinrig_solver.fem.surface import rim
from skinrig_solver.fem.types import Load, Rim, State
from skinrig_solver.materials.yeoh_qlv import yeoh_qlv

Array = NDArray[np.float64]
LAW = yeoh_qlv(1)
G, C20, NU = 2e4, 1e4, 0.49
PARAMETERS = [np.array([{"G": G, "c20": C20, "nu": NU, "tau1": 1.0}.get(name, 0.0) for name in LAW.parameters])]
BULK = 2.0 * G * (1.0 + NU) / (3.0 * (1.0 - 2.0 * NU))
NO_EDGES = np.zeros((0, 3), dtype=np.int64)


def solve(body: Body, load: Load, steps: int = 1) -> State:
    state = body.rest()
    for i in range(1, steps + 1):
        part = Load(load.pressure * i / steps, load.height and load.height * i / steps, load.force * i / steps)
        state, _, _ = body.step(state, state, part, 1.0, PARAMETERS, float(i), True)
    return state


def cylinder(distortion: float, axisymmetric: bool = True) -> Mesh:
    mesh = block(
        np.linspace(0.0, 1e-3, 4), np.linspace(0.0, -1e-3, 4), np.zeros(3, dtype=np.int64), ("tissue",), axisymmetric
    )
    rng = np.random.default_rng(0)
    x = mesh.nodes / 1e-3
    inside = np.all((x * [1, -1] > 1e-9) & (x * [1, -1] < 1 - 1e-9), axis=1)
    mesh.nodes[inside] += distortion * 1e-3 * rng.uniform(-1, 1, size=(inside.sum(), 2))
    return mesh


@pytest.mark.parametrize("axisymmetric", [True, False])
def test_patch_in_uniform_tension(axisymmetric: bool) -> None:
    """A distorted mesh pulled by a follower pressure stretches uniformly, by the closed form of its law."""
    mesh = cylinder(0.02, axisymmetric)
    fixed = np.zeros(mesh.nodes.shape, dtype=bool)
    fixed[np.unique(mesh.edges["bottom"]), 1] = True
    fixed[np.unique(mesh.edges["left"]), 0] = True
    body = Body(mesh, LAW, fixed, mesh.edges["top"], None, 1e-3)
    state = solve(body, Load(-8e3), steps=2)
    body._kinematics(state)
    F = body.kin[0]
    assert np.allclose(body.kin, F, atol=1e-9)
    lr, lz, lt, J = F[0], F[3], F[4], F[0] * F[3] * F[4]
    squares = np.array([lr, lz, lt]) ** 2
    scale = J ** (-2.0 / 3.0)
    slope = 0.5 * G + 2.0 * C20 * (scale * squares.sum() - 3.0)
    cauchy = 2.0 * slope * scale / J * (squares - squares.sum() / 3.0) + BULK * (J - 1.0)
    assert cauchy[1] == pytest.approx(8e3, rel=1e-6)
    assert cauchy[0] == pytest.approx(0.0, abs=1e-2)
    if not axisymmetric:
        assert lt == 1.0


def half_space(radius: float, edge: float) -> tuple[Mesh, NDArray[np.bool_]]:
    """A large block with a surface grid line at ``edge``."""
    inner = graded(edge, 0.0, 0.05 * edge, 1.4)[::-1]
    r = np.concatenate([inner, graded(edge, radius, 0.05 * edge, 1.4)[1:]])
    z = graded(0.0, -radius, 0.06 * edge, 1.4)
    mesh = block(r, z, np.zeros(len(z) - 1, dtype=np.int64), ("tissue",), axisymmetric=True)
    fixed = np.zeros(mesh.nodes.shape, dtype=bool)
    fixed[np.unique(np.concatenate([mesh.edges["bottom"], mesh.edges["right"]]))] = True
    fixed[np.unique(mesh.edges["left"]), 0] = True
    return mesh, fixed


def test_small_suction_on_a_half_space() -> None:
    """u = 2 (1 − ν²) p a/E at the centre (Love 1929)."""
    a, p = 1e-3, -1.0
    mesh, fixed = half_space(200 * a, a)
    edges = mesh.edges["top"]
    loaded = edges[mesh.nodes[edges][:, :, 0].max(axis=1) <= a * (1 + 1e-9)]
    state = solve(Body(mesh, LAW, fixed, loaded, None, a), Load(p))
    E = 2.0 * G * (1.0 + NU)
    assert state.u[mesh.edges["top"][0, 0], 1] == pytest.approx(2.0 * (1.0 - NU**2) * -p * a / E, rel=0.01)


def test_flat_punch_by_contact() -> None:
    """F = 2 E a δ/(1 − ν²) (Boussinesq), by a held and by a force-controlled probe; λ g is complementary."""
    a, depth = 1e-3, 2e-6
    mesh, fixed = half_space(200 * a, a)
    edges = mesh.edges["top"]
    facing = edges[mesh.nodes[edges][:, :, 0].max(axis=1) <= a * (1 + 1e-9)]
    body = Body(mesh, LAW, fixed, NO_EDGES, Rim(facing, -1.0, 0.0), a)
    held = solve(body, Load(0.0, height=-depth))
    force = float(body.contact_weights @ held.lam)
    E = 2.0 * G * (1.0 + NU)
    assert force == pytest.approx(2.0 * E * a * depth / (1.0 - NU**2), rel=0.02)
    assert np.all(held.lam >= 0.0)
    assert np.all(held.lam * np.abs(body.gap[:, 0]) < 1e-3)  # Pa m: a few pascal over a micrometre
    pressed = solve(body, Load(0.0, height=None, force=force))
    assert pressed.height == pytest.approx(-depth, rel=1e-3)


def test_rim_geometry_is_smooth_and_consistent() -> None:
    """Gap, arc length and their first two derivatives around the fillet."""
    h = 1e-6
    for r, z in [(1.5, 0.7), (1.08, 0.98), (1.02, 1.01), (0.97, 1.05), (0.9, 1.2)]:
        out = np.zeros(12)
        rim(r, z, 1.0, 1.0, 0.1, out)
        for first, second in ((0, (1, 2)), (6, (7, 8)), (1, (3, 4)), (2, (4, 5)), (7, (9, 10)), (8, (10, 11))):
            for axis in (0, 1):
                values = []
                for sign in (1, -1):
                    moved = np.zeros(12)
                    rim(r + sign * h * (axis == 0), z + sign * h * (axis == 1), 1.0, 1.0, 0.1, moved)
                    values.append(moved[first])
                assert (values[0] - values[1]) / (2 * h) == pytest.approx(out[second[axis]], abs=1e-6)


def test_friction_stays_in_coulombs_cone_and_holds_the_skin_back() -> None:
    a = 1e-3
    mesh, fixed = half_space(20 * a, a)
    edges = mesh.edges["top"]
    radius = mesh.nodes[edges][:, :, 0]
    loaded = edges[radius.max(axis=1) <= a * (1 + 1e-9)]
    facing = edges[radius.min(axis=1) >= 0.5 * a]
    body = Body(mesh, LAW, fixed, loaded, Rim(facing, 0.9 * a, 0.1 * a), a)
    heights = []
    for mu in (0.0, 0.2, 2.0):
        state = body.rest()
        for i in range(1, 5):
            state, _, _ = body.step(state, state, Load(-2.5e3 * i, friction=mu), 1.0, PARAMETERS, float(i), True)
        assert np.all(np.abs(state.shear) <= mu * state.lam + 5.0)
        heights.append(state.u[mesh.edges["top"][0, 0], 1])
    assert heights[0] > heights[1] > heights[2]


def test_fronts_factorise_as_a_general_library_does() -> None:
    mesh = cylinder(0.02)
    fixed = np.zeros(mesh.nodes.shape, dtype=bool)
    fixed[np.unique(mesh.edges["bottom"])] = True
    fixed[np.unique(mesh.edges["left"]), 0] = True
    pattern = Body(mesh, LAW, fixed, mesh.edges["top"], None, 1e-3).pattern
    factor = Body(mesh, LAW, fixed, mesh.edges["top"], None, 1e-3).factor
    random = np.random.default_rng(0)
    values = random.normal(size=pattern.nnz)
    matrix = csr_matrix((values, pattern.indices, pattern.indptr))
    factor.update(values)  # entries of either sign, any diagonal: only row exchanges keep this accurate
    right = random.normal(size=(pattern.size, 3))
    solution = factor.solve(right)
    assert np.allclose(solution, spsolve(matrix.tocsc(), right), rtol=1e-7, atol=1e-7)
    assert np.allclose(factor.solve(right[:, 0]), solution[:, 0], rtol=1e-9, atol=1e-12)
    for bad in (0.0, np.nan):
        with pytest.raises(np.linalg.LinAlgError):
            factor.update(np.full(pattern.nnz, bad))


def test_trouble_is_located() -> None:
    mesh = cylinder(0.0)
    fixed = np.zeros(mesh.nodes.shape, dtype=bool)
    fixed[np.unique(mesh.edges["bottom"])] = True
    fixed[np.unique(mesh.edges["left"]), 0] = True
    body = Body(mesh, LAW, fixed, mesh.edges["top"], None, 1e-3)
    with pytest.raises(SolverError, match=r"t = 1 s, pressure = -1e\+08, element \d+"):
        solve(body, Load(-1e8))


def test_a_folded_mesh_is_refused() -> None:
    mesh = cylinder(0.0)
    mesh.nodes[24] = mesh.nodes[0]
    with pytest.raises(ValueError, match=r"element \d+ is folded"):
        _ = mesh.points
