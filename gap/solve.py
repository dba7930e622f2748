"""Fits of one problem under one hypothesis: damped Gauss-Newton with priors, and the Laplace evidence.

Notation: r whitened residual (n,), J its nuisance Jacobian (n, p), Λ = diag(1/sd²). The generalised projector
P = I − J (JᵀJ + Λ)⁻¹ Jᵀ removes what the nuisance explains within its prior; then χ² after a linear nuisance refit is
rᵀ P r. Laplace evidence after MacKay, "Information Theory, Inference and Learning Algorithms", ch. 27–28.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy.linalg as sla

from gap.hypothesis import Candidate, FloatArray, Problem

MAX_ITERATIONS = 30
DIFFERENCE_STEP = 1e-3  # of a unit prior range
UNIFORM_PRECISION = 12.0
"""1/variance of a uniform prior of width 1."""


class Projector:
    """The linear nuisance refit about one point, factorised once and used for every effect."""

    def __init__(self, jacobian: FloatArray, prior_sd: FloatArray) -> None:
        self.jacobian = jacobian
        normal = jacobian.T @ jacobian
        self.precision = np.where(np.isfinite(prior_sd), 1.0 / np.square(prior_sd), 0.0)
        normal[np.diag_indices_from(normal)] += self.precision
        self._factor = _factorise(normal)

    def apply(self, vectors: FloatArray) -> FloatArray:
        """P v for v (n,) or (n, k)."""
        if not self.jacobian.shape[1]:
            return vectors
        return vectors - self.jacobian @ sla.cho_solve(self._factor, self.jacobian.T @ vectors)

    def chi2(self, residual: FloatArray) -> float:
        """rᵀ P r: χ² of a residual (n,) after the linear refit, prior included."""
        return float(residual @ self.apply(residual))


def _factorise(normal: FloatArray) -> tuple[FloatArray, bool]:
    """Cholesky factor of a normal matrix, with the least ridge that makes it definite."""
    scale = np.maximum(np.diag(normal), 1e-300)
    for ridge in (1e-12, 1e-9, 1e-6, 1e-3):
        try:
            factor: tuple[FloatArray, bool] = sla.cho_factor(normal + np.diag(ridge * scale), check_finite=False)
        except np.linalg.LinAlgError:
            continue
        return factor
    raise np.linalg.LinAlgError("normal matrix is not positive definite")


@dataclass
class Fit:
    """A fitted hypothesis.

    ``chi2`` is of the data alone, ``penalty`` the prior's share; ``unit`` (k,) are the effect parameters in prior
    quantiles, in the order of the hypothesis, ``covariance`` (k, k) theirs. ``prior_mean``, ``prior_sd`` (p,) are the
    nuisance's prior that was used: an effect may move where the tissue's parameters are anchored.
    """

    hypothesis: tuple[Candidate, ...]
    nuisance: FloatArray
    unit: FloatArray
    residual: FloatArray
    chi2: float
    penalty: float
    covariance: FloatArray
    simulations: int
    jacobian: FloatArray = field(repr=False)
    effect_jacobian: FloatArray = field(repr=False)
    prior_mean: FloatArray = field(repr=False)
    prior_sd: FloatArray = field(repr=False)

    @property
    def objective(self) -> float:
        return self.chi2 + self.penalty

    def log_evidence(self, temper: float, priors: Sequence[FloatArray]) -> float:
        """log marginal likelihood up to the constant that all hypotheses share, with χ² divided by ``temper``.

        The mean over the prior widths ``priors`` (each (p,)): how far tissue laws may differ from the nominal one is
        not known.
        """
        terms = [self._evidence(temper, sd) for sd in priors]
        return float(np.logaddexp.reduce(terms) - np.log(len(terms)))

    def best_prior(self, priors: Sequence[FloatArray]) -> FloatArray:
        """The most probable of the prior widths ``priors``, (p,)."""
        return max(priors, key=lambda sd: self._evidence(1.0, sd))

    def _evidence(self, temper: float, sd: FloatArray) -> float:
        """log evidence of the model linearised about the fit, under another prior width of the nuisance.

        An effect's parameters are marginalised with it, under a normal prior about the fit that is as wide (variance
        1/12) as the uniform one.
        """
        k = len(self.unit)
        precision = np.concatenate(
            [np.where(np.isfinite(sd), 1.0 / np.square(sd), 1e-12), np.full(k, UNIFORM_PRECISION)]
        )
        if not len(precision):
            return -0.5 * self.chi2 / temper
        at_mean = self.residual + self.jacobian @ (self.nuisance - self.prior_mean)
        normal = self._normal / temper
        normal[np.diag_indices_from(normal)] += precision
        factor = _factorise(normal)
        b = self._jacobians.T @ at_mean / temper
        least = float(at_mean @ at_mean) / temper - float(b @ sla.cho_solve(factor, b))
        logdet = 2.0 * float(np.sum(np.log(np.diag(factor[0])))) - float(np.sum(np.log(precision)))
        return -0.5 * (least + logdet)

    @cached_property
    def _jacobians(self) -> FloatArray:
        return np.hstack([self.jacobian, self.effect_jacobian])

    @cached_property
    def _normal(self) -> FloatArray:
        normal: FloatArray = self._jacobians.T @ self._jacobians
        return normal

    @property
    def active(self) -> dict[Candidate, dict[str, float]]:
        return split(self.hypothesis, self.unit)


@dataclass(frozen=True)
class Hypothesis:
    """Effects and their fits, one per block; blocks they do not touch carry the null's fit."""

    effects: tuple[Candidate, ...]
    fits: dict[str, Fit]

    @property
    def chi2(self) -> float:
        return sum(f.chi2 for f in self.fits.values())

    @property
    def name(self) -> str:
        return " + ".join(e.key for e in self.effects) or "none"


def split(hypothesis: Sequence[Candidate], unit: FloatArray) -> dict[Candidate, dict[str, float]]:
    """Parameter values of each effect from one vector of prior quantiles."""
    out, at = {}, 0
    for candidate in hypothesis:
        k = len(candidate.parameters)
        out[candidate] = candidate.values(unit[at : at + k])
        at += k
    return out


def fit(
    problem: Problem,
    hypothesis: Sequence[Candidate] = (),
    unit: FloatArray | None = None,
    nuisance: FloatArray | None = None,
    iterations: int = MAX_ITERATIONS,
    tolerance: float = 1e-3,
    jacobian: FloatArray | None = None,
) -> Fit:
    """Nuisance and effect parameters that minimise χ² + prior, from ``nuisance`` (p,) and ``unit`` (k,).

    Levenberg-Marquardt; effect derivatives by differences, nuisance derivatives from the problem, or a ``jacobian``
    (n, p) from near the start, good for as long as it foretells what happens. ``tolerance`` is the relative gain below
    which it stops.
    """
    hypothesis = tuple(hypothesis)
    c = problem.start() if nuisance is None else nuisance.copy()
    u = np.full(sum(len(h.parameters) for h in hypothesis), 0.5) if unit is None else unit.astype(float).copy()
    mean, sd = problem.prior_mean, problem.prior_sd
    precision = np.where(np.isfinite(sd), 1.0 / np.square(sd), 0.0)
    simulations = 0

    def cost(residual: FloatArray, c: FloatArray) -> float:
        return float(residual @ residual + np.sum(precision * np.square(c - mean)))

    def linearise(
        c: FloatArray, u: FloatArray, kept: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Residual and Jacobians; the nuisance's is ``kept`` where one is given."""
        nonlocal simulations
        here = problem.evaluate(c, split(hypothesis, u), want_jacobian=kept is None)
        effect = np.empty((len(here.residual), len(u)))
        for k in range(len(u)):
            step = DIFFERENCE_STEP if u[k] < 0.5 else -DIFFERENCE_STEP
            moved = u.copy()
            moved[k] += step
            there = problem.evaluate(c, split(hypothesis, moved), want_jacobian=False)
            effect[:, k] = (here.residual - there.residual) / step
        simulations += 1 + len(u)
        return here.residual, here.jacobian if kept is None else kept, effect

    residual, jac, effect = linearise(c, u, jacobian)
    best = cost(residual, c)
    damping = 1e-3
    for _ in range(iterations):
        full = np.hstack([jac, effect])
        normal = full.T @ full
        p = len(c)
        normal[np.arange(p), np.arange(p)] += precision
        gradient = full.T @ residual
        gradient[:p] -= precision * (c - mean)
        # Parameters at a bound that the step would leave stay there.
        fixed = np.zeros(len(gradient), bool)
        fixed[p:] = ((u <= 0) & (gradient[p:] < 0)) | ((u >= 1) & (gradient[p:] > 0))
        free = ~fixed
        improved = False
        for _attempt in range(6):
            damped = normal[np.ix_(free, free)].copy()
            damped[np.diag_indices_from(damped)] *= 1.0 + damping
            step = np.zeros(len(gradient))
            step[free] = sla.cho_solve(_factorise(damped), gradient[free])
            c_new, u_new = c + step[:p], np.clip(u + np.clip(step[p:], -0.3, 0.3), 0.0, 1.0)
            trial = problem.evaluate(c_new, split(hypothesis, u_new), want_jacobian=False)
            simulations += 1
            value = cost(trial.residual, c_new)
            if np.isfinite(value) and value < best:
                improved = True
                break
            damping = max(damping * 8.0, 1e-4)
        if not improved:
            break
        gain = best - value
        # While the linear model foretells the gain, its costly nuisance part is good enough for another step.
        foretold = float(2 * gradient @ step - step @ normal @ step)
        stale = not 0.75 < gain / max(foretold, 1e-12) < 1.3
        c, u, best = c_new, u_new, value
        damping *= 0.2
        residual, jac, effect = linearise(c, u, None if stale else jac)
        if gain < tolerance * max(best, 1.0) * 0.1 + 0.02:
            break
    return _finish(hypothesis, c, u, residual, jac, effect, mean, sd, simulations)


def _finish(
    hypothesis: tuple[Candidate, ...],
    c: FloatArray,
    u: FloatArray,
    residual: FloatArray,
    jac: FloatArray,
    effect: FloatArray,
    mean: FloatArray,
    sd: FloatArray,
    simulations: int,
) -> Fit:
    """Curvature, evidence terms and covariance at the optimum."""
    precision = np.where(np.isfinite(sd), 1.0 / np.square(sd), 0.0)
    normal = jac.T @ jac
    normal[np.diag_indices_from(normal)] += precision
    penalty = float(np.sum(precision * np.square(c - mean)))
    covariance = np.zeros((len(u), len(u)))
    if len(c):
        factor = _factorise(normal)
        schur = effect.T @ effect - (effect.T @ jac) @ sla.cho_solve(factor, jac.T @ effect)
    else:
        schur = effect.T @ effect
    if len(u):
        covariance = np.linalg.inv(schur + np.eye(len(u)) * UNIFORM_PRECISION)
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
        effect_jacobian=effect,
        prior_mean=mean.copy(),
        prior_sd=sd.copy(),
    )


def under(problem: Problem, mean: FloatArray, sd: FloatArray) -> Problem:
    """``problem`` with another prior of its nuisance, (p,) each."""
    out = copy.copy(problem)
    out.prior_mean, out.prior_sd = mean, sd
    return out
