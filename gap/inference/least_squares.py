"""Fits of one problem under one hypothesis: damped Gauss-Newton with priors on nuisance and effects."""

from __future__ import annotations

import copy
from collections.abc import Sequence

import numpy as np
import scipy.linalg as sla
from numpy.typing import NDArray

from gap.inference.evidence import UNIFORM_PRECISION, Belief, Fit, split
from gap.inference.hypothesis import FROZEN, Candidate, Evaluation
from gap.inference.linear import bordered, factorise
from gap.inference.problem import Problem
from sim_devices.chain import FloatArray

MAX_ITERATIONS = 30
DOUBTED = 2.0
"""Standard deviations of what neighbouring samples of white noise seem to have in common."""


def fit(
    problem: Problem,
    hypothesis: Sequence[Candidate] = (),
    unit: FloatArray | None = None,
    nuisance: FloatArray | None = None,
    iterations: int = MAX_ITERATIONS,
    tolerance: float = 1e-3,
    jacobian: FloatArray | None = None,
    gram: FloatArray | None = None,
    belief: Belief | None = None,
) -> Fit:
    """Nuisance and effect parameters that minimise χ² + prior, from ``nuisance`` (p,) and ``unit`` (k,).

    Levenberg-Marquardt; effect derivatives by differences, nuisance derivatives from the problem, or a ``jacobian``
    (n, p) from near the start, with its ``gram`` JᵀJ, good for as long as it foretells what happens. ``tolerance`` is
    the relative gain below which it stops. ``belief`` is what other data say of the effects.
    """
    hypothesis = tuple(hypothesis)
    c = problem.start() if nuisance is None else nuisance.copy()
    u = np.full(sum(len(h.parameters) for h in hypothesis), 0.5) if unit is None else unit.astype(float).copy()
    mean, sd = problem.prior_mean, problem.prior_sd
    moves = sd > FROZEN
    c[~moves] = mean[~moves]  # what is frozen stays there, wherever another law left it
    precision = np.where(np.isfinite(sd), 1.0 / np.square(sd), 0.0)
    believed = Belief.none(len(u)) if belief is None else belief
    fine = [p.fine for h in hypothesis for p in h.parameters]
    simulations = 0

    def wider(u: FloatArray) -> float:
        times = problem.widening(split(hypothesis, u))
        return 0.0 if times is None else 2.0 * float(np.sum(np.log(times)))

    def cost(residual: FloatArray, c: FloatArray, u: FloatArray) -> float:
        with np.errstate(over="ignore"):  # a trial that diverges is a bad one
            return float(residual @ residual + np.sum(precision * np.square(c - mean))) + believed.cost(u) + wider(u)

    def simulated(c: FloatArray, u: FloatArray, want_jacobian: bool = False) -> Evaluation:
        nonlocal simulations
        simulations += 1
        return problem.evaluate(c, split(hypothesis, u), want_jacobian)

    def by_effect(residual: FloatArray, c: FloatArray, u: FloatArray) -> FloatArray:
        """The Jacobian of the effects' parameters, where the residual is known."""
        columns = np.empty((len(residual), len(u)))
        for k in range(len(u)):
            step = fine[k] if u[k] < 0.5 else -fine[k]
            moved = u.copy()
            moved[k] += step
            columns[:, k] = (residual - simulated(c, moved).residual) / step
        return columns

    def gram_of(jac: FloatArray) -> FloatArray:
        """Jᵀ J of what moves."""
        if moves.all():
            return np.asarray(jac.T @ jac)
        out = np.zeros((len(c), len(c)))
        out[np.ix_(moves, moves)] = jac[:, moves].T @ jac[:, moves]
        return out

    here = simulated(c, u, want_jacobian=jacobian is None)
    residual, fresh = here.residual, jacobian is None
    jac = here.jacobian if jacobian is None else jacobian
    gram = gram_of(jac) if gram is None or fresh else gram
    effect = by_effect(residual, c, u)
    best = cost(residual, c, u)
    damping = 1e-3
    for _ in range(iterations):
        normal = bordered(gram, jac, effect)
        p = len(c)
        normal[np.arange(p), np.arange(p)] += precision
        normal[p:, p:] += believed.precision
        gradient = np.concatenate([jac.T @ residual, effect.T @ residual])
        gradient[:p] -= precision * (c - mean)
        gradient[p:] -= believed.precision @ (u - believed.mean)
        if noise := wider(u):
            for k, share in enumerate(fine):
                moved = u.copy()
                moved[k] += share
                gradient[p + k] -= 0.5 * (wider(moved) - noise) / share
        # Parameters at a bound that the step would leave stay there.
        fixed = np.append(~moves, np.zeros(len(u), bool))
        fixed[p:] = ((u <= 0) & (gradient[p:] < 0)) | ((u >= 1) & (gradient[p:] > 0))
        free = ~fixed
        improved = False
        for _attempt in range(6):
            damped = normal[np.ix_(free, free)]
            damped[np.diag_indices_from(damped)] *= 1.0 + damping
            step = np.zeros(len(gradient))
            step[free] = sla.cho_solve(factorise(damped), gradient[free])
            c_new, u_new = c + step[:p], np.clip(u + np.clip(step[p:], -0.3, 0.3), 0.0, 1.0)
            trial = simulated(c_new, u_new)
            value = cost(trial.residual, c_new, u_new)
            if np.isfinite(value) and value < best:
                improved = True
                break
            damping = max(damping * 8.0, 1e-4)
        if not improved and fresh:
            break
        if not improved:  # an old Jacobian may be to blame
            jac = simulated(c, u, want_jacobian=True).jacobian
            gram, fresh, damping = gram_of(jac), True, 1e-3
            continue
        gain = best - value
        # While the linear model foretells the gain, its costly nuisance part is good enough for another step.
        foretold = float(2 * gradient @ step - step @ normal @ step)
        stale = not 0.75 < gain / max(foretold, 1e-12) < 1.3
        c, u, best, residual = c_new, u_new, value, trial.residual
        damping *= 0.2
        effect, fresh = by_effect(residual, c, u), stale
        if stale:
            jac = simulated(c, u, want_jacobian=True).jacobian
            gram = gram_of(jac)
        if gain < tolerance * max(best, 1.0) * 0.1 + 0.02:
            break
    if not moves.all():
        gram = jac.T @ jac
    noise = wider(u) + unearned(residual, problem.widening(split(hypothesis, u)), problem.rows.recording)
    return _finish(hypothesis, c, u, residual, jac, gram, effect, mean, sd, believed, simulations, noise)


def unearned(residual: FloatArray, times: FloatArray | None, recording: NDArray[np.int64]) -> float:
    """Twice the nats that noise wider by ``times`` (n,) seems to earn on a whitened residual (n,) that is no chance.

    Scattered instants are one by one; what neighbours have in common beyond what noise could is a wrong response, and
    counts as few.
    """
    if times is None:
        return 0.0
    share = 1.0 - 1.0 / np.square(times)  # of what is left, the share that is laid to chance
    weight = np.sqrt(share[1:] * share[:-1]) * (recording[1:] == recording[:-1])
    own = 0.5 * float(weight @ (np.square(residual[1:]) + np.square(residual[:-1])))
    common = float(weight @ (residual[1:] * residual[:-1])) - DOUBTED * float(np.linalg.norm(weight))
    together = max(common, 0.0) / max(own, 1e-300)
    earned = float(np.square(residual) @ (np.square(times) - 1.0) - 2.0 * np.sum(np.log(times)))
    return max(earned, 0.0) * 2.0 * together / (1.0 + together)


def _finish(
    hypothesis: tuple[Candidate, ...],
    c: FloatArray,
    u: FloatArray,
    residual: FloatArray,
    jac: FloatArray,
    gram: FloatArray,
    effect: FloatArray,
    mean: FloatArray,
    sd: FloatArray,
    belief: Belief,
    simulations: int,
    wider: float,
) -> Fit:
    """Curvature, evidence terms and covariance at the optimum."""
    precision = np.where(np.isfinite(sd), 1.0 / np.square(sd), 0.0)
    normal = gram.copy()
    normal[np.diag_indices_from(normal)] += precision
    penalty = float(np.sum(precision * np.square(c - mean))) + belief.cost(u)
    covariance = np.zeros((len(u), len(u)))
    if len(c):
        factor = factorise(normal)
        schur = effect.T @ effect - (effect.T @ jac) @ sla.cho_solve(factor, jac.T @ effect)
    else:
        schur = effect.T @ effect
    if len(u):
        covariance = np.linalg.inv(schur + belief.precision + np.eye(len(u)) * UNIFORM_PRECISION)
    return Fit(
        hypothesis=hypothesis,
        nuisance=c,
        unit=u,
        residual=residual,
        chi2=float(residual @ residual),
        penalty=penalty,
        covariance=covariance,
        simulations=simulations,
        jacobian=jac,
        gram=gram,
        effect_jacobian=effect,
        prior_mean=mean.copy(),
        prior_sd=sd.copy(),
        belief=belief,
        wider=wider,
    )


def predicted(problem: Problem, f: Fit) -> FloatArray:
    """What a fit of ``problem`` says should have been measured, (n,) SI."""
    wider = problem.widening(f.active)
    sigma = problem.sigma if wider is None else problem.sigma * wider
    return np.asarray(problem.measured - f.residual * sigma)


def under(problem: Problem, mean: FloatArray, sd: FloatArray) -> Problem:
    """``problem`` with another prior of its nuisance, (p,) each."""
    out = copy.copy(problem)
    out.prior_mean, out.prior_sd = mean, sd
    return out
