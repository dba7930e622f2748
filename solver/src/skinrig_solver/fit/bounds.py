"""Errors that a parameter on its bound makes in the others: how far they move while the data let it come off there.

Derivatives at the bound do not tell. A stiffness of next to nothing changes no curve, and its logarithm less still; but
the data may allow it forty times as much, and the others go along with it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..api import Array
from .problem import Evaluation, Problem
from .statistics import CONFIDENCE, Uncertainty

RUNS = 5  # with sensitivities, for each parameter on a bound
FIRST = 0.25  # of the range between the bounds: the first try
FAR = 3.0 * CONFIDENCE  # rise of chi-squared above which a place says nothing of where the parameter may be


def released(problem: Problem, optimum: Evaluation, known: Uncertainty) -> Uncertainty:
    """``known`` with the way that others go as each parameter leaves its bound added to their variances.

    The range is halved towards where chi-squared has risen by 3.84, the others following by one Gauss–Newton step each
    time. A way counts as one standard deviation where the rise is at most one, and as the root of it beyond.
    """
    covariance = known.covariance.copy()
    for k, side in enumerate(known.on_bound):
        if side:
            way = _way(problem, optimum, known, k, 1.0 if side == "lower" else -1.0)
            inner = np.flatnonzero(np.isfinite(np.diag(covariance)))
            covariance[inner, inner] += way[inner] ** 2
    return replace(known, covariance=covariance)


def _way(problem: Problem, optimum: Evaluation, known: Uncertainty, k: int, inwards: float) -> Array:
    """(m,): the largest shift of the other coordinates that one standard deviation brings."""
    lower, upper = problem.variables.bounds
    others = np.array([i for i, side in enumerate(known.on_bound) if not side])
    farthest, z = np.zeros(optimum.z.size), optimum.z
    if not others.size:
        return farthest
    near, far, share = 0.0, 1.0, FIRST
    for _ in range(RUNS):
        point = z.copy()
        point[k] = optimum.z[k] + inwards * share * (upper[k] - lower[k])
        rise, point = followed(problem, optimum, known, np.clip(point, lower, upper), others)
        if rise <= FAR:
            shift = np.abs(point - optimum.z) / np.sqrt(max(rise, 1.0))
            farthest[others] = np.maximum(farthest[others], shift[others])
        if rise <= CONFIDENCE:
            near, z = share, np.clip(point, lower, upper)
        else:
            far = share
        share = 0.5 * (near + far)
    return farthest


def followed(
    problem: Problem, optimum: Evaluation, known: Uncertainty, z: Array, others: NDArray[np.intp]
) -> tuple[float, Array]:
    """Rise of chi-squared at ``z`` (m,) once the ``others`` have made one Gauss–Newton step, and that place.

    Infinite, and ``z`` itself, where the model cannot be run.
    """
    there = problem.evaluate(z)
    if there.trouble:
        return np.inf, z
    assert there.jacobian is not None
    dof = max(optimum.residual.size - others.size, 1)
    unit = max(known.persistence, default=1.0) * optimum.objective / dof  # of chi-squared
    step = np.linalg.lstsq(there.jacobian[:, others], -there.residual, rcond=None)[0]
    left = there.residual + there.jacobian[:, others] @ step
    point = z.copy()
    point[others] += step
    return max(float(left @ left) - optimum.objective, 0.0) / max(unit, 1e-300), point
