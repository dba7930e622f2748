"""A body on a mesh: unknowns, one time step by Newton's method, and the parameter derivatives of that step.

Unknowns of the linear system are the free displacements and, where a probe is present, its height; θ, p and the contact
pressure λ are eliminated point- or element-wise (see `kernels`, `surface`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..api import Array, SolverError
from ..law import Law
from . import kernels, surface
from .linear import Factor, Pattern
from .mesh import GAUSS2, GAUSS3, WEIGHT3, Index, Mesh, line_shapes

MAX_NEWTON = 14
TOLERANCE = 3e-5  # accepted relative to the length scale; the step that follows it is quadratically smaller


@dataclass(frozen=True)
class Rim:
    """A rigid annulus with a rounded bore above the edges ``edges`` (k, 3), free to move along z.

    ``opening`` and ``fillet`` radii [m]; ``friction`` coefficient enters per run.
    """

    edges: Index
    opening: float
    fillet: float


@dataclass
class State:
    """Everything that a step starts from. Arrays: u (N, 2) [m], theta and p (E, 3), history (points, states), lam, slip
    and shear (contact points,), and the probe's ``height`` above its rest on the undeformed surface [m]."""

    u: Array
    theta: Array
    p: Array
    history: Array
    lam: Array
    slip: Array
    shear: Array
    height: float = 0.0

    def copy(self) -> State:
        u, theta, p, history = self.u.copy(), self.theta.copy(), self.p.copy(), self.history.copy()
        return State(u, theta, p, history, self.lam.copy(), self.slip.copy(), self.shear.copy(), self.height)


@dataclass
class Tangents:
    """Derivatives of a state by m parameters: du (equations, m), history (points, states, m), slip (contacts, m)."""

    du: Array
    history: Array
    slip: Array


@dataclass(frozen=True)
class Load:
    """What acts during a step: gauge ``pressure`` on the loaded edges [Pa], and the probe: held at ``height`` [m], or
    pressed down with ``force`` [N] where height is None. ``friction`` is Coulomb's coefficient; ``force_slope`` the
    derivative of force by the spring's force."""

    pressure: float
    height: float | None = 0.0
    force: float = 0.0
    friction: float = 0.0
    force_slope: float = 1.0


@dataclass(frozen=True)
class Directions:
    """The m parameters of a differentiation.

    ``law`` one (m,) array a layer: the index of the law parameter that direction j is there, −1 for none; ``friction``
    and ``force`` (m,) derivatives of Coulomb's coefficient and of the spring's force.
    """

    law: tuple[Index, ...]
    friction: Array
    force: Array


@dataclass(frozen=True)
class Contactness:
    """Numerical constants of contact: ``stiffness`` c [Pa/m] and smoothing ``width`` [Pa], see `surface`."""

    stiffness: float = 2e8
    width: float = 40.0


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
        backend: str | None = None,
    ) -> None:
        self.mesh, self.law, self.loaded, self.rim, self.scale = mesh, law, loaded, rim, scale
        self.contactness = contactness or Contactness()
        self.code = law.kernels()
        number = np.full(fixed.shape, -1, dtype=np.int64)
        number[~fixed] = np.arange(np.count_nonzero(~fixed))
        self.free = ~fixed
        self.displacements = int(number.max()) + 1
        self.size = self.displacements + (rim is not None)
        self.number = number
        self.equations = number[mesh.elements].reshape(-1, 18)
        self.load_equations = number[loaded].reshape(-1, 6)
        groups = [self.equations, self.load_equations]
        if rim is not None:
            probe = np.full((len(rim.edges), 1), self.displacements)
            self.contact_equations = np.hstack([number[rim.edges].reshape(-1, 6), probe])
            groups.append(self.contact_equations)
        self.pattern = Pattern(self.size, groups)
        self.scatter, self.load_scatter = self.pattern.scatter[:2]
        self.factor = Factor(self.pattern, backend)
        self.shapes2, slopes2 = line_shapes(GAUSS2)
        self.shapes3, self.slopes3 = line_shapes(GAUSS3)
        points, elements = 9 * len(mesh.elements), len(mesh.elements)
        self.kin, self.stress = np.empty((points, 6)), np.zeros((points, 6))
        self.tangent, self.by_kin = np.zeros((points, 6, 6)), np.zeros((points, len(law.rest), 6))
        self.memory = np.full((points, self.code.ROOTS), np.nan)
        self.Theta, self.Pi = np.empty((elements, 3, 18)), np.empty((elements, 3, 18))
        self.theta0, self.pi0 = np.empty((elements, 3)), np.empty((elements, 3))
        self.values, self.residual = np.empty(self.pattern.nnz), np.empty(self.size)
        if rim is not None:
            where = mesh.nodes[rim.edges]
            length = np.linalg.norm(np.einsum("ka,eac->ekc", slopes2, where), axis=-1)
            radius = np.einsum("ka,ea->ek", self.shapes2, where[..., 0])
            self.contact_weights = (length * (2.0 * np.pi * radius if mesh.axisymmetric else 1.0)).ravel()
            self.gap, self.work = np.empty((2 * len(rim.edges), 12)), np.empty((2 * len(rim.edges), 6))

    @cached_property
    def _rest_history(self) -> Array:
        return np.tile(np.array(list(self.law.rest.values()), dtype=np.float64), (9 * len(self.mesh.elements), 1))

    def rest(self) -> State:
        """The undeformed, stress-free body with the probe touching it."""
        self.memory[:] = np.nan  # a run must not depend on the one before
        elements = len(self.mesh.elements)
        theta = np.zeros((elements, 3))
        theta[:, 0] = 1.0
        contacts = 0 if self.rim is None else 2 * len(self.rim.edges)
        zero = np.zeros(contacts)
        state = State(
            np.zeros_like(self.mesh.nodes), theta, np.zeros((elements, 3)), self._rest_history.copy(), zero, zero, zero
        ).copy()
        if self.rim is not None:
            self._gaps(state)
            state.slip = self.gap[:, 6].copy()
        return state

    def step(
        self, old: State, guess: State, load: Load, dt: float, parameters: Sequence[Array], time: float
    ) -> tuple[State, int, float]:
        """The state after dt [s] under ``load``; ``parameters`` one array a layer in the law's order.

        ``guess`` starts the iteration. Returns the state, the number of Newton iterations and the last correction [m];
        the factorised tangent of the last iteration stays in ``factor``. Raises ``SolverError`` where Newton's method
        does not converge.
        """
        new = guess.copy()
        new.history = old.history
        trouble = {"pressure": load.pressure} | ({"probe_force": load.force} if load.height is None else {})
        before = np.inf
        for iteration in range(1, MAX_NEWTON + 1):
            bad = self._kinematics(new)
            if bad >= 0:
                raise SolverError("an element inverted", time=time, load=trouble, element=bad)
            self._assemble(old, new, load, dt, parameters)
            try:
                self.factor.update(self.values)
                delta = -self.factor.solve(self.residual)
            except np.linalg.LinAlgError as error:
                raise SolverError(str(error), time=time, load=trouble) from error
            size = float(np.max(np.abs(delta)))
            if not np.isfinite(size):
                raise SolverError("the solution is not finite", time=time, load=trouble)
            if iteration > 6 and size > 2.0 * before:
                break
            before = min(before, size)
            # far from the solution a full step may fold elements: move no node further than the length scale
            self._advance(new, delta, min(1.0, 0.5 * self.scale / size) if size > 0 else 1.0)
            if size <= TOLERANCE * self.scale:
                self._commit(old, new, load, dt, parameters, time)
                return new, iteration, size
        worst = int(np.argmax(np.abs(delta)))
        owner = np.argwhere(self.equations == worst)
        raise SolverError(
            f"Newton's method did not converge in {iteration} iterations (last correction {size:.3g} m)",
            time=time,
            load=trouble,
            element=int(owner[0, 0]) if len(owner) else None,
        )

    def relinearise(self, old: State, new: State, load: Load, dt: float, parameters: Sequence[Array]) -> None:
        """Factorise the tangent at a converged state, for derivatives that are exact to rounding."""
        self._kinematics(new)
        self._assemble(old, new, load, dt, parameters)
        self.factor.update(self.values)

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
    ) -> Tangents:
        """Derivatives of ``new``, with the tangent last factorised."""
        m = tangents.du.shape[1]
        pts = self.mesh.points
        dstress, history = np.empty((len(self.kin), 6, m)), np.empty_like(tangents.history)
        for (a, b), par, which in zip(self.mesh.layer_points(), parameters, directions.law, strict=True):
            self.code.partials(
                a,
                b,
                self.kin,
                old.history,
                par,
                dt,
                self.memory,
                tangents.history,
                which,
                dstress,
                history,
                self.by_kin,
            )
        force = np.zeros((self.size, m))
        kernels.partial_forces(pts.gradients, pts.weights, pts.linear, self.Theta, dstress, self.equations, force)
        rough = self.rim is not None and load.friction > 0.0
        if rough:
            surface.friction_partials(
                self.shapes2, self.contact_weights, self.gap, self.work, directions.friction, tangents.slip,
                self.contact_equations, force,
            )  # fmt: skip
        if self.rim is not None:
            # a held probe stays where the derivative of its height was left; a pressed one balances the spring
            force[-1] = -tangents.du[-1] if load.height is not None else force[-1] + load.force_slope * directions.force
        du = np.ascontiguousarray(-self.factor.solve(force))
        dkin = np.empty((len(self.kin), 6, m))
        kernels.partial_kinematics(pts.gradients, pts.linear, self.Theta, self.equations, du, dkin)
        kernels.add_products(self.by_kin, dkin, history)
        slip = np.empty_like(tangents.slip)
        if self.rim is not None:
            surface.slip_derivatives(self.shapes2, self.gap, self.contact_equations, du, slip)
        return Tangents(du, history, slip)

    def _kinematics(self, state: State) -> int:
        pts = self.mesh.points
        bad: int = kernels.kinematics(self.mesh.elements, pts.gradients, pts.linear, state.u, state.theta, self.kin)
        return bad

    def _gaps(self, state: State) -> None:
        rim = self.rim
        assert rim is not None
        top = self.mesh.nodes[rim.edges[0, 0], 1]
        surface.contact_points(
            rim.edges, self.mesh.nodes + state.u, self.shapes2, top + state.height, rim.opening, rim.fillet, self.gap
        )

    def _assemble(self, old: State, new: State, load: Load, dt: float, parameters: Sequence[Array]) -> None:
        pts = self.mesh.points
        for (a, b), par in zip(self.mesh.layer_points(), parameters, strict=True):
            self.code.stress_tangent(a, b, self.kin, old.history, par, dt, self.memory, self.stress, self.tangent)
        self.values[:] = 0.0
        self.residual[:] = 0.0
        kernels.assemble(
            pts.gradients, pts.weights, pts.linear, pts.inverse_mass, self.kin, self.stress, self.tangent, new.p,
            self.scatter, self.equations, self.values, self.residual, self.Theta, self.theta0, self.Pi, self.pi0,
        )  # fmt: skip
        positions = self.mesh.nodes + new.u
        surface.follower(
            self.loaded, positions, self.shapes3, self.slopes3, WEIGHT3, load.pressure, self.mesh.axisymmetric,
            self.load_scatter, self.load_equations, self.values, self.residual,
        )  # fmt: skip
        if self.rim is not None:
            self._contact(old, new, load)

    def _contact(self, old: State, new: State, load: Load) -> None:
        self._gaps(new)
        surface.contact(
            self.shapes2, self.contact_weights, self.gap, new.lam, new.shear, old.slip, self.contactness.stiffness,
            self.contactness.width, load.friction, self.pattern.scatter[2], self.contact_equations, self.values,
            self.residual, self.work,
        )  # fmt: skip
        probe = self.size - 1
        if load.height is None:
            self.residual[probe] += load.force  # the probe's own equilibrium, downwards positive
        else:
            row = slice(self.pattern.indptr[probe], self.pattern.indptr[probe + 1])
            self.values[row] = 0.0
            self.values[self.pattern.diagonal[probe]] = 1.0
            self.residual[probe] = new.height - load.height

    def _advance(self, state: State, delta: Array, factor: float) -> None:
        du = np.zeros_like(state.u)
        du[self.free] = factor * delta[: self.displacements]
        state.u += du
        if factor < 1.0:  # a shortened step keeps θ, p and λ: they follow at the next full one
            return
        kernels.update(self.mesh.elements, du, self.Theta, self.theta0, self.Pi, self.pi0, state.theta, state.p)
        if self.rim is not None:
            state.height += float(delta[-1])
            surface.advance(self.shapes2, self.gap, self.work, self.contact_equations, delta, state.lam, state.shear)

    def _commit(self, old: State, new: State, load: Load, dt: float, parameters: Sequence[Array], time: float) -> None:
        """History at the end of the step."""
        bad = self._kinematics(new)
        if bad >= 0:
            raise SolverError("an element inverted", time=time, load={"pressure": load.pressure}, element=bad)
        new.history = np.empty_like(old.history)
        for (a, b), par in zip(self.mesh.layer_points(), parameters, strict=True):
            self.code.stress(a, b, self.kin, old.history, par, dt, self.memory, self.stress, new.history)
        if self.rim is not None:
            self._gaps(new)
            new.slip = self.gap[:, 6].copy()
