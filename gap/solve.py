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
from numpy.typing import NDArray

from gap.hypothesis import Candidate, Evaluation, FloatArray, Problem

MAX_ITERATIONS = 30
UNIFORM_PRECISION = 12.0
"""1/variance of a uniform prior of width 1."""
DOUBTED = 2.0
"""Standard deviations of what neighbouring samples of white noise seem to have in common."""


class Projector:
    """The linear nuisance refit about one point, factorised once and used for every effect."""

    def __init__(self, jacobian: FloatArray, prior_sd: FloatArray, gram: FloatArray | None = None) -> None:
        self.jacobian = jacobian
        normal = jacobian.T @ jacobian if gram is None else gram.copy()
        self.precision = np.where(np.isfinite(prior_sd), 1.0 / np.square(prior_sd), 0.0)
        normal[np.diag_indices_from(normal)] += self.precision
        self._factor = _factorise(normal)

    def apply(self, vectors: FloatArray) -> FloatArray:
        """P v for v (n,) or (n, k)."""
        if not self.jacobian.shape[1]:
            return vectors
        return vectors - self.jacobian @ sla.cho_solve(self._factor, self.jacobian.T @ vectors)

    def squares(self, vectors: FloatArray, seen: FloatArray) -> FloatArray:
        """vᵀ P v for each column of v (n, k), (k,), given ``seen``, Jᵀ v."""
        whole = np.einsum("ij,ij->j", vectors, vectors)
        return np.asarray(
            whole - np.einsum("ij,ij->j", seen, sla.cho_solve(self._factor, seen)) if len(seen) else whole
        )

    def chi2(self, residual: FloatArray) -> float:
        """rᵀ P r: χ² of a residual (n,) after the linear refit, prior included."""
        return float(residual @ self.apply(residual))


def _factorise(normal: FloatArray) -> tuple[FloatArray, bool]:
    """Cholesky factor of a normal matrix, with the least ridge that makes it definite."""
    scale = np.maximum(np.diag(normal), 1e-300)
    for ridge in (1e-12, 1e-9, 1e-6, 1e-3):
        try:
            ridged = normal.copy()
            ridged[np.diag_indices_from(ridged)] += ridge * scale
            factor: tuple[FloatArray, bool] = sla.cho_factor(ridged, check_finite=False)
        except np.linalg.LinAlgError:
            continue
        return factor
    raise np.linalg.LinAlgError("normal matrix is not positive definite")


@dataclass(frozen=True)
class Belief:
    """What other data say of effect parameters: normal, about ``mean`` (k,) in prior quantiles, with ``precision``
    (k, k), nought where they say nothing."""

    mean: FloatArray
    precision: FloatArray

    @classmethod
    def none(cls, size: int) -> Belief:
        return cls(np.full(size, 0.5), np.zeros((size, size)))

    def joined(self, size: int, fitted: Fit | None = None) -> Belief:
        """With one effect more, of ``size`` parameters, of which a fit of another block may know as its last.

        Four times as uncertain as that fit: the effect's form is not exact, and shows otherwise here.
        """
        k = len(self.mean)
        mean, precision = np.full(k + size, 0.5), np.zeros((k + size, k + size))
        mean[:k], precision[:k, :k] = self.mean, self.precision
        if fitted is not None and size:
            mean[k:] = fitted.unit[-size:]
            precision[k:, k:] = np.linalg.inv(4.0 * fitted.covariance[-size:, -size:] + 1e-6 * np.eye(size))
        return Belief(mean, precision)

    def cost(self, unit: FloatArray) -> float:
        away = unit - self.mean
        return float(away @ self.precision @ away)


@dataclass
class Fit:
    """A fitted hypothesis.

    ``chi2`` is of the data alone, ``penalty`` the prior's share, ``wider`` twice the logarithm by which effects of
    chance widen the noise, with what is `unearned`; ``unit`` (k,) are the effect parameters in prior quantiles, in the
    order of the hypothesis, ``covariance`` (k, k) theirs. ``prior_mean``, ``prior_sd`` (p,) are the nuisance's prior
    that was used: an effect may move where the tissue's parameters are anchored.
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
    gram: FloatArray = field(repr=False)
    effect_jacobian: FloatArray = field(repr=False)
    prior_mean: FloatArray = field(repr=False)
    prior_sd: FloatArray = field(repr=False)
    belief: Belief = field(repr=False)
    wider: float = 0.0

    @property
    def deviance(self) -> float:
        """χ², and what wider noise costs: comparable with and without effects of chance."""
        return self.chi2 + self.wider

    @property
    def objective(self) -> float:
        return self.deviance + self.penalty

    def log_evidence(self, temper: float, priors: Sequence[FloatArray]) -> float:
        """log marginal likelihood up to the constant that all hypotheses share, with χ² divided by ``temper``.

        The mean over the prior widths ``priors`` (each (p,)): how far tissue laws may differ from the nominal one is
        not known.
        """
        return float(np.logaddexp.reduce(self.evidences(temper, priors)) - np.log(len(priors)))

    def evidences(self, temper: float, priors: Sequence[FloatArray]) -> FloatArray:
        """The same for each of the prior widths, (widths,)."""
        return np.array([self._evidence(temper, sd) for sd in priors])

    def best_prior(self, priors: Sequence[FloatArray]) -> FloatArray:
        """The most probable of the prior widths ``priors``, (p,)."""
        return max(priors, key=lambda sd: self._evidence(1.0, sd))

    def _evidence(self, temper: float, sd: FloatArray) -> float:
        """log evidence of the model linearised about the fit, under another prior width of the nuisance.

        An effect's parameters are marginalised with it, under a normal prior about the fit that is as wide (variance
        1/12) as the uniform one; but they stay where they were fitted: a straight line would lead them out of their
        range, to gains that do not exist.
        """
        k, p = len(self.unit), len(self.nuisance)
        if not k + p:
            return -0.5 * (self.chi2 / temper + self.wider)
        precision = np.where(np.isfinite(sd), 1.0 / np.square(sd), 1e-12)
        known = self.belief.precision
        known = known + np.diag(np.where(np.diag(known) > 0, 0.0, UNIFORM_PRECISION))
        normal = self.normal / temper
        normal[np.arange(p), np.arange(p)] += precision
        normal[p:, p:] += known
        factor, lower = _factorise(normal)
        b = self._pull / temper
        # The factor's leading part is the factor of the nuisance's own normal matrix.
        gain = float(b @ sla.cho_solve((factor[:p, :p], lower), b)) if p else 0.0
        logdet = 2.0 * float(np.sum(np.log(np.diag(factor)))) - float(np.sum(np.log(precision)))
        logdet -= float(np.linalg.slogdet(known)[1])
        square = float(self.at_mean @ self.at_mean)
        return -0.5 * (square / temper - gain + logdet + self.belief.cost(self.unit) + self.wider)

    @cached_property
    def at_mean(self) -> FloatArray:
        """The residual (n,) with the nuisance at its prior's mean, by the linear model."""
        return self.residual + self.jacobian @ (self.nuisance - self.prior_mean)

    @cached_property
    def _pull(self) -> FloatArray:
        return self.jacobian.T @ self.at_mean

    @cached_property
    def jacobians(self) -> FloatArray:
        """By nuisance and effects, (n, p + k)."""
        return np.hstack([self.jacobian, self.effect_jacobian])

    @cached_property
    def normal(self) -> FloatArray:
        return _bordered(self.gram, self.jacobian, self.jacobians[:, len(self.nuisance) :])

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
    def deviance(self) -> float:
        return sum(f.deviance for f in self.fits.values())

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
    precision = np.where(np.isfinite(sd), 1.0 / np.square(sd), 0.0)
    believed = Belief.none(len(u)) if belief is None else belief
    fine = [p.fine for h in hypothesis for p in h.parameters]
    simulations = 0

    def wider(u: FloatArray) -> float:
        times = problem.widening(split(hypothesis, u))
        return 0.0 if times is None else 2.0 * float(np.sum(np.log(times)))

    def cost(residual: FloatArray, c: FloatArray, u: FloatArray) -> float:
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

    here = simulated(c, u, want_jacobian=jacobian is None)
    residual, fresh = here.residual, jacobian is None
    jac = here.jacobian if jacobian is None else jacobian
    gram = jac.T @ jac if gram is None or fresh else gram
    effect = by_effect(residual, c, u)
    best = cost(residual, c, u)
    damping = 1e-3
    for _ in range(iterations):
        normal = _bordered(gram, jac, effect)
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
        fixed = np.zeros(len(gradient), bool)
        fixed[p:] = ((u <= 0) & (gradient[p:] < 0)) | ((u >= 1) & (gradient[p:] > 0))
        free = ~fixed
        improved = False
        for _attempt in range(6):
            damped = normal[np.ix_(free, free)]
            damped[np.diag_indices_from(damped)] *= 1.0 + damping
            step = np.zeros(len(gradient))
            step[free] = sla.cho_solve(_factorise(damped), gradient[free])
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
            gram, fresh, damping = jac.T @ jac, True, 1e-3
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
            gram = jac.T @ jac
        if gain < tolerance * max(best, 1.0) * 0.1 + 0.02:
            break
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


def _bordered(gram: FloatArray, jacobian: FloatArray, more: FloatArray) -> FloatArray:
    """The normal matrix of a Jacobian whose own is ``gram`` and of ``more`` columns."""
    cross = jacobian.T @ more
    return np.block([[gram, cross], [cross.T, more.T @ more]])


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
        factor = _factorise(normal)
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
