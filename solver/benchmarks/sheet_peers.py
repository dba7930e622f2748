"""The same Ogden sheet in this solver, felupe and NGSolve: the references of tests and benchmarks.

Elastic, pre-stretched by dead loads, the hole's edge held and the probe's edge displaced along x in equal steps. Every
function returns the forces on the probe at the steps [N], the unknowns and the seconds of one run, meshing included.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinrig_solver.laws import LAWS
from skinrig_solver.sheet.equilibrium import Sheet
from skinrig_solver.sheet.mesh import ring
from skinrig_solver.sheet.prestress import Prestress, stretch

Array = NDArray[np.float64]
Answer = tuple[Array, int, float]
_STEPS = 32  # of the whole sheet's probe: NGSolve starts every step without a predictor


@dataclass(frozen=True)
class Case:
    """Radii of probe and hole, thickness, reach of the probe [m]; pre-stress [Pa]; the Ogden law's defaults."""

    inner: float = 2e-3
    outer: float = 20e-3
    thickness: float = 1.5e-3
    reach: float = 1.3e-3
    loads: tuple[float, float] = (84e3, 61e3)

    @property
    def parameters(self) -> Array:
        """mu1, alpha1, mu2, alpha2, bulk."""
        return np.array([p.default for p in LAWS["ogden"].parameters])

    @cached_property
    def state(self) -> Prestress:
        return stretch(LAWS["ogden"], self.parameters, np.array(self.loads))


def ours(case: Case, radial: int, around: int, steps: int) -> Answer:
    """Membrane of quadratic quadrilaterals."""
    started = perf_counter()
    mesh = ring.__wrapped__(case.inner, case.outer, radial, around)  # not the cached one: meshing counts
    body = Sheet(LAWS["ogden"], case.parameters, mesh, case.thickness, case.state)
    forces = []
    for k in range(1, steps + 1):
        body.move(np.array([case.reach * k / steps, 0.0, 0.0]))
        forces.append(-body.force[0])
    return np.array(forces), 3 * len(mesh.nodes), perf_counter() - started


def with_felupe(case: Case, radial: int, around: int, steps: int, quadratic: bool = False) -> Answer:
    """Linear or triquadratic hexahedra on half of the ring.

    felupe has no membrane: a thin solid, half its thickness on a mirror plane, is one in plane.
    """
    import felupe as fem
    import tensortrax.math as tm

    def energy(C: Any, mu1: float, alpha1: float, mu2: float, alpha2: float, bulk: float) -> Any:
        square = tm.linalg.det(C)
        squares = tm.linalg.eigvalsh(C) * square ** (-1 / 3)
        terms = [mu / a * (tm.sum(squares ** (a / 2)) - 3) for mu, a in ((mu1, alpha1), (mu2, alpha2))]
        return terms[0] + terms[1] + bulk / 8 * tm.log(square) ** 2

    started = perf_counter()
    thin = 1e-4
    flat = fem.Rectangle(a=(0, 0), b=(1, np.pi), n=(radial + 1, around + 1))
    mesh = fem.mesh.expand(flat, n=2, z=thin / 2)
    if quadratic:
        mesh = fem.mesh.convert(mesh, order=2, calc_points=True, calc_midfaces=True, calc_midvolumes=True)
    share, angle, z = mesh.points.T.copy()
    r = case.inner * (case.outer / case.inner) ** share
    mesh.points[:] = np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1)
    region = (fem.RegionTriQuadraticHexahedron if quadratic else fem.RegionHexahedron)(mesh)
    field = fem.FieldContainer([fem.Field(region, dim=3)])
    stretched = mesh.points * (np.array([*case.state.stretches, np.sqrt(case.state.c33)]) - 1.0)
    field[0].values[:] = stretched
    probe, held = np.isclose(share, 0.0), np.isclose(share, 1.0)
    edge = probe | held
    mirror = np.isclose(angle % np.pi, 0.0, atol=1e-9) & ~edge
    names = ("mu1", "alpha1", "mu2", "alpha2", "bulk")
    body = fem.SolidBody(fem.Hyperelastic(energy, **dict(zip(names, case.parameters, strict=True))), field)
    forces = []
    for k in range(1, steps + 1):
        x = stretched[:, 0] + case.reach * k / steps * probe
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
        forces.append(4.0 * case.thickness / thin * nodal[probe, 0].sum())  # two mirror planes
    return np.array(forces), field[0].values.size, perf_counter() - started


def with_ngsolve(case: Case, order: int, size: float, steps: int) -> Answer:
    """Membrane of curved triangles of ``order``, lengths in mm; the thickness stretch is a discontinuous unknown."""
    import ngsolve as ng
    from netgen.geom2d import SplineGeometry

    started = perf_counter()
    geometry = SplineGeometry()
    geometry.AddCircle((0, 0), case.inner * 1e3, leftdomain=0, rightdomain=1, bc="probe", maxh=0.25 * size)
    geometry.AddCircle((0, 0), case.outer * 1e3, leftdomain=1, rightdomain=0, bc="hole")
    mesh = ng.Mesh(geometry.GenerateMesh(maxh=size))
    mesh.Curve(order)
    space = ng.VectorH1(mesh, order=order, dirichlet="probe|hole") * ng.L2(mesh, order=order - 1)
    (u, thickness), _ = space.TnT()
    F = ng.CF((case.state.stretches[0], 0, 0, case.state.stretches[1]), dims=(2, 2)) + ng.Grad(u)
    C = F.trans * F
    middle = 0.5 * (C[0, 0] + C[1, 1])
    radius = ng.sqrt(0.25 * (C[0, 0] - C[1, 1]) ** 2 + C[0, 1] ** 2 + 1e-12)
    volume = 0.5 * ng.log(C[0, 0] * C[1, 1] - C[0, 1] * C[0, 1]) + ng.log(thickness)
    mu1, alpha1, mu2, alpha2, bulk = case.parameters
    energy = 0.5 * bulk * volume**2
    for mu, a in ((mu1, alpha1), (mu2, alpha2)):
        powers = (middle + radius) ** (a / 2) + (middle - radius) ** (a / 2) + thickness**a
        energy = energy + mu / a * powers * ng.exp(-a / 3 * volume)
    form = ng.BilinearForm(space, symmetric=False)
    form += ng.Variation((1e-3 * energy).Compile() * ng.dx)

    solution, step, unit = ng.GridFunction(space), ng.GridFunction(space), ng.GridFunction(space)
    solution.components[1].Set(ng.CF(float(np.sqrt(case.state.c33))))
    probe = mesh.Boundaries("probe")
    step.components[0].Set(ng.CF((1e3 * case.reach / steps, 0)), definedon=probe)
    unit.components[0].Set(ng.CF((1, 0)), definedon=probe)
    residual, free, update = solution.vec.CreateVector(), solution.vec.CreateVector(), solution.vec.CreateVector()
    inside = ng.Projector(space.FreeDofs(), True)
    forces = []
    for _ in range(steps):
        solution.vec.data += step.vec
        for _ in range(20):
            form.AssembleLinearization(solution.vec)
            form.Apply(solution.vec, residual)
            free.data = inside * residual
            if ng.Norm(free) < 1e-8 * ng.Norm(residual):
                break
            update.data = form.mat.Inverse(space.FreeDofs(), inverse="umfpack") * residual
            solution.vec.data -= update
        else:
            raise RuntimeError("NGSolve's Newton iteration did not converge")
        forces.append(ng.InnerProduct(residual, unit.vec) * 1e-3 * case.thickness * 1e3)
    return np.array(forces), space.ndof, perf_counter() - started


def _energy(law: str, C: Any, thickness: Any) -> Any:
    """NGSolve's energy density [J/m³] of a membrane with the law's defaults, of C (2, 2) and its thickness stretch."""
    import ngsolve as ng

    volume = 0.5 * ng.log(C[0, 0] * C[1, 1] - C[0, 1] * C[0, 1]) + ng.log(thickness)
    p = [parameter.default for parameter in LAWS[law].parameters]
    energy = 0.5 * p[-1] * volume**2
    if law == "ogden":
        middle = 0.5 * (C[0, 0] + C[1, 1])
        radius = ng.sqrt(0.25 * (C[0, 0] - C[1, 1]) ** 2 + C[0, 1] ** 2 + 1e-12)
        for mu, a in ((p[0], p[1]), (p[2], p[3])):
            powers = (middle + radius) ** (a / 2) + (middle - radius) ** (a / 2) + thickness**a
            energy = energy + mu / a * powers * ng.exp(-a / 3 * volume)
    else:
        mu, k1, k2, theta = p[:4]
        x, y = np.cos(theta), np.sin(theta)
        part = ng.exp(-2 / 3 * volume)
        e = part * (x * x * C[0, 0] + 2 * x * y * C[0, 1] + y * y * C[1, 1]) - 1
        trace = part * (C[0, 0] + C[1, 1] + thickness**2)
        energy = energy + mu / 2 * (trace - 3) + k1 / k2 * (ng.exp(k2 * e**2) - 1)
    return energy


def whole_sheet(law: str, loads: tuple[float, float], side: float = 50e-3, size: float = 4.0) -> tuple[Array, Array]:
    """Paper M's two steps on the whole square sheet with NGSolve, elastic, the probe 1.3 mm along x.

    Dead loads on two sides, the opposite ones held normal; then everything outside the hole (radius 20 mm) held and the
    patch (radius 2 mm) displaced. Laws 'ogden' and 'gasser' with their defaults. Returns the force on the probe
    (2,) [N] and the deformation gradient (2, 2) at the centre before the second step.
    """
    import ngsolve as ng
    from netgen.geom2d import SplineGeometry

    case = Case()
    geometry = SplineGeometry()
    half = 0.5e3 * side
    geometry.AddRectangle((-half, -half), (half, half), leftdomain=3, bcs=("bottom", "right", "top", "left"))
    geometry.AddCircle((0, 0), case.outer * 1e3, leftdomain=2, rightdomain=3)
    geometry.AddCircle((0, 0), case.inner * 1e3, leftdomain=1, rightdomain=2, maxh=0.25 * size)
    for number, name in enumerate(("probe", "ring", "support"), start=1):
        geometry.SetMaterial(number, name)
    mesh = ng.Mesh(geometry.GenerateMesh(maxh=size))
    mesh.Curve(3)
    flat = ng.VectorH1(mesh, order=3, dirichletx="left", dirichlety="bottom")
    space = flat * ng.L2(mesh, order=2)
    (u, thickness), _ = space.TnT()
    F = ng.CF((1, 0, 0, 1), dims=(2, 2)) + ng.Grad(u)
    C = F.trans * F
    energy = _energy(law, C, thickness)
    load = ng.Parameter(0.0)
    form = ng.BilinearForm(space, symmetric=False)
    form += ng.Variation((1e-3 * energy).Compile() * ng.dx)
    form += ng.Variation(-1e-3 * load * loads[0] * u[0] * ng.ds("right"))
    form += ng.Variation(-1e-3 * load * loads[1] * u[1] * ng.ds("top"))
    solution = ng.GridFunction(space)
    solution.components[1].Set(ng.CF(1.0))

    def newton(free: ng.BitArray) -> ng.BaseVector:
        residual, update = solution.vec.CreateVector(), solution.vec.CreateVector()
        inside = ng.Projector(free, True)
        for _ in range(30):
            form.AssembleLinearization(solution.vec)
            form.Apply(solution.vec, residual)
            update.data = inside * residual
            if ng.Norm(update) < 1e-8 * ng.Norm(residual) + 1e-10:
                return residual
            update.data = form.mat.Inverse(free, inverse="umfpack") * residual
            solution.vec.data -= update
        raise RuntimeError("NGSolve's Newton iteration did not converge")

    for share in np.linspace(0.0, 1.0, 41)[1:]:
        load.Set(share**2)  # small first: the sheet is soft until it is stretched
        newton(space.FreeDofs())
    centre = np.eye(2) + np.array(ng.Grad(solution.components[0])(mesh(0.0, 0.0))).reshape(2, 2)

    moving = ng.BitArray(space.ndof)
    moving[:] = False
    inner, outer = (flat.GetDofs(mesh.Materials(name)) for name in ("probe", "support"))
    for dof in range(flat.ndof):
        moving[dof] = not inner[dof] and not outer[dof]
    for dof in range(flat.ndof, space.ndof):
        moving[dof] = True
    shift, units = ng.GridFunction(space), [ng.GridFunction(space) for _ in range(2)]
    for k, way in enumerate(((1, 0), (0, 1))):
        units[k].components[0].Set(ng.CF(way), definedon=mesh.Materials("probe"))
        for dof in range(flat.ndof):
            if not inner[dof]:
                units[k].vec[dof] = 0.0
    for _ in range(_STEPS):
        shift.vec.data = (1e3 * case.reach / _STEPS) * units[0].vec
        solution.vec.data += shift.vec
        residual = newton(moving)
    force = np.array([ng.InnerProduct(residual, unit.vec) for unit in units]) * case.thickness
    return force, centre
