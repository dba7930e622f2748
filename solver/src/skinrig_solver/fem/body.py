"""A body on a mesh: unknowns, one time step by Newton's method, and the parameter derivatives of that step.

Unknowns of the linear system are the free displacements of nodes that elements share and, where a probe is present, its
height; θ, p, the elements' middle nodes and the contact pressure λ are eliminated (see `kernels`, `surface`).

Newton's method keeps a factorised tangent over iterations and steps while its corrections contract well enough: see
`newton`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from ..api import Array, SolverError
from ..law import Law
from . import directions as derivatives
from . import kernels, surface
from .linear import Factor, Pattern
from .mesh import GAUSS2, GAUSS3, WEIGHT3, Index, Mesh, line_shapes
from .newton import NEAR, Newton
from .types import Contactness, Directions, Load, Rim, ShapePartial, State, Tangents

SHAPE_STEP = 1e-5  # of the nodes, relative to the length scale, in differences of the residual


class Body:
    """A mesh with a law, fixed displacements, loaded edges and possibly a rim.

    Parameters
    ----------
    fixed : (N, 2) bool, displacements held at zero
    loaded : (k, 3) edges that carry the follower pressure
    scale : length that decides when a Newton correction is small [m]
    """

    def __init__(
        self,
        mesh: Mesh,
        law: Law,
        fixed: NDArray[np.bool_],
        loaded: Index,
        rim: Rim | None,
        scale: float,
        contactness: Contactness | None = None,
    ) -> None:
        self.law, self.loaded, self.rim, self.scale = law, loaded, rim, scale
        self.contactness = contactness or Contactness()
        self.code = law.kernels()
        middle = np.zeros(len(fixed), dtype=bool)
        middle[mesh.elements[:, kernels.MIDDLE]] = True
        middle &= ~fixed.any(axis=1)
        # the middle nodes' unknowns come first, then those of the linear system, the probe's height last
        first, rest = (np.argwhere(~fixed & nodes[:, None]) for nodes in (middle, ~middle))
        number = np.full(fixed.shape, -1, dtype=np.int64)
        number[tuple(np.concatenate([first, rest]).T)] = np.arange(len(first) + len(rest))
        self.middles, self.displacements = len(first), len(first) + len(rest)
        self.size = self.displacements + (rim is not None)
        self.number = number
        self.equations = number[mesh.elements].transpose(0, 2, 1).reshape(-1, 18)
        self.load_equations = number[loaded].reshape(-1, 6)
        groups = [self.equations, self.load_equations]
        if rim is not None:
            probe = np.full((len(rim.edges), 1), self.displacements)
            self.contact_equations = np.hstack([number[rim.edges].reshape(-1, 6), probe])
            groups.append(self.contact_equations)
        self.pattern = Pattern(self.size - self.middles, groups := [np.maximum(g - self.middles, -1) for g in groups])
        self.scatter, self.load_scatter = self.pattern.scatter[:2]
        owners = [mesh.elements] if rim is None else [mesh.elements, rim.edges]
        # the load's edges couple nothing that their elements do not
        self.factor = Factor(self.pattern, groups[::2], [mesh.nodes[nodes].mean(axis=1) for nodes in owners])
        self.shapes2, self.slopes2 = line_shapes(GAUSS2)
        self.shapes3, self.slopes3 = line_shapes(GAUSS3)
        points, elements = 9 * len(mesh.elements), len(mesh.elements)
        self.kin, self.stress = np.empty((points, 6)), np.zeros((points, 6))
        self.tangent, self.by_kin = np.zeros((points, 6, 6)), np.zeros((points, len(law.rest), 6))
        self.memory = np.full((points, self.code.ROOTS), np.nan)
        self.scratch = np.empty((points, len(law.rest)))
        self.rest_history = np.tile(np.array(list(law.rest.values()), dtype=np.float64), (points, 1))
        self.eliminated = kernels.Eliminated.of(elements)
        self.values, self.residual = np.empty(self.pattern.nnz), np.empty(self.size)
        self.delta = np.zeros((self.size, 1))  # Newton's last correction
        self.increment = np.empty(fixed.shape)
        self.spare = np.empty(self.pattern.nnz)  # takes what surfaces add to a tangent that is not wanted
        self.drift = np.inf  # how far the solution has moved since the tangent was factorised [m]
        if rim is not None:
            self.gap, self.work = np.empty((2 * len(rim.edges), 12)), np.empty((2 * len(rim.edges), 6))
        self._moved: dict[tuple[int, float], Mesh] = {}
        self._buffers: list[Array] = []
        self.place(mesh)

    def place(self, mesh: Mesh) -> None:
        """Continue on the same mesh with its nodes elsewhere: topology, pattern and symbolic factors stay."""
        self._moved.clear()
        self._use(mesh)

    def _use(self, mesh: Mesh) -> None:
        self.mesh = mesh
        if self.rim is not None:
            where = mesh.nodes[self.rim.edges]
            length = np.linalg.norm(np.einsum("ka,eac->ekc", self.slopes2, where), axis=-1)
            radius = np.einsum("ka,ea->ek", self.shapes2, where[..., 0])
            self.contact_weights = (length * (2.0 * np.pi * radius if mesh.axisymmetric else 1.0)).ravel()

    def rest(self) -> State:
        """The undeformed, stress-free body with the probe touching it."""
        self.memory[:] = np.nan  # a run must not depend on the one before
        self.drift = np.inf
        self._moved.clear()
        elements = len(self.mesh.elements)
        theta = np.zeros((elements, 3))
        theta[:, 0] = 1.0
        contacts = 0 if self.rim is None else 2 * len(self.rim.edges)
        zero = np.zeros(contacts)
        state = State(
            np.zeros_like(self.mesh.nodes), theta, np.zeros((elements, 3)), self.rest_history.copy(), zero, zero, zero
        ).copy()
        if self.rim is not None:
            self._gaps(state)
            state.slip = self.gap[:, 6].copy()
        return state

    def step(
        self, old: State, guess: State, load: Load, dt: float, parameters: Sequence[Array], time: float, history: bool
    ) -> tuple[State, int, float]:
        """The state after dt [s] under ``load``; ``parameters`` one array a layer in the law's order.

        ``guess`` starts the iteration. Without ``history`` the state's own is left to `differentiate`. Returns the
        state, the number of Newton iterations, and how far [m] it lies from where the tangent in ``factor`` was taken.
        Raises ``SolverError`` where Newton's method does not converge.
        """
        acting = {"pressure": load.pressure} | ({"probe_force": load.force} if load.height is None else {})
        fault = partial(SolverError, time=time, load=acting)
        # an old tangent serves where the body creeps; a step that moves it far, or goes a new way, changes contact
        creeps = guess is not old and float(np.abs(guess.u - old.u).max()) <= NEAR * self.scale
        newton = Newton(self.scale, bool(creeps and np.isfinite(self.drift)))
        self.drift = np.inf if newton.renew else self.scale  # a tangent of another step is not this one's
        new = guess.copy(old.history)
        while newton.begins():
            size = self._correction(old, new, load, dt, parameters, newton.renew, fault)
            if newton.diverges(size):
                break
            if newton.strays(size):
                new = guess.copy(old.history)
                continue
            self._advance(new, self.delta, newton.share(size))
            self.drift += size
            if newton.converges(size):
                self._commit(old, new, load, dt, parameters if history else (), fault)
                return new, newton.iterations, self.drift
        owner = np.argwhere(self.equations == int(np.argmax(np.abs(self.delta))))
        raise fault(
            f"Newton's method did not converge in {newton.iterations} iterations (last correction {size:.3g} m)",
            element=int(owner[0, 0]) if len(owner) else None,
        )

    def _correction(
        self,
        old: State,
        new: State,
        load: Load,
        dt: float,
        parameters: Sequence[Array],
        anew: bool,
        fault: Callable[..., SolverError],
    ) -> float:
        """The size [m] of the correction ``delta`` of ``new``, with a tangent of its own where ``anew``."""
        self._look(new, fault)
        try:
            if anew:
                self._assemble(old, new, load, dt, parameters)
                self._factorise()
            else:
                self._residual(old, new, load, dt, parameters)
        except np.linalg.LinAlgError as error:
            raise fault(str(error)) from error
        self._solve(self.residual[:, None], self.delta)
        size: float = kernels.largest(self.delta)
        if not isfinite(size):
            raise fault("the solution is not finite")
        return size

    def _look(self, state: State, fault: Callable[..., SolverError]) -> None:
        """Its kinematics. Raises ``SolverError`` where an element is inverted."""
        bad = self._kinematics(state)
        if bad >= 0:
            raise fault("an element inverted", element=bad)

    def _factorise(self) -> None:
        self.drift = np.inf  # stays so where the matrix is singular
        self.factor.update(self.values)
        self.drift = 0.0

    def _solve(self, force: Array, delta: Array) -> None:
        """``delta`` = −K⁻¹ force for condensed right-hand sides (equations, m), middle nodes included."""
        np.negative(force, out=delta)
        self.factor.substitute(delta[self.middles :])
        kernels.expand(self.equations, self.eliminated.L, self.eliminated.inverse, force, delta)

    def _workspace(self, history: Array) -> tuple[Array, Array, Array]:
        """dstress, dkin and the next history: kept between steps, since fresh megabytes cost page faults."""
        points, states, m = history.shape
        if not self._buffers or self._buffers[0].shape[2] != m:
            shapes = [(points, 6, m), (points, 6, m), (points, states, m), (points, states, m)]
            self._buffers = [np.empty(shape) for shape in shapes]
        dstress, dkin, first, second = self._buffers
        return dstress, dkin, second if history is first else first

    def shape_partials(
        self, old: State, new: State, load: Load, dt: float, parameters: Sequence[Array], directions: Directions
    ) -> list[ShapePartial]:
        """∂/∂shape at fixed unknowns, by differences of the residual. Leaves the tangent stale."""
        mesh, partials = self.mesh, []
        for column, move in directions.shape:
            step = SHAPE_STEP * self.scale / float(np.max(np.abs(move)))
            sides = []
            for sign in (1.0, -1.0):
                key = (column, sign)
                if key not in self._moved:
                    self._moved[key] = replace(mesh, nodes=mesh.nodes + sign * step * move)
                self._use(self._moved[key])
                self._kinematics(new)
                self._assemble(old, new, load, dt, parameters)
                sides.append((self.residual.copy(), self.eliminated.theta0.copy(), self.kin.copy()))
            force, theta0, kin = ((up - down) / (2.0 * step) for up, down in zip(*sides, strict=True))
            kin[:, 5] += (theta0 @ mesh.points.linear.T).ravel()
            partials.append(ShapePartial(column, force, kin))
            self._use(mesh)
        return partials

    def rest_tangents(self, m: int) -> Tangents:
        contacts = 0 if self.rim is None else 2 * len(self.rim.edges)
        points = 9 * len(self.mesh.elements)
        shape = (points, len(self.law.rest), m)
        return Tangents(np.zeros((self.size, m)), np.zeros(shape), np.zeros((contacts, m)))

    def differentiate(
        self,
        old: State,
        new: State,
        tangents: Tangents,
        load: Load,
        dt: float,
        parameters: Sequence[Array],
        directions: Directions,
        moves: Sequence[ShapePartial] = (),
        anew: bool = True,
    ) -> Tangents:
        """Derivatives of ``new``, whose history is written; ``moves`` from `shape_partials`.

        ``anew`` factorises the tangent at ``new``, for derivatives that are exact to rounding; else the last serves.
        """
        m = tangents.du.shape[1]
        pts = self.mesh.points
        dstress, dkin, history = self._workspace(tangents.history)
        self._kinematics(new)
        new.history = np.empty_like(old.history)
        for (a, b), par, which in zip(self.mesh.layer_points, parameters, directions.law, strict=True):
            self.code.partials(
                a, b, self.kin, old.history, par, dt, self.memory, tangents.history, which,
                self.stress, new.history, self.tangent, dstress, history, self.by_kin,
            )  # fmt: skip
        if anew:
            self._condense(old, new, load)
            self._factorise()
        force = np.zeros((self.size, m))
        derivatives.partial_forces(
            pts.gradients, pts.weights, pts.linear, self.eliminated.Theta, dstress, self.equations, force
        )
        rough = self.rim is not None and load.friction > 0.0
        if rough:
            surface.friction_partials(
                self.shapes2, self.contact_weights, self.gap, self.work, directions.friction, tangents.slip,
                self.contact_equations, force,
            )  # fmt: skip
        if self.rim is not None:
            # a held probe stays where the derivative of its height was left; a pressed one balances the spring
            force[-1] = -tangents.du[-1] if load.height is not None else force[-1] + load.force_slope * directions.force
        kernels.condense(self.equations, self.eliminated.C, force)
        for move in moves:
            force[: self.displacements, move.column] += move.force[: self.displacements]
        du = np.empty_like(force)
        self._solve(force, du)
        derivatives.partial_kinematics(pts.gradients, pts.linear, self.eliminated.Theta, self.equations, du, dkin)
        for move in moves:
            dkin[:, :, move.column] += move.kin
        derivatives.add_products(self.by_kin, dkin, history)
        slip = np.empty_like(tangents.slip)
        if self.rim is not None:
            surface.slip_derivatives(self.shapes2, self.gap, self.contact_equations, du, slip)
        return Tangents(du, history, slip)

    def _kinematics(self, state: State) -> int:
        pts = self.mesh.points
        return int(kernels.kinematics(self.mesh.elements, pts.gradients, pts.linear, state.u, state.theta, self.kin))

    def distortions(self) -> list[float]:
        """Largest isochoric invariant Ĩ1 − 3 of each layer at the state that was solved last."""
        squares = np.einsum("pk,pk->p", self.kin[:, :5], self.kin[:, :5])
        F = self.kin
        volume = (F[:, 0] * F[:, 3] - F[:, 1] * F[:, 2]) * F[:, 4]
        invariant = squares * volume ** (-2.0 / 3.0) - 3.0
        return [float(invariant[a:b].max(initial=0.0)) for a, b in self.mesh.layer_points]

    def _gaps(self, state: State) -> None:
        rim = self.rim
        assert rim is not None
        top = self.mesh.nodes[rim.edges[0, 0], 1]
        surface.contact_points(
            rim.edges, self.mesh.nodes + state.u, self.shapes2, top + state.height, rim.opening, rim.fillet, self.gap
        )

    def _assemble(self, old: State, new: State, load: Load, dt: float, parameters: Sequence[Array]) -> None:
        """Condensed tangent and residual."""
        for (a, b), par in zip(self.mesh.layer_points, parameters, strict=True):
            self.code.stress_tangent(a, b, self.kin, old.history, par, dt, self.memory, self.stress, self.tangent)
        self._condense(old, new, load)

    def _condense(self, old: State, new: State, load: Load) -> None:
        """The same from the points' stress and tangent."""
        pts = self.mesh.points
        self.values[:] = 0.0
        self.residual[:] = 0.0
        kernels.assemble(
            pts.gradients, pts.weights, pts.linear, pts.inverse_mass, self.kin, self.stress, self.tangent, new.p,
            self.scatter, self.equations, self.values, self.residual, self.eliminated,
        )  # fmt: skip
        self._surfaces(old, new, load, self.values)

    def _residual(self, old: State, new: State, load: Load, dt: float, parameters: Sequence[Array]) -> None:
        """The residual as the last tangent condenses it."""
        pts = self.mesh.points
        for (a, b), par in zip(self.mesh.layer_points, parameters, strict=True):
            self.code.stress(a, b, self.kin, old.history, par, dt, self.memory, self.stress, self.scratch)
        self.residual[:] = 0.0
        kernels.residual(
            pts.gradients, pts.weights, pts.linear, pts.inverse_mass, self.kin, self.stress, new.p, self.equations,
            self.residual, self.eliminated,
        )  # fmt: skip
        self._surfaces(old, new, load, self.spare)

    def _surfaces(self, old: State, new: State, load: Load, values: Array) -> None:
        surface.follower(
            self.loaded, self.mesh.nodes, new.u, self.shapes3, self.slopes3, WEIGHT3, load.pressure,
            self.mesh.axisymmetric, self.load_scatter, self.load_equations, values, self.residual,
        )  # fmt: skip
        if self.rim is not None:
            self._contact(old, new, load, values)

    def _contact(self, old: State, new: State, load: Load, values: Array) -> None:
        self._gaps(new)
        surface.contact(
            self.shapes2, self.contact_weights, self.gap, new.lam, new.shear, old.slip, self.contactness.stiffness,
            self.contactness.width, load.friction, self.pattern.scatter[2], self.contact_equations, values,
            self.residual, self.work,
        )  # fmt: skip
        if load.height is None:
            self.residual[-1] += load.force  # the probe's own equilibrium, downwards positive
        else:
            values[self.pattern.indptr[-2] :] = 0.0
            values[self.pattern.diagonal[-1]] = 1.0
            self.residual[-1] = new.height - load.height

    def _advance(self, state: State, delta: Array, factor: float) -> None:
        own = self.eliminated
        kernels.advance(
            self.number, self.mesh.elements, delta, factor, own.Theta, own.theta0, own.Pi, own.pi0, self.increment,
            state.u, state.theta, state.p,
        )  # fmt: skip
        if factor < 1.0:  # a shortened step keeps θ, p and λ: they follow at the next full one
            return
        if self.rim is not None:
            state.height += float(delta[-1, 0])
            surface.advance(
                self.shapes2, self.gap, self.work, self.contact_equations, delta[:, 0], state.lam, state.shear
            )

    def _commit(
        self,
        old: State,
        new: State,
        load: Load,
        dt: float,
        parameters: Sequence[Array],
        fault: Callable[..., SolverError],
    ) -> None:
        """The history that the state at the end of the step leaves behind; no ``parameters``, no history."""
        self._look(new, fault)
        if parameters:
            new.history = np.empty_like(old.history)
            for (a, b), par in zip(self.mesh.layer_points, parameters, strict=True):
                self.code.stress(a, b, self.kin, old.history, par, dt, self.memory, self.stress, new.history)
        if self.rim is not None:
            self._gaps(new)
            new.slip = self.gap[:, 6].copy()
