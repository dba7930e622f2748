"""The optimisers of the papers behind one call: trust-region least squares (M), SQP (F), Nelder-Mead (W)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import optimize

from ..api import Array
from .problem import Evaluation, Problem

INSIDE = 1e-8  # relative distance that an interior method keeps from a bound
FAR = 1e3  # a point where the model cannot be run counts so many times the starting objective


class FitError(ValueError):
    """A fit that cannot begin: the model cannot be run where it was told to start."""


@dataclass(frozen=True)
class Optimum:
    """Where an optimiser ended: the evaluation with Jacobian, whether it converged, and its reason in words."""

    evaluation: Evaluation
    converged: bool
    reason: str


def minimise(problem: Problem, method: str, evaluations: int, tolerance: float) -> Optimum:
    """Minimise the sum of squares from the variables' start, within their bounds.

    Ends where the objective changes by less than ``tolerance`` of itself, or after ``evaluations`` (a simplex may
    take twenty times as many). Raises FitError if the model cannot be run at the start.
    """
    lower, upper = problem.variables.bounds
    margin = INSIDE * (upper - lower)
    start = np.clip(problem.variables.start, lower + margin, upper - margin)
    first = problem.evaluate(start)
    if first.trouble:
        raise FitError(f"the model cannot be run at the start: {first.trouble}")
    z, converged, reason = _METHODS[method](problem, start, evaluations, tolerance)
    best = problem.evaluate(np.clip(z, lower, upper))
    return Optimum(best, converged, reason) if not best.trouble else Optimum(first, False, best.trouble)


def _trust_region(problem: Problem, start: Array, evaluations: int, tolerance: float) -> tuple[Array, bool, str]:
    """Branch, Coleman and Li (1999), with the exact Jacobian; steps to where the model fails are shortened."""

    def jacobian(z: Array) -> Array:
        found = problem.evaluate(z).jacobian
        assert found is not None
        return found

    done = optimize.least_squares(
        lambda z: problem.evaluate(z).residual,
        start,
        jac=jacobian,
        bounds=problem.variables.bounds,
        x_scale="jac",
        method="trf",
        ftol=tolerance,
        xtol=0.1 * tolerance,
        gtol=1e-12,
        max_nfev=evaluations,
    )
    return done.x, bool(done.status > 0), str(done.message).strip("`").replace("`", "")


def _sqp(problem: Problem, start: Array, evaluations: int, tolerance: float) -> tuple[Array, bool, str]:
    """Kraft's SLSQP (1988) on the sum of squares over its starting value, which the optimum is a small part of."""
    first = problem.evaluate(start)
    size = max(first.objective, 1e-300)
    bounds = np.stack(problem.variables.bounds, axis=1)

    def objective(z: Array) -> tuple[float, Array]:
        here = problem.evaluate(np.clip(z, bounds[:, 0], bounds[:, 1]))
        if here.trouble or here.jacobian is None:
            return FAR, np.zeros(z.size)
        return here.objective / size, 2.0 * here.jacobian.T @ here.residual / size

    done = optimize.minimize(
        objective,
        start,
        jac=True,
        method="SLSQP",
        bounds=bounds,
        options={"maxiter": evaluations, "ftol": 1e-4 * tolerance},
    )
    return done.x, bool(done.success), str(done.message)


def _simplex(problem: Problem, start: Array, evaluations: int, tolerance: float) -> tuple[Array, bool, str]:
    """Nelder and Mead (1965), adaptive (Gao and Han 2012): no derivatives."""
    lower, upper = problem.variables.bounds
    size = max(problem.evaluate(start).objective, 1e-300)
    simplex = np.vstack([start, *(start + step for step in np.diag(np.full(start.size, 0.1)))])
    beyond = simplex > upper
    simplex[beyond] -= 0.2
    simplex = np.clip(simplex, lower, upper)

    def objective(z: Array) -> float:
        return min(problem.evaluate(z, derivatives=False).objective / size, FAR)

    done = optimize.minimize(
        objective,
        start,
        method="Nelder-Mead",
        bounds=np.stack([lower, upper], axis=1),
        options={
            "initial_simplex": simplex,
            "maxfev": 20 * evaluations,
            "fatol": tolerance,
            "xatol": np.sqrt(tolerance),
            "adaptive": start.size > 4,
        },
    )
    return done.x, bool(done.success), str(done.message)


_METHODS: dict[str, Callable[[Problem, Array, int, float], tuple[Array, bool, str]]] = {
    "trust-region": _trust_region,
    "slsqp": _sqp,
    "nelder-mead": _simplex,
}
