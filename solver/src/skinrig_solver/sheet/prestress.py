"""The pre-stress step: dead loads stretch the sheet before the probe is glued on.

Two adjacent sides are held normal, the opposite ones carry nominal stresses (force per stress-free area) sx and sy.
The sheet stretches homogeneously, F0 = diag(l_x, l_y) with P11 = sx and P22 = sy: exact where x and y are axes of
material symmetry; with oblique fibres it is the held state in which the guides carry the shear stress P12. F0 minimises
the potential W - sx l_x - sy l_y, which finds a stable state of laws that also have unstable ones.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..api import Array, SolverError
from ..laws import Law
from .kernels import membrane_point

_NO_STRESS = np.zeros(6)
_ROWS = np.ix_([0, 3], [0, 3])  # of F11 and F22 in dP/dF


@dataclass(frozen=True)
class Prestress:
    """The pre-stretched state.

    stretches (2,); c33, the square of the thickness stretch; elastic (6,), the law's stress S_e [Pa]; derivatives
    (m + 2, 2), of the stretches by the law's m parameters, then by the loads sx and sy.
    """

    stretches: Array
    c33: float
    elastic: Array
    derivatives: Array

    @property
    def F(self) -> Array:
        """F0 (2, 2)."""
        return np.diag(self.stretches)


def unstretched(p: Array) -> Prestress:
    """The sheet as it lies, for a law with parameters ``p`` (m,)."""
    return Prestress(np.ones(2), 1.0, np.zeros(6), np.zeros((p.size + 2, 2)))


def stretch(
    law: Law, p: Array, loads: Array, scale: float = 1.0, extra: Array = _NO_STRESS, start: Prestress | None = None
) -> Prestress:
    """Find the stretches under nominal stresses ``loads`` (sx, sy) [Pa], for the stress S = scale S_e + extra.

    Raises SolverError where no stable state is found.
    """
    load = {"sx": float(loads[0]), "sy": float(loads[1])}
    elastic, P, A, dS = np.empty(6), np.empty((3, 2)), np.empty((6, 6)), np.zeros((p.size, 6))

    def evaluate(stretches: Array, c33: float) -> tuple[float, float]:
        """Potential and C33; leaves the stresses in P, A, dS."""
        F = np.zeros((3, 2))
        F[0, 0], F[1, 1] = stretches
        c33 = membrane_point(law.point, p, F, scale, extra, c33, elastic, P, A, dS)
        C = np.array([stretches[0] ** 2, stretches[1] ** 2, c33, 0.0, 0.0, 0.0])
        return scale * law.energy(C, p) + float(0.5 * extra[:2] @ C[:2] - loads @ stretches), c33

    start = unstretched(p) if start is None else start
    stretches = start.stretches
    value, c33 = evaluate(stretches, start.c33)
    if not np.isfinite(value):
        raise SolverError("the law has no stress at the start of the pre-stress step", load=load)
    for _ in range(200):
        residual = np.array([P[0, 0], P[1, 1]]) - loads
        size, axes = np.linalg.eigh(0.5 * (A[_ROWS] + A[_ROWS].T))
        if size[0] > 0.0 and np.abs(residual).max() <= 1e-10 * (np.abs(loads).max() + 1e-3 * size[0]):
            break
        step = -axes @ (axes.T @ residual / np.maximum(np.abs(size), 1e-6 * np.abs(size).max()))
        step *= min(1.0, 0.1 / np.abs(step).max())
        slope = float(residual @ step)
        for _ in range(40):
            new, thickness = evaluate(stretches + step, c33)
            if new <= value + 1e-4 * slope + 1e-13 * abs(value):
                break
            step, slope = 0.5 * step, 0.5 * slope
        else:
            raise SolverError("the pre-stress step found no stable state", load=load)
        stretches, value, c33 = stretches + step, new, thickness
    else:
        raise SolverError("the pre-stress step did not converge", load=load)

    change = np.zeros((p.size + 2, 2))  # of the residual, at fixed stretches
    change[: p.size] = scale * dS[:, :2] * stretches
    change[p.size, 0] = change[p.size + 1, 1] = -1.0
    return Prestress(stretches, c33, elastic.copy(), np.asarray(-np.linalg.solve(A[_ROWS], change.T).T, np.float64))
