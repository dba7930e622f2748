"""From parameters and a probe's path to forces: the pre-stress step, the elastic response along rays, relaxation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..api import Array, Field, SolverError
from ..laws import Law
from .equilibrium import Sheet, Work
from .options import Options
from .prestress import stretch, unstretched
from .rays import Ray, fold, rays
from .viscoelastic import Prony

_ON_RAY = 1e-7  # m: samples this near to a ray need no derivatives across it
_REST = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])


@dataclass(frozen=True)
class _Table:
    """The elastic force at a ray's points.

    force (k, 3), tangent (k, 3, 3), derivatives (k, m + 2, 3) and their change sideways (k, 2, m + 2, 3).
    """

    force: Array
    tangent: Array
    derivatives: Array
    sideways: Array


class Response:
    """One set of parameters under one set of options.

    ``values`` holds the law's parameters, sx, sy and the relaxation's. Raises SolverError where the pre-stress finds no
    stable state.
    """

    def __init__(self, law: Law, values: Mapping[str, float], options: Options) -> None:
        self.law, self.options = law, options
        self.p = np.array([values[symbol] for symbol in law.symbols])
        self.loads = np.array([values["sx"], values["sy"]])
        self.prony = Prony((values["gbar"], values["gbar2"]), (values["tau"], values["tau2"]))
        self.creep, self.creep_rate = 1.0, np.zeros(4)
        if not np.isfinite(law.energy(_REST, self.p)):
            raise SolverError(f"the {law.name} law has no stress at rest: {law.domain}")
        self.state = unstretched(self.p)
        if options.prestress_mode == "load":
            self.creep, self.creep_rate = self.prony.creep_factor(options.prestress_ramp)
            self.state = stretch(law, self.p, self.creep * self.loads)
        self.work = Work()
        self.field: Field | None = None

    def sheet(self) -> Sheet:
        """The pre-stressed sheet with the probe at rest."""
        return Sheet(
            self.law,
            self.p,
            self.options.mesh(),
            self.options.thickness,
            self.state,
            self.options.frame == "spatial",
            self.loads if self.options.prestress_mode == "initial" else None,
        )

    def elastic(self, time: Array, positions: Array, sensitivities: bool) -> tuple[Array, Array]:
        """Instantaneous force (n, 3) on positions (n, 3) and its derivatives (m + 2, n, 3) as in Sheet.linearise."""
        folded, signs = fold(positions, self.law.aligned)
        force = np.zeros_like(positions)
        derivatives = np.zeros((len(self.p) + 2 if sensitivities else 0, *positions.shape))
        for ray in rays(folded):
            near = folded[ray.samples]
            off = near @ ray.across.T
            table = self._solve(ray, float(time[ray.farthest]), np.abs(off).max(axis=0), sensitivities)
            weights = ray.weights(near, self.options.points)
            across = np.einsum("sk,kij,wj,sw->si", weights, table.tangent, ray.across, off, optimize=True)
            force[ray.samples] = weights @ table.force + across
            if sensitivities:
                derivatives[:, ray.samples] = np.einsum("sk,kmi->msi", weights, table.derivatives)
                if table.sideways.any():
                    change = np.einsum("sk,kwmi,sw->msi", weights, table.sideways, off, optimize=True)
                    derivatives[:, ray.samples] += change
        return force * signs, derivatives * signs

    def _solve(self, ray: Ray, time: float, spread: Array, sensitivities: bool) -> _Table:
        """Solve at the ray's points; ``spread`` (2,) [m] is how far samples lie from it across."""
        sheet = self.sheet()
        many = len(self.p) + 2
        forces, tangents, derivatives, sideways = [], [], [], []
        normal, sides = 0.0, np.zeros((2, many, 3))  # kept from the last point where a flat membrane was taut
        for distance in ray.points(self.options.points):
            sheet.move(distance * ray.direction, time)
            tangent, slopes = sheet.linearise(sensitivities)
            taut = bool(np.isfinite(tangent[2, 2]))
            normal = tangent[2, 2] = tangent[2, 2] if taut else normal
            forces.append(sheet.force)
            tangents.append(tangent)
            derivatives.append(slopes)
            for k in range(2 if sensitivities else 0):
                if spread[k] > _ON_RAY and (taut or not ray.across[k, 2]):
                    sides[k] = sheet.sideways(ray.across[k], spread[k], slopes)
            sideways.append(sides.copy())
        self.work.iterations += sheet.work.iterations
        self.work.steps += sheet.work.steps
        self.work.cuts += sheet.work.cuts
        self.field = sheet.picture(time)
        return _Table(np.array(forces), np.array(tangents), np.array(derivatives), np.array(sideways))

    def pictures(self, time: Array, positions: Array, moments: Sequence[float]) -> tuple[Field, ...]:
        """Fields at ``moments`` [s] of the probe's path (n, 3): the elastic sheet with the probe where it is then."""
        found = []
        for moment in moments:
            sheet = self.sheet()
            sheet.move(np.array([np.interp(moment, time, way) for way in positions.T]), moment)
            found.append(sheet.picture(moment, whole=True))
        return tuple(found)

    def force(self, time: Array, positions: Array, sensitivities: bool) -> tuple[Array, Array]:
        """Relaxed force (n, 3) and derivatives (m + 6, n, 3) by the law's parameters, sx, sy and the relaxation's."""
        elastic, by_state = self.elastic(time, positions, sensitivities)
        force = self.prony.relax(time, elastic)
        if not sensitivities:
            return force, np.empty((0, *force.shape))
        by_creep = np.tensordot(self.loads, by_state[-2:], 1)
        by_state[-2:] *= self.creep
        relaxed = np.stack([self.prony.relax(time, row) for row in (*by_state, by_creep)])
        by_relaxation = self.prony.relax_derivatives(time, elastic) + self.creep_rate[:, None, None] * relaxed[-1]
        return force, np.concatenate([relaxed[:-1], by_relaxation])
