"""The same Yeoh suction in this solver, felupe and NGSolve: the references of tests and benchmarks.

One layer, elastic, the surface outside the opening held in z and free to slide (a bilateral, frictionless rim without
fillet, since the three codes treat contact differently), follower suction inside, bottom fixed. Every function returns
a `Timing` of the fastest of ``repeats`` runs: what is built once for a geometry, apart from what each run costs.
"""

from __future__ import annotations

from dataclasses import dataclass
from time import process_time
from typing import Any

import numpy as np
from rings import around, mesh_of

from skinrig_solver.fem.body import Body
from skinrig_solver.fem.mesh import Mesh, block, graded
from skinrig_solver.fem.types import Load
from skinrig_solver.materials.yeoh_qlv import yeoh_qlv
from skinrig_solver.suction.march import Run
from skinrig_solver.suction.schedule import Segment


@dataclass(frozen=True)
class Timing:
    """Apex height [m], unknowns of the linear systems, processor seconds to set up and solve, Newton's tolerance."""

    apex: float
    unknowns: int
    setup: float
    solve: float
    tolerance: str


@dataclass(frozen=True)
class Case:
    """Radii, thickness [m]; shear modulus, second Yeoh coefficient [Pa]; Poisson's ratio; suction [Pa]; load steps;
    with a rim, or a free surface that nothing holds down (smoother, so a sharper comparison)."""

    opening: float = 1e-3
    radius: float = 10e-3
    thickness: float = 3e-3
    G: float = 2e4
    c20: float = 1e4
    nu: float = 0.495
    pressure: float = -1e4
    steps: int = 5
    rim: bool = True

    @property
    def bulk(self) -> float:
        return 2.0 * self.G * (1.0 + self.nu) / (3.0 * (1.0 - 2.0 * self.nu))

    def breaks(self, density: float) -> tuple[np.ndarray, np.ndarray]:
        h, growth = 0.05 * self.opening / density, 1.0 + 0.6 / density
        r = np.concatenate(
            [graded(self.opening, 0.0, h, growth)[::-1], graded(self.opening, self.radius, h, growth)[1:]]
        )
        return r, graded(0.0, -self.thickness, 1.5 * h, growth)

    def rings(self, density: float) -> Mesh:
        """A core at the load's edge and rings around it: see `rings`."""
        a, n = self.opening, max(1, round(density))
        h, growth = 0.1 * a / density, 1.0 + 1.7 / density
        core = a + h * np.arange(-n, n + 1)
        r = graded(2.0 * a, self.radius, 1.2 * a / density, growth)
        z = graded(-1.3 * a, -self.thickness, 1.4 * a / density, growth)
        return mesh_of(around(core, -h * np.arange(2 * n + 1), r, z, n))

    def mesh(self, density: float) -> Mesh:
        r, z = self.breaks(density)
        return block(r, z, np.zeros(len(z) - 1, dtype=np.int64), ("tissue",), axisymmetric=True)


def ours(case: Case, density: float, repeats: int = 2, rings: bool = False) -> Timing:
    mesh = case.rings(density) if rings else case.mesh(density)
    law = yeoh_qlv(1)
    fixed = np.zeros(mesh.nodes.shape, dtype=bool)
    fixed[np.unique(mesh.edges["bottom"])] = True
    fixed[np.unique(mesh.edges["left"]), 0] = True
    top = np.unique(mesh.edges["top"])
    if case.rim:
        fixed[top[mesh.nodes[top, 0] >= case.opening * (1 - 1e-9)], 1] = True
    edges = mesh.edges["top"]
    loaded = edges[mesh.nodes[edges][:, :, 0].max(axis=1) <= case.opening * (1 + 1e-9)]
    values = {"G": case.G, "nu": case.nu, "c20": case.c20, "tau1": 1.0}
    parameters = [np.array([values.get(name, 0.0) for name in law.parameters])]
    setup = solve = np.inf
    for _ in range(repeats):
        started = process_time()
        body = Body(mesh, law, fixed, loaded, None, case.opening)
        built = process_time()
        run = Run(body, parameters)
        run.advance(Segment(0.0, 1.0, 0.0, case.pressure, case.steps, 1.0), Load, lambda _: None)
        setup, solve = min(setup, built - started), min(solve, process_time() - built)
    return Timing(float(run.state.u[mesh.edges["top"][0, 0], 1]), body.pattern.size, setup, solve, "1e-6 of opening")


def with_felupe(case: Case, density: float, repeats: int = 2) -> Timing:
    """Biquadratic elements with felupe's nearly incompressible (mean dilatation) body, and PARDISO where installed."""
    import felupe as fem
    from felupe.constitution.tensortrax import Hyperelastic

    def yeoh(C, c10, c20):  # type: ignore[no-untyped-def]
        from tensortrax.math import trace
        from tensortrax.math.linalg import det

        x = det(C) ** (-1 / 3) * trace(C) - 3
        return c10 * x + c20 * x**2

    try:
        from pypardiso import spsolve as solver
    except (ImportError, OSError):
        from scipy.sparse.linalg import spsolve as solver

    ours_mesh = case.mesh(density)
    # felupe numbers a nine-node quadrilateral corners, then edges, then centre
    cells = ours_mesh.elements[:, [0, 2, 8, 6, 1, 5, 7, 3, 4]]
    setup = solve = np.inf
    for _ in range(repeats):
        started = process_time()
        # felupe's axis is the first coordinate
        mesh = fem.Mesh(ours_mesh.nodes[:, ::-1].copy(), cells[:, [0, 3, 2, 1, 7, 6, 5, 4, 8]], "quad9")
        region = fem.RegionBiQuadraticQuad(mesh)
        field = fem.FieldContainer([fem.FieldAxisymmetric(region, dim=2)])
        solid = fem.SolidBodyNearlyIncompressible(Hyperelastic(yeoh, c10=case.G / 2, c20=case.c20), field, case.bulk)
        z, r = mesh.points[:, 0], mesh.points[:, 1]
        rim = (z > -1e-12) & (r >= case.opening * (1 - 1e-9))
        boundaries = {
            "axis": fem.Boundary(field[0], mask=r < 1e-12, skip=(1, 0)),
            "bottom": fem.Boundary(field[0], mask=z < -case.thickness * (1 - 1e-9)),
        }
        if case.rim:
            boundaries["rim"] = fem.Boundary(field[0], mask=rim, skip=(0, 1))
        surface = fem.RegionBiQuadraticQuadBoundary(
            mesh, only_surface=True, mask=(z > -1e-12) & (r <= case.opening * (1 + 1e-9)), ensure_3d=True
        )
        pressure = fem.SolidBodyPressure(fem.FieldContainer([fem.FieldAxisymmetric(surface, dim=2)]))
        ramp = case.pressure * np.arange(1, case.steps + 1) / case.steps
        built = process_time()
        step = fem.Step(items=[solid, pressure], ramp={pressure: ramp}, boundaries=boundaries)
        fem.Job(steps=[step]).evaluate(verbose=0, tol=1e-6, solver=solver)
        setup, solve = min(setup, built - started), min(solve, process_time() - built)
    apex = int(np.argmin(np.abs(z) + r))
    return Timing(float(field[0].values[apex, 0]), 2 * mesh.npoints, setup, solve, "1e-6 of force")


def with_ngsolve(case: Case, density: float, repeats: int = 2, order: int = 4, compiled: bool = False) -> Timing:
    """Triangles with u of ``order`` and p of two orders less, discontinuous: interiors and p condensed by NGSolve.

    The symbolic factors are kept from one iteration to the next. ``compiled`` has NGSolve translate the energy to C++
    (``realcompile``), which needs a compiler and is no part of the seconds. Newton's method ends as ours does: where
    the last correction times its contraction is small.
    """
    import ngsolve as ng
    from netgen.geom2d import SplineGeometry

    ng.ngsglobals.msg_level = 0
    ng.SetNumThreads(1)
    geometry = SplineGeometry()
    a, R, H, fine = 1.0, case.radius / case.opening, case.thickness / case.opening, 0.2 / density
    corners = [(0, -H), (R, -H), (R, 0), (a, 0), (0, 0)]
    points = [geometry.AppendPoint(*xy, maxh=fine if xy == (a, 0) else 10 * R) for xy in corners]
    for i, name in enumerate(("bottom", "side", "rim", "opening", "axis")):
        geometry.Append(["line", points[i], points[(i + 1) % 5]], bc=name)
    mesh = ng.Mesh(geometry.GenerateMesh(maxh=R / density, grading=0.9))  # the coarsest: high orders need few cells
    # lengths in units of the opening, stresses of the modulus
    ur = ng.H1(mesh, order=order, dirichlet="bottom|axis")
    uz = ng.H1(mesh, order=order, dirichlet="bottom|rim" if case.rim else "bottom")
    space = ur * uz * ng.L2(mesh, order=order - 2)
    (u, w, p), (v, s, _) = space.TnT()
    gu, gw = ng.grad(u), ng.grad(w)
    frr, frz, fzr, fzz, ftt = 1 + gu[0], gu[1], gw[0], 1 + gw[1], 1 + u / ng.x
    J = (frr * fzz - frz * fzr) * ftt
    shear = J ** (-2 / 3) * (frr**2 + frz**2 + fzr**2 + fzz**2 + ftt**2) - 3
    ring, k = 2 * np.pi * ng.x, case.bulk / case.G
    energy = 0.5 * shear + case.c20 / case.G * shear**2 + p * (J - 1) - p**2 / (2 * k)
    load, t = ng.Parameter(0.0), ng.specialcf.tangential(2)
    tu, tw = ng.grad(u).Trace() * t, ng.grad(w).Trace() * t
    flow = 2 * np.pi * (ng.x + u) * (-(t[1] + tw) * v.Trace() + (t[0] + tu) * s.Trace())
    options = {"realcompile": True, "wait": True} if compiled else {}
    form = ng.BilinearForm(space, condense=True)
    form += ng.Variation((energy * ring).Compile(**options) * ng.dx(bonus_intorder=2))
    # the opening runs towards the axis, so the outward normal is minus the rotated tangent
    form += (-load * flow * ng.ds("opening")).Compile(**options)
    setup = solve = np.inf
    inverse = None
    for _ in range(repeats):
        started = process_time()
        solution = ng.GridFunction(space)
        solution.vec[:] = 0.0
        with ng.TaskManager():
            for i in range(1, case.steps + 1):
                load.Set(case.pressure / case.G * i / case.steps)
                inverse = _ngsolve_newton(ng, form, space, solution, inverse)
        setup, solve = min(setup, 0.0), min(solve, process_time() - started)
    free = sum(1 for x in space.FreeDofs(True) if x)
    apex = case.opening * float(solution.components[1](mesh(1e-9, 0.0)))
    return Timing(apex, free, setup, solve, "1e-6 of opening")


def _ngsolve_newton(ng: Any, form: Any, space: Any, solution: Any, inverse: Any, tolerance: float = 1e-6) -> Any:
    """Solves for the load that is set; returns the factors, whose symbolic part serves again."""
    residual, step = solution.vec.CreateVector(), solution.vec.CreateVector()
    moving = np.zeros(space.ndof, dtype=bool)
    for part in (space.Range(0), space.Range(1)):
        moving[part.start : part.stop] = True
    previous = None
    for _ in range(25):
        form.AssembleLinearization(solution.vec)
        form.Apply(solution.vec, residual)
        residual.data += form.harmonic_extension_trans * residual
        if inverse is None:
            inverse = form.mat.Inverse(space.FreeDofs(True), inverse="umfpack")
        else:
            inverse.Update()
        step.data = inverse * residual
        step.data += form.harmonic_extension * step
        step.data += form.inner_solve * residual
        solution.vec.data -= step
        size = float(np.abs(step.FV().NumPy()[moving]).max())
        # before a second correction nothing is known of how they contract
        if size * (1.0 if previous is None else min(1.0, size / previous)) <= tolerance:
            return inverse
        previous = size
    raise ArithmeticError("NGSolve: Newton's method did not converge")
