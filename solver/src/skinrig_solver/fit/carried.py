"""Errors that a hardly known parameter makes in the others: how far they go as it is walked to the end of its range.

The covariance is that of a straight way. A stiffness known to a factor of five is walked from 0.1 to 5 kPa, and what
follows it follows its value, not its logarithm: twenty times as far on the one side as on the other. At the optimum
only the near side shows (Bates and Watts, J. R. Statist. Soc. B 42, 1980; profile traces, Technometrics 31, 1989).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..api import Array
from .bounds import FAR, followed
from .problem import Evaluation, Problem
from .statistics import CONFIDENCE, Uncertainty, estimates, hardly_known

RUNS = 3  # with sensitivities, to each side
FIRST = 2.0  # standard errors: the first try


def traced(problem: Problem, optimum: Evaluation, known: Uncertainty) -> Uncertainty:
    """``known`` with the ways of the others, as each hardly known parameter is walked, in place of straight ones.

    A way counts as one standard deviation where chi-squared rises by at most one, and as the root of the rise beyond;
    the straight way's share of the variance is taken off. Nothing is run where no parameter would be
    called identifiable.
    """
    if not any(e.identifiable for e in estimates(problem, optimum, known)):
        return known
    covariance = known.covariance.copy()
    variance = np.diag(known.covariance)
    inner = np.flatnonzero(np.isfinite(variance))
    for k in np.intersect1d(inner, hardly_known(problem, optimum, known)):
        others = inner[inner != k]
        straight = known.covariance[others, k] ** 2 / variance[k]
        way = np.max([_way(problem, optimum, known, k, others, side) for side in (1.0, -1.0)], axis=0)
        covariance[others, others] += np.maximum(way**2 - straight, 0.0)
    return replace(known, covariance=covariance)


def _way(
    problem: Problem, optimum: Evaluation, known: Uncertainty, k: int, others: NDArray[np.intp], side: float
) -> Array:
    """(len(others),): the largest shift of the others that one standard deviation of parameter k brings to a side."""
    lower, upper = problem.variables.bounds
    slope = np.zeros(optimum.z.size)
    slope[k] = side
    slope[others] = side * known.covariance[others, k] / known.covariance[k, k]
    farthest, start = np.zeros(others.size), optimum.z
    step = FIRST * np.sqrt(known.covariance[k, k])
    for _ in range(RUNS):
        rise, point = followed(problem, optimum, known, np.clip(start + step * slope, lower, upper), others)
        if rise <= FAR:
            farthest = np.maximum(farthest, np.abs(point - optimum.z)[others] / np.sqrt(max(rise, 1.0)))
        if rise > FAR:
            step *= 0.5
        elif rise > CONFIDENCE or not lower[k] < point[k] < upper[k]:
            break
        else:
            start = point
    return farthest
