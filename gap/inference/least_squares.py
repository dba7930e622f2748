"""Fits of one problem under one hypothesis: damped Gauss-Newton with priors on nuisance and effects."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from operator import attrgetter
from typing import NamedTuple, TypeVar

import numpy as np
import scipy.linalg as sla
from numpy.typing import NDArray

from gap.inference.evidence import UNIFORM_PRECISION, Fit, GaussianPrior, split
from gap.inference.hypothesis import FROZEN, Candidate, Evaluation
from gap.inference.linear import bordered, factorise
from gap.inference.problem import Problem
from sim_devices.chain import FloatArray

MAX_ITERATIONS = 30
DAMPED = 1e-3
"""Damping from which a fit begins, of the diagonal of the normal matrix."""
FORETOLD, OVERTOLD = 0.9, 1.3
"""Gain of a step, against the one that the straight line foretold, between which that is good enough."""
DOUBTED = 2.0
"""Standard deviations by which neighbouring samples of white noise seem alike."""
DIVERGED = 1e4
"""Standard deviations by which a simulation that diverges is off everywhere."""
OVERFLOWS = 1e100
"""Slope from which on a simulation counts as one that diverges."""


def fit(
    problem: Problem,
    hypothesis: Sequence[Candidate] = (),
    unit: FloatArray | None = None,
    nuisance: FloatArray | None = None,
    iterations: int = MAX_ITERATIONS,
    tolerance: float = 1e-3,
    jacobian: FloatArray | None = None,
    gram: FloatArray | None = None,
    belief: GaussianPrior | None = None,
) -> Fit:
    """Nuisance and effect parameters that minimise χ² + prior, from ``nuisance`` (p,) and ``unit`` (k,).

    Levenberg-Marquardt; effect derivatives by differences, nuisance derivatives from the problem, or a ``jacobian``
    (n, p) from near the start, with its ``gram`` JᵀJ, good for as long as it foretells the gain. ``tolerance`` is
    the relative gain below which it stops. ``belief`` is the prior of the effects by other data.
    """
    c = problem.start() if nuisance is None else nuisance.copy()
    aim = _Objective(problem, tuple(hypothesis), belief)  # a start may choose the priors
    u = np.full(aim.size, 0.5) if unit is None else unit.astype(float).copy()
    c[~aim.moves] = aim.mean[~aim.moves]  # a frozen one stays there, wherever another law left it
    here, slopes = aim.begun(c, u, jacobian, gram)
    fresh, damping = jacobian is None, DAMPED
    for _ in range(iterations):
        trial, foretold, damping = aim.descend(here, slopes, damping)
        if trial is None and fresh:
            break
        if trial is None:  # an old Jacobian may be to blame
            slopes, fresh, damping = aim.renewed(here, slopes), True, DAMPED
            continue
        gain = here.cost - trial.cost
        small = gain < tolerance * max(trial.cost, 1.0) * 0.1 + 0.02
        # While the straight line foretells the gain, its costly nuisance part is good enough for another step; but that
        # little is left to gain, only a Jacobian of this place can tell.
        over = small and fresh
        fresh = (small and not over) or not FORETOLD < gain / max(foretold, 1e-12) < OVERTOLD
        here, damping = trial, min(0.2 * damping, DAMPED) if small else 0.2 * damping
        slopes = slopes._replace(effect=aim.by_effect(here))
        if fresh:
            slopes = aim.renewed(here, slopes)
        if over:
            break
    return aim.finished(here, slopes)


P = TypeVar("P", bound=Problem)


class _Trial(NamedTuple):
    """Parameters that were tried."""

    nuisance: FloatArray
    unit: FloatArray
    residual: FloatArray
    cost: float


class _Slopes(NamedTuple):
    """Jacobian (n, p) of the nuisance, its JᵀJ (p, p) where that moves, and the Jacobian (n, k) of the effects."""

    jac: FloatArray
    gram: FloatArray
    effect: FloatArray

    def missed(self, here: _Trial, there: _Trial) -> FloatArray:
        """Right-hand side (p + k,) of the residual that the straight line did not foretell on the way ``there``."""
        missed = there.residual - here.residual + self.jac @ (there.nuisance - here.nuisance)
        missed += self.effect @ (there.unit - here.unit)
        return np.concatenate([self.jac.T @ missed, self.effect.T @ missed])


class _Objective:
    """χ² + priors of one problem under a hypothesis, with its derivatives; counts its simulations."""

    def __init__(self, problem: Problem, hypothesis: tuple[Candidate, ...], belief: GaussianPrior | None) -> None:
        self.problem, self.hypothesis = problem, hypothesis
        self.fine = [p.fine for h in hypothesis for p in h.parameters]
        self.size = len(self.fine)
        self.mean, self.sd = problem.prior_mean, problem.prior_sd
        self.moves = self.sd > FROZEN
        self.precision = np.where(np.isfinite(self.sd), 1.0 / np.square(self.sd), 0.0)
        self.believed = GaussianPrior.none(self.size) if belief is None else belief
        self.simulations = 0

    def wider(self, u: FloatArray) -> float:
        """Log-determinant of the noise that effects widen, twice."""
        times = self.problem.noise_scale(split(self.hypothesis, u))
        return 0.0 if times is None else 2.0 * float(np.sum(np.log(times)))

    def cost(self, residual: FloatArray, c: FloatArray, u: FloatArray) -> float:
        with np.errstate(over="ignore"):
            prior = np.sum(self.precision * np.square(c - self.mean))
            return float(residual @ residual + prior) + self.believed.cost(u) + self.wider(u)

    def simulated(self, c: FloatArray, u: FloatArray, want_jacobian: bool = False) -> Evaluation:
        self.simulations += 1
        with np.errstate(over="ignore", invalid="ignore"):
            made = self.problem.evaluate(c, split(self.hypothesis, u), want_jacobian)
            if np.isfinite(made.residual @ made.residual) and np.all(np.abs(made.jacobian) < OVERFLOWS):
                return made
        # It diverged: a bad trial, from which no way leads on.
        return Evaluation(np.full(len(made.residual), DIVERGED), np.zeros_like(made.jacobian))

    def begun(
        self, c: FloatArray, u: FloatArray, jacobian: FloatArray | None, gram: FloatArray | None
    ) -> tuple[_Trial, _Slopes]:
        """The beginning of a fit, its Jacobian and that one's JᵀJ as given or, where there is none, made here."""
        first = self.simulated(c, u, want_jacobian=jacobian is None)
        here = _Trial(c, u, first.residual, self.cost(first.residual, c, u))
        jac = first.jacobian if jacobian is None else jacobian
        gram = self.gram_of(jac) if gram is None or jacobian is None else gram
        return here, _Slopes(jac, gram, self.by_effect(here))

    def renewed(self, here: _Trial, slopes: _Slopes) -> _Slopes:
        """The nuisance's Jacobian made anew."""
        jac = self.simulated(here.nuisance, here.unit, want_jacobian=True).jacobian
        return slopes._replace(jac=jac, gram=self.gram_of(jac))

    def by_effect(self, here: _Trial) -> FloatArray:
        """The Jacobian (n, k) of the effects' parameters."""
        c, u, residual, _ = here
        columns = np.empty((len(residual), len(u)))
        for k in range(len(u)):
            step = self.fine[k] if u[k] < 0.5 else -self.fine[k]
            moved = u.copy()
            moved[k] += step
            columns[:, k] = (residual - self.simulated(c, moved).residual) / step
        return columns

    def gram_of(self, jac: FloatArray) -> FloatArray:
        """Jᵀ J (p, p) of the nuisance parameters that move."""
        if self.moves.all():
            return np.asarray(jac.T @ jac)
        out = np.zeros((len(self.mean), len(self.mean)))
        moving = jac[:, self.moves]
        out[np.ix_(self.moves, self.moves)] = moving.T @ moving  # one array: half the work of a product of two
        return out

    def normal_equations(self, here: _Trial, slopes: _Slopes) -> tuple[FloatArray, FloatArray]:
        """Matrix (p + k, p + k) and right-hand side (p + k,) of a Gauss-Newton step."""
        (c, u, residual, _), (jac, gram, effect) = here, slopes
        p = len(c)
        normal = bordered(gram, jac, effect)
        normal[np.arange(p), np.arange(p)] += self.precision
        normal[p:, p:] += self.believed.precision
        gradient = np.concatenate([jac.T @ residual, effect.T @ residual])
        gradient[:p] -= self.precision * (c - self.mean)
        gradient[p:] -= self.believed.precision @ (u - self.believed.mean)
        if noise := self.wider(u):
            for k, share in enumerate(self.fine):
                moved = u.copy()
                moved[k] += share
                gradient[p + k] -= 0.5 * (self.wider(moved) - noise) / share
        return normal, gradient

    def descend(self, here: _Trial, slopes: _Slopes, damping: float) -> tuple[_Trial | None, float, float]:
        """Where a step leads that lowers the objective, the gain that the straight line foretold, and the damping it
        took; nowhere after six attempts, each damped more.

        Where the straight line foretold more than the step brings, the step is bent, too: along a narrow valley that
        turns, most of the way is in the bend (geodesic acceleration; Transtrum and Sethna 2012, arXiv:1201.5885, with
        the second derivative from the whole step).
        """
        normal, gradient = self.normal_equations(here, slopes)
        p = len(here.nuisance)
        # Parameters at a bound that the step would leave stay there.
        fixed = np.append(~self.moves, np.zeros(self.size, bool))
        fixed[p:] = ((here.unit <= 0) & (gradient[p:] < 0)) | ((here.unit >= 1) & (gradient[p:] > 0))
        free = ~fixed
        step, foretold = np.zeros(len(gradient)), 0.0
        for _ in range(6):
            damped = normal[np.ix_(free, free)]
            damped[np.diag_indices_from(damped)] *= 1.0 + damping
            factor = factorise(damped)
            step[free] = sla.cho_solve(factor, gradient[free])
            trial = self.tried(here, step)
            foretold = float(2 * gradient @ step - step @ normal @ step)
            if here.cost - trial.cost < FORETOLD * foretold:
                bend = np.zeros(len(gradient))
                bend[free] = sla.cho_solve(factor, slopes.missed(here, trial)[free])
                trial = min(trial, self.tried(here, step + bend), key=attrgetter("cost"))
            if trial.cost < here.cost:
                return trial, foretold, damping
            damping = max(damping * 8.0, 1e-4)
        return None, foretold, damping

    def tried(self, here: _Trial, step: FloatArray) -> _Trial:
        """Where a step (p + k,) leads, within the bounds of the effects' parameters."""
        p = len(here.nuisance)
        c, u = here.nuisance + step[:p], np.clip(here.unit + np.clip(step[p:], -0.3, 0.3), 0.0, 1.0)
        residual = self.simulated(c, u).residual
        value = self.cost(residual, c, u)
        return _Trial(c, u, residual, value if np.isfinite(value) else np.inf)

    def finished(self, here: _Trial, slopes: _Slopes) -> Fit:
        """Curvature, evidence terms and covariance at the optimum."""
        (c, u, residual, _), (jac, gram, effect) = here, slopes
        gram = gram if self.moves.all() else jac.T @ jac
        belief = self.believed
        times = self.problem.noise_scale(split(self.hypothesis, u))
        normal = gram.copy()
        normal[np.diag_indices_from(normal)] += self.precision
        penalty = float(np.sum(self.precision * np.square(c - self.mean))) + belief.cost(u)
        covariance = np.zeros((len(u), len(u)))
        if len(c):
            factor = factorise(normal)
            schur = effect.T @ effect - (effect.T @ jac) @ sla.cho_solve(factor, jac.T @ effect)
        else:
            schur = effect.T @ effect
        if len(u):
            covariance = np.linalg.inv(schur + belief.precision + np.eye(len(u)) * UNIFORM_PRECISION)
        return Fit(
            hypothesis=self.hypothesis,
            nuisance=c,
            unit=u,
            residual=residual,
            chi2=float(residual @ residual),
            penalty=penalty,
            covariance=covariance,
            simulations=self.simulations,
            jacobian=jac,
            gram=gram,
            effect_jacobian=effect,
            prior_mean=self.mean.copy(),
            prior_sd=self.sd.copy(),
            belief=belief,
            law_parameters=self.problem.law_parameters,
            wider=self.wider(u) + autocorrelation_penalty(residual, times, self.problem.rows.recording),
        )


def autocorrelation_penalty(residual: FloatArray, times: FloatArray | None, recording: NDArray[np.int64]) -> float:
    """Twice the nats that noise wider by ``times`` (n,) seems to earn on a whitened residual (n,) that is no chance.

    Scattered instants are one by one; a part that neighbours share beyond the noise's is a wrong response, and counts
    as few.
    """
    if times is None:
        return 0.0
    # The share of the residual that is laid to chance: none where noise that remembers foretells some of it.
    share = np.maximum(1.0 - 1.0 / np.square(times), 0.0)
    weight = np.sqrt(share[1:] * share[:-1]) * (recording[1:] == recording[:-1])
    own = 0.5 * float(weight @ (np.square(residual[1:]) + np.square(residual[:-1])))
    common = float(weight @ (residual[1:] * residual[:-1])) - DOUBTED * float(np.linalg.norm(weight))
    together = max(common, 0.0) / max(own, 1e-300)
    earned = float(np.square(residual) @ (np.square(times) - 1.0) - 2.0 * np.sum(np.log(times)))
    return max(earned, 0.0) * 2.0 * together / (1.0 + together)


def predicted(problem: Problem, f: Fit) -> FloatArray:
    """The measurement that a fit of ``problem`` predicts, (n,) SI."""
    return np.asarray(problem.measured - problem.unwhitened(f.residual, f.active))


def under(problem: P, mean: FloatArray, sd: FloatArray) -> P:
    """``problem`` with another prior of its nuisance, (p,) each."""
    out = copy.copy(problem)
    out.prior_mean, out.prior_sd = mean, sd
    return out
