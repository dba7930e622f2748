"""Equilibrium of the pre-stretched sheet under a displaced probe: Newton's method, step cutting, derivatives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import SuperLU, splu

from ..api import Array, Field, SolverError
from ..laws import Law
from ..nodal import VTK, Split, quantities, six
from .kernels import assemble, differentiate
from .mesh import Mesh
from .prestress import Prestress
from .system import System, matrix, system

_TOLERANCE = 1e-9  # unbalanced nodal force relative to the largest nodal force in the sheet
_ITERATIONS = 25
_GROWTH = 10.0  # an update that raises the unbalanced force by more is halved, at most four times
_SMALLEST_SHARE = 1.0 / 16.0
_SMALLEST_STEP = 1.0 / 512.0
_DRIVE = ("probe_x", "probe_y", "probe_z")


@dataclass
class Work:
    """Counters a run reports."""

    iterations: int = 0
    steps: int = 0
    cuts: int = 0


class Sheet:
    """A sheet held around the hole and glued to the probe; ``move`` displaces the probe from where it is.

    Parameters
    ----------
    law, p : the law and its parameters (m,)
    mesh : ring of the membrane or solid; ``thickness`` [m] of the stress-free sheet multiplies a membrane's areas
    state : the pre-stretched state, from which displacements count
    spatial : the mesh lies on the pre-stretched sheet (hole and probe round there), else on the stress-free one
    initial : (sx, sy) [Pa], an initial stress in the sheet as it lies, or None
    """

    def __init__(
        self,
        law: Law,
        p: Array,
        mesh: Mesh,
        thickness: float,
        state: Prestress,
        spatial: bool = False,
        initial: Array | None = None,
    ) -> None:
        self.law, self.p, self.mesh, self.state, self.spatial = law, p, mesh, state, spatial
        d = mesh.dimension
        self.F0 = np.zeros((3, d))
        self.F0[:2, :2] = state.F
        if d == 3:
            self.F0[2, 2] = np.sqrt(state.c33)
        carried = np.ones(d)
        if spatial:
            carried[:2] = state.stretches
        self.gradients = np.ascontiguousarray(mesh.gradients * carried)
        self.weights = mesh.weights * ((thickness if d == 2 else 1.0) / carried.prod())
        shape = mesh.weights.shape
        self.scale = 1.0  # the acting stress is scale S_e + extra (kernels.py)
        self.extra = np.zeros((*shape, 6))
        self.initial = initial
        if initial is not None:
            self.extra[..., :2] = initial
        self.elastic = np.broadcast_to(state.elastic, (*shape, 6)).copy()
        self.c33 = np.full(shape, state.c33)
        self.u = np.zeros((len(mesh.nodes), 3))
        self.f = np.zeros_like(self.u)
        self.probe = np.zeros(3)
        self.work = Work()
        self._predictor: Array | None = None  # du_free / d(probe) with its sign turned

    # ---------------------------------------------------------------------------------------------------- solving
    def move(self, to: Array, time: float = np.nan) -> None:
        """Displace the probe to ``to`` (3,) [m]; raises SolverError (with ``time``) where no step is small enough."""
        start, done, step = self.probe.copy(), 0.0, 1.0
        numbers = system(self.mesh, self._flat and not to[2])
        while done < 1.0:
            target = start + min(1.0, done + step) * (to - start)
            before = self.u.copy(), self.c33.copy()
            trouble = self._equilibrate(numbers, target)
            if trouble is None:
                done, step = min(1.0, done + step), 2.0 * step
                self.probe = target
                self.work.steps += 1
                continue
            self.u, self.c33 = before
            self._predictor = None
            step *= 0.5
            self.work.cuts += 1
            if step < _SMALLEST_STEP:
                reason, element = trouble
                load = dict(zip(_DRIVE, target.tolist(), strict=True))
                raise SolverError(f"the sheet found no equilibrium: {reason}", time=time, load=load, element=element)

    @property
    def _flat(self) -> bool:
        return self.mesh.dimension == 2 and not self.u[:, 2].any()

    def _equilibrate(self, numbers: System, target: Array) -> tuple[str, int | None] | None:
        """Newton iteration at one probe position; None, or what went wrong and in which element."""
        free = numbers.equations >= 0
        if self._predictor is not None and len(self._predictor) == numbers.size:
            self.u[free] -= self._predictor @ (target - self.probe)
        self.u[self.mesh.probe] = target
        error, step, share = np.inf, np.zeros(numbers.size), 1.0
        for _ in range(_ITERATIONS):
            element, K, Kp, _ = self._assemble(numbers)
            self.work.iterations += 1
            residual = self.f[free]
            worse = np.inf if element >= 0 else float(np.abs(residual).max())
            if not worse <= _GROWTH * error and share > _SMALLEST_SHARE:  # also where it is not a number
                share *= 0.5
                self.u[free] += share * step
                continue
            if element >= 0:
                return "an element has no stress", element
            error = worse
            factor = self._factor(numbers, K)
            if factor is None:
                return "the tangent is singular", self._loudest(free)
            if error <= _TOLERANCE * np.abs(self.f).max() + 1e-14:
                self._predictor = factor.solve(Kp)
                return None
            step, share = factor.solve(residual), 1.0
            self.u[free] -= step
        return "Newton's method did not converge", self._loudest(free)

    def _assemble(self, numbers: System) -> tuple[int, Array, Array, Array]:
        K, Kp, Kpp = np.empty(len(numbers.indices)), np.empty((numbers.size, 3)), np.empty((3, 3))
        element = assemble(
            self.law.point, self.p, self.gradients, self.weights, self.mesh.cells, numbers.equations, numbers.places,
            self.F0, self.u, self.scale, self.extra, self.c33, self.elastic, self.f, K, Kp, Kpp,
        )  # fmt: skip
        return element, K, Kp, Kpp

    @staticmethod
    def _factor(numbers: System, K: Array) -> SuperLU | None:
        try:
            return splu(
                matrix(numbers, K), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
            )
        except RuntimeError:
            return None

    def _loudest(self, free: NDArray[np.bool_]) -> int:
        """The element at the node with the largest unbalanced force."""
        node = int(np.argmax(np.abs(np.where(free, self.f, 0.0)).max(axis=1)))
        return int(np.argmax((self.mesh.cells == node).any(axis=1)))

    # -------------------------------------------------------------------------------------------------- responses
    @property
    def force(self) -> Array:
        """Force the sheet exerts on the probe (3,) [N]."""
        return np.asarray(-self.f[self.mesh.probe].sum(axis=0))

    def linearise(self, sensitivities: bool = False) -> tuple[Array, Array]:
        """Derivatives of ``force`` at equilibrium: by the probe's position (3, 3) [N/m], and by parameters (m + 2, 3).

        The parameters are the law's, then the elastic pre-stress (sx, sy) behind the state; without ``sensitivities``
        the second array is empty. Adjoint: three solves serve them all. A flat membrane under compression (it would
        wrinkle; the skin's bending stiffness holds it) has no meaningful normal stiffness: nan stands there.
        """
        if sensitivities and self.mesh.dimension == 3:
            raise ValueError("sensitivities are available for the membrane only")
        numbers = system(self.mesh)
        _, K, Kp, Kpp = self._assemble(numbers)
        factor = self._factor(numbers, K)
        # without pivoting the signs of U's diagonal are those of the tangent's eigenvalues
        slack = self._flat and (factor is None or not (factor.U.diagonal() > 0.0).all())
        if slack:
            numbers = system(self.mesh, plane=True)
            _, K, Kp, Kpp = self._assemble(numbers)
            factor = self._factor(numbers, K)
        if factor is None:
            load = dict(zip(_DRIVE, self.probe.tolist(), strict=True))
            raise SolverError("the sheet's tangent is singular", load=load)
        adjoint = factor.solve(Kp)
        tangent = Kp.T @ adjoint - Kpp
        if slack:
            tangent[2, 2] = np.nan
        if not sensitivities:
            return tangent, np.empty((0, 3))
        many = self.p.size + 2
        dF0, frame, dextra = np.zeros((many, 3, 2)), np.zeros((many, 2, 2)), np.zeros((many, 6))
        if self.initial is not None:
            dextra[-2, 0] = dextra[-1, 1] = 1.0
        else:
            for i in range(2):
                dF0[:, i, i] = self.state.derivatives[:, i]
                if self.spatial:
                    frame[:, i, i] = self.state.derivatives[:, i] / self.state.stretches[i]
        df = np.empty((many, len(self.u), 3))
        differentiate(
            self.law.point, self.p, self.gradients, self.weights, self.mesh.cells,
            self.F0, self.u, self.scale, self.extra, self.c33, dF0, frame, dextra, df,
        )  # fmt: skip
        at_probe = df[:, self.mesh.probe].sum(axis=1)
        return tangent, df[:, numbers.equations >= 0] @ adjoint - at_probe

    def sideways(self, way: Array, distance: float, slopes: Array) -> Array:
        """How the parameters' derivatives ``slopes`` of ``linearise`` change per metre along ``way`` (m + 2, 3).

        A secant over ``distance`` [m]; the sheet is put back where it was.
        """
        before = self.u.copy(), self.c33.copy(), self.probe, self.f.copy(), self.elastic.copy(), self._predictor
        self.move(self.probe + distance * way)
        moved = self.linearise(True)[1]
        self.u, self.c33, self.probe, self.f, self.elastic, self._predictor = before
        return (moved - slopes) / distance

    def picture(self, time: float, whole: bool = False) -> Field:
        """Mesh and position relative to the probe's rest, for pictures; z is zero on a membrane's mesh.

        ``whole`` adds stress and stretch of a membrane, as they act at this instant: the pre-stress is in them, the
        relaxation is not where it acts on the force alone.
        """
        nodes = np.zeros((len(self.mesh.nodes), 3))
        nodes[:, : self.mesh.dimension] = self.mesh.nodes
        layer = np.zeros(len(self.mesh.surface), dtype=np.int64)
        values = {}
        if whole and self.mesh.dimension == 2:
            nodal = Split.of(self.mesh.cells, layer).at_nodes(self._at_points())
            values = quantities(nodal[:, :9], nodal[:, 9:])
        return Field(nodes, self.u.copy(), self.mesh.surface[:, VTK], layer, ("skin",), time, values)

    def _at_points(self) -> Array:
        """F (9) and Cauchy stress (6) at a membrane's Gauss points: (9 e, 15)."""
        plane = self.F0 + np.einsum("eai,eqaj->eqij", self.u[self.mesh.cells], self.gradients)
        normal = np.cross(plane[..., 0], plane[..., 1])
        normal *= (np.sqrt(self.c33) / np.linalg.norm(normal, axis=-1))[..., None]
        F = np.concatenate([plane, normal[..., None]], axis=-1).reshape(-1, 3, 3)
        acting = (self.scale * self.elastic + self.extra).reshape(-1, 6)
        S = acting[:, [[0, 3, 5], [3, 1, 4], [5, 4, 2]]]
        cauchy = F @ S @ F.transpose(0, 2, 1) / np.linalg.det(F)[:, None, None]
        return np.concatenate([F.reshape(-1, 9), six(cauchy)], axis=1)
