"""Profile likelihood: how much worse the fit gets when one parameter is moved and all others follow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..api import Array
from .optimisers import FitError, minimise
from .problem import Evaluation, Problem
from .spec import Spec
from .statistics import CONFIDENCE, Estimate, Uncertainty

STEPS = (1.0, 2.0, 4.0, 8.0)  # in standard errors; further ones are not needed for 95 %
EVALUATIONS = 8  # at each of them: the others start where the linear theory puts them


def profiles(
    problem: Problem, optimum: Evaluation, known: Uncertainty, found: Sequence[Estimate], spec: Spec
) -> list[Estimate]:
    """The estimates with the profiles that ``spec`` asks for (Venzon and Moolgavkar 1988; Raue et al. 2009).

    The rise of the sum of squares is divided by what a mean residual contributes, autocorrelation included: exact for
    equally noisy curves, an approximation for others. A parameter on a bound, or that the data do not feel, has none.
    """
    wanted = problem.variables.symbols if spec.profile == "all" else spec.profile
    unit = _unit(problem, optimum, known)
    result = []
    for k, estimate in enumerate(found):
        deviation = float(np.sqrt(known.covariance[k, k]))
        if estimate.free.symbol not in wanted or not 0.0 < deviation < np.inf:
            result.append(estimate)
            continue
        points = [(float(optimum.z[k]), 0.0)]
        ends = []
        for side in (-1.0, 1.0):
            way = _walk(problem, optimum, known.covariance[k] / deviation, k, side, unit, spec)
            points += way
            ends.append(_crossing([points[0], *way]))
        points.sort()
        curve = np.array([(estimate.free.value(z), rise) for z, rise in points])
        interval = (
            estimate.free.value(ends[0]) if np.isfinite(ends[0]) else -np.inf,
            estimate.free.value(ends[1]) if np.isfinite(ends[1]) else np.inf,
        )
        identifiable = estimate.identifiable and bool(np.all(np.isfinite(interval)))
        result.append(replace(estimate, profile=curve, profile_interval=interval, identifiable=identifiable))
    return result


def _unit(problem: Problem, optimum: Evaluation, known: Uncertainty) -> float:
    """Mean square of one independent residual."""
    together = np.concatenate(
        [np.full(w.stop - w.start, p) for (_, _, w), p in zip(problem.groups(), known.persistence, strict=True)]
    )
    dof = max(problem.size - optimum.z.size, 1)
    few = (known.reach / np.sqrt(CONFIDENCE)) ** 2  # of few independent samples chi-squared has to rise by more
    return float((optimum.residual**2 * together).sum() / dof * few)


def _walk(
    problem: Problem, optimum: Evaluation, direction: Array, k: int, side: float, unit: float, spec: Spec
) -> list[tuple[float, float]]:
    """Coordinates of parameter k and rises of chi-squared, outward until 95 % is passed or a bound is reached."""
    lower, upper = problem.variables.bounds
    points = []
    for step in STEPS:
        z = np.clip(optimum.z + side * step * np.nan_to_num(direction), lower, upper)
        values = problem.variables.values(z)
        others = tuple(s for j, s in enumerate(problem.variables.symbols) if j != k)
        if others:
            held = Problem(
                problem.model,
                problem.cases,
                problem.variables.only(others, values),
                problem.executor,
                problem.tally,
                problem.observe,
            )
            try:
                objective = minimise(held, spec.optimiser, EVALUATIONS, 1e-4).evaluation.objective
            except FitError:
                break
        else:
            objective = problem.evaluate(z, derivatives=False).objective
        points.append((float(z[k]), max(0.0, (objective - optimum.objective) / unit)))
        if points[-1][1] > CONFIDENCE or not lower[k] < z[k] < upper[k]:
            break
    return points


def _crossing(points: Sequence[tuple[float, float]]) -> float:
    """Coordinate where chi-squared passes 95 %, between the last two points (its root is nearly linear there)."""
    if points[-1][1] <= CONFIDENCE:
        return float("nan")
    (a, low), (b, high) = points[-2], points[-1]
    low, high, goal = np.sqrt(low), np.sqrt(high), np.sqrt(CONFIDENCE)
    return float(a + (b - a) * (goal - low) / (high - low))
