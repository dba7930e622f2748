"""Fitted hypotheses and their Laplace evidence.

After MacKay, "Information Theory, Inference and Learning Algorithms", ch. 27–28.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy.linalg as sla

from gap.inference.hypothesis import FROZEN, Candidate
from gap.inference.linear import bordered, factorise
from sim_devices.chain import FloatArray

UNIFORM_PRECISION = 12.0
"""1/variance of a uniform prior of width 1."""
STRAIGHT = 0.1
"""Share of χ² that a straight line may foretell beyond what a fit found."""
NOWHERE = -1e12
"""log evidence under a width of the prior of which a fit under another one tells nothing."""
MOVED = 1e-3
"""How far a parameter of the nuisance must be from its prior's mean to bend a prediction."""
DISCOUNT = 2.0
"""Times as uncertain as it was fitted that an effect is in the next block, where its form, which is not exact, shows
otherwise."""


@dataclass(frozen=True)
class GaussianPrior:
    """A Gaussian prior of effect parameters from other data: normal, about ``mean`` (k,) in prior quantiles, with
    ``precision`` (k, k), nought where they say nothing."""

    mean: FloatArray
    precision: FloatArray

    @classmethod
    def none(cls, size: int) -> GaussianPrior:
        return cls(np.full(size, 0.5), np.zeros((size, size)))

    def joined(self, size: int, fitted: Fit | None = None) -> GaussianPrior:
        """With one effect more, of ``size`` parameters, of which a fit of another block may know as its last."""
        k = len(self.mean)
        mean, precision = np.full(k + size, 0.5), np.zeros((k + size, k + size))
        mean[:k], precision[:k, :k] = self.mean, self.precision
        if fitted is not None and size:
            mean[k:] = fitted.unit[-size:]
            precision[k:, k:] = np.linalg.inv(DISCOUNT**2 * fitted.covariance[-size:, -size:] + 1e-6 * np.eye(size))
        return GaussianPrior(mean, precision)

    def cost(self, unit: FloatArray) -> float:
        away = unit - self.mean
        return float(away @ self.precision @ away)


def _precision(sd: FloatArray) -> FloatArray:
    """1/variance (p,) of a prior, hardly any where ``sd`` is infinite."""
    return np.where(np.isfinite(sd), 1.0 / np.square(sd), 1e-12)


@dataclass
class Fit:
    """A fitted hypothesis.

    ``chi2`` is of the data alone, ``penalty`` the prior's share, ``wider`` twice the logarithm by which effects of
    chance widen the noise, with what is `autocorrelation_penalty`; ``unit`` (k,) are the effect parameters in prior
    quantiles, in the order of the hypothesis, ``covariance`` (k, k) theirs. ``prior_mean``, ``prior_sd`` (p,) are the
    nuisance's prior that was used: an effect may move the mean of the tissue's parameters.
    ``law_parameters`` is how many of the nuisance's first ones are of a law, as `Problem` says."""

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
    belief: GaussianPrior = field(repr=False)
    law_parameters: int = 0
    wider: float = 0.0

    @property
    def deviance(self) -> float:
        """χ², and the cost of wider noise: comparable with and without effects of chance."""
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
        return np.array([self._evidence(temper, sd) if self._leads_to(sd) else NOWHERE for sd in priors])

    def _leads_to(self, sd: FloatArray) -> bool:
        """Whether a straight line may lead to another width of the prior: to one that freezes what bends the
        prediction, and was moved, none does."""
        moved = np.abs(self.nuisance - self.prior_mean) > MOVED
        frozen = (sd <= FROZEN) & (self.prior_sd > FROZEN)
        return not np.any((moved & frozen)[: self.law_parameters])

    def best_prior(self, priors: Sequence[FloatArray]) -> FloatArray:
        """The most probable of the prior widths ``priors``, (p,)."""
        return priors[int(np.argmax(self.evidences(1.0, priors)))]

    def _evidence(self, temper: float, sd: FloatArray) -> float:
        """log evidence of the model linearised about the fit, under another prior width of the nuisance.

        An effect's parameters are marginalised with it, under a normal prior about the fit that is as wide (variance
        1/12) as the uniform one; but they stay where they were fitted: a straight line would lead them out of their
        range, to gains that do not exist.
        """
        k, p = len(self.unit), len(self.nuisance)
        if not k + p:
            return -0.5 * (self.chi2 / temper + self.wider)
        precision = _precision(sd)
        known = self.belief.precision
        known = known + np.diag(np.where(np.diag(known) > 0, 0.0, UNIFORM_PRECISION))
        normal = self.normal / temper
        normal[np.arange(p), np.arange(p)] += precision
        normal[p:, p:] += known
        factor, lower = factorise(normal)
        b = self._pull / temper
        # The factor's leading part is the factor of the nuisance's own normal matrix.
        gain = float(b @ sla.cho_solve((factor[:p, :p], lower), b)) if p else 0.0
        logdet = 2.0 * float(np.sum(np.log(np.diag(factor)))) - float(np.sum(np.log(precision)))
        logdet -= float(np.linalg.slogdet(known)[1])
        square = float(self.at_mean @ self.at_mean) + self._unreached
        return -0.5 * (square / temper - gain + logdet + self.belief.cost(self.unit) + self.wider)

    @cached_property
    def at_mean(self) -> FloatArray:
        """The residual (n,) with the nuisance at its prior's mean, by the linear model."""
        return self.residual + self.jacobian @ (self.nuisance - self.prior_mean)

    @cached_property
    def _unreached(self) -> float:
        """χ² that the straight line foretells to be gained and the fit did not find, beyond `STRAIGHT` of it: where a
        fit is stuck, the line is no guide, and its gain is none."""
        if not len(self.nuisance):
            return 0.0
        precision = _precision(self.prior_sd)
        normal = self.gram.copy()
        normal[np.diag_indices_from(normal)] += precision
        best = float(self.at_mean @ self.at_mean) - float(self._pull @ sla.cho_solve(factorise(normal), self._pull))
        found = self.chi2 + float(np.sum(precision * np.square(self.nuisance - self.prior_mean)))
        return max(found - best - STRAIGHT * self.chi2, 0.0)

    @cached_property
    def _pull(self) -> FloatArray:
        return self.jacobian.T @ self.at_mean

    @cached_property
    def jacobians(self) -> FloatArray:
        """By nuisance and effects, (n, p + k)."""
        return np.hstack([self.jacobian, self.effect_jacobian])

    @cached_property
    def normal(self) -> FloatArray:
        return bordered(self.gram, self.jacobian, self.jacobians[:, len(self.nuisance) :])

    @property
    def active(self) -> dict[Candidate, dict[str, float]]:
        return split(self.hypothesis, self.unit)

    def place(self, effect: Candidate) -> int:
        """Where the parameters of one of the hypothesis' effects begin in ``unit``."""
        return sum(len(e.parameters) for e in self.hypothesis[: self.hypothesis.index(effect)])

    def told(self, effect: Candidate) -> tuple[FloatArray, FloatArray]:
        """The parameters (k,) of one of the hypothesis' effects, in prior quantiles, and their standard deviations."""
        at = slice(self.place(effect), self.place(effect) + len(effect.parameters))
        return self.unit[at], np.sqrt(np.diag(self.covariance)[at])


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

    def surest(self, effect: Candidate) -> str:
        """The block that tells one of the effects best: its fit believes those of the blocks before it.

        Raises ValueError of an effect that is in none."""
        telling = (b for b, f in self.fits.items() if effect in f.hypothesis)
        return min(telling, key=lambda b: float(np.sum(np.square(self.fits[b].told(effect)[1]))))

    def values(self, effect: Candidate) -> dict[str, float]:
        """The parameters of one of the effects, as the block says that tells it best."""
        return self.fits[self.surest(effect)].active[effect]


def split(hypothesis: Sequence[Candidate], unit: FloatArray) -> dict[Candidate, dict[str, float]]:
    """Parameter values of each effect from one vector of prior quantiles."""
    out, at = {}, 0
    for candidate in hypothesis:
        k = len(candidate.parameters)
        out[candidate] = candidate.values(unit[at : at + k])
        at += k
    return out
