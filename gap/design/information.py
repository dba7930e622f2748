"""The decision theory of the next experiment: the information on the cause that its outcome is expected to give.

Rows of session and experiment are y = Δ_s + J c + noise, with Δ_s the change by explanation s, c the unknowns with a
Gaussian prior, noise white. Given the session, an experiment's rows are Gaussian about μ_s with a covariance V that all
explanations share; `seen` whitens by it. An explanation is a cloud of draws, because its parameters are not known
either: a Gaussian of its own mean and covariance. Information and the probability of a right answer are then those of
a mixture of Gaussians (Chaloner and Verdinelli 1995, Stat. Sci. 10:273; Box and Hill 1967, Technometrics 9:57).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg as sla

from gap.design.unknowns import Column
from gap.inference.linear import factorise
from sim_devices.chain import FloatArray

DRAWS = 600
"""Simulated outcomes from which information and chance of a right answer are reckoned."""
OPEN = 1.5
"""Tempered σ, rms about their mean, of two explanations that are 3 σ apart, the least at which data tell them apart."""

Columns = Mapping[Column, FloatArray]
"""Whitened columns (n,) of unknowns, each for one width of its prior."""


@dataclass(frozen=True)
class Worth:
    """The expected worth of an experiment: ``information`` of the cause in bits; the probability that the most
    probable cause is the right one ``before`` and ``after`` it."""

    information: float
    before: float
    after: float


class Known:
    """The session: the precision of the unknowns after it, and their mean under each explanation."""

    def __init__(self, unknowns: Columns, more: Sequence[Column] = (), temper: float = 1.0) -> None:
        self.names = [*unknowns, *(m for m in more if m not in unknowns)]
        rows = len(next(iter(unknowns.values())))
        self._temper = temper
        self._jacobian = np.zeros((rows, len(self.names)))
        for k, name in enumerate(self.names):
            if name in unknowns:
                self._jacobian[:, k] = unknowns[name]
        normal = self._jacobian.T @ self._jacobian / temper
        normal[np.diag_indices_from(normal)] += 1.0
        self._factor = factorise(normal)

    def unknown(self, change: FloatArray) -> FloatArray:
        """The unknowns (p,) or (p, k) that take up a ``change`` (n,) or (n, k) of the session best."""
        return np.asarray(sla.cho_solve(self._factor, self._jacobian.T @ change / self._temper))

    def left(self, change: FloatArray) -> FloatArray:
        """The part of a change that the unknowns cannot take up (n,), in tempered σ, and how far they move to take
        up the rest, in widths of their priors, (n + p,): its length is the `distance`."""
        unknown = self.unknown(change)
        return np.concatenate([(change - self._jacobian @ unknown) / np.sqrt(self._temper), unknown])

    def distance(self, change: FloatArray) -> FloatArray:
        """How far changes (n,) or (n, k) stand out in the session, in tempered σ: δ² = Δᵀ P Δ."""
        square = np.sum(change * (change - self._jacobian @ self.unknown(change)), axis=0) / self._temper
        return np.asarray(np.sqrt(np.maximum(square, 0.0)))

    def tempered(self, changes: FloatArray, weights: FloatArray) -> Known:
        """The same with so much error of form that explanations which a session leaves open, of ``changes`` (n, k) and
        ``weights`` (k,), are not further apart in it than one session could leave them (`OPEN`)."""
        share = weights / weights.sum()
        away = self.distance(changes - (changes @ share)[:, None])
        spread = float(np.sqrt(share @ np.square(away)))
        if spread <= OPEN:
            return self
        there = {name: self._jacobian[:, k] for k, name in enumerate(self.names)}
        return Known(there, (), self._temper * (spread / OPEN) ** 2)

    def seen(self, there: Columns, in_session: FloatArray, in_experiment: FloatArray) -> FloatArray:
        """Explanations as the experiment would show them, whitened (k, r ≤ k): the change of each in the session (n, k)
        is taken up by the unknowns, as the session demands, and their change of the experiment is taken off its own
        there (m, k)."""
        jacobian = np.zeros((in_experiment.shape[0], len(self.names)))
        for k, name in enumerate(self.names):
            if name in there:
                jacobian[:, k] = there[name]
        mean = in_experiment - jacobian @ self.unknown(in_session)
        mean = (mean - mean.mean(axis=1, keepdims=True)) / np.sqrt(self._temper)
        # V = 1 + J C Jᵀ with C the unknowns' covariance: V⁻¹ by Woodbury's identity.
        root = sla.solve_triangular(self._factor[0], jacobian.T, trans="T", lower=self._factor[1]) / np.sqrt(
            self._temper
        )
        inner = root @ root.T
        inner[np.diag_indices_from(inner)] += 1.0
        half = root @ mean
        gram = mean.T @ mean - half.T @ sla.cho_solve(factorise(inner), half)
        values, vectors = np.linalg.eigh(0.5 * (gram + gram.T))
        kept = values > 1e-9 * max(float(values[-1]), 1e-12)
        return np.asarray(vectors[:, kept] * np.sqrt(values[kept]))


def worth(
    points: FloatArray, weights: FloatArray, labels: Sequence[str], rng: np.random.Generator, draws: int = DRAWS
) -> Worth:
    """The worth of an experiment that shows explanations at ``points`` (k, r), of ``weights`` (k,) and ``labels``."""
    names = list(dict.fromkeys(labels))
    share = np.array([sum(w for w, x in zip(weights, labels, strict=True) if x == n) for n in names])
    share = share / share.sum()
    before = float(share.max())
    if points.shape[1] == 0 or len(names) < 2:
        return Worth(0.0, before, before)
    clouds = []
    for n in names:
        mine = [k for k, x in enumerate(labels) if x == n]
        w = np.array([weights[k] for k in mine])
        clouds.append(_cloud(points[mine], w / w.sum()))
    which = rng.choice(len(names), size=draws, p=share)
    r = points.shape[1]
    y = np.empty((draws, r))
    for k, (mean, root) in enumerate(clouds):
        at = np.flatnonzero(which == k)
        own, noise = rng.standard_normal((len(at), root.shape[1])), rng.standard_normal((len(at), r))
        y[at] = mean + noise + own @ root.T
    log = np.stack([_log_density(y, mean, root) for mean, root in clouds], axis=1) + np.log(np.maximum(share, 1e-12))
    log -= np.logaddexp.reduce(log, axis=1, keepdims=True)
    posterior = np.exp(log)
    entropy = -float(np.sum(share * np.log2(np.maximum(share, 1e-12))))
    remaining = -float(np.mean(np.sum(posterior * log, axis=1))) / np.log(2.0)
    after = float(np.mean(posterior.max(axis=1)))
    return Worth(float(max(entropy - remaining, 0.0)), before, max(after, before))


def _cloud(points: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean (r,) and a root (r, k) of the covariance of weighted points (k, r)."""
    mean = weights @ points
    return mean, ((points - mean) * np.sqrt(weights)[:, None]).T


def _log_density(y: FloatArray, mean: FloatArray, root: FloatArray) -> FloatArray:
    """log N(y; mean, 1 + root rootᵀ) of outcomes (n, r), up to a constant."""
    inner = root.T @ root
    inner[np.diag_indices_from(inner)] += 1.0
    factor = factorise(inner)
    away = y - mean
    half = away @ root
    square = np.sum(away**2, axis=1) - np.sum(half * sla.cho_solve(factor, half.T).T, axis=1)
    return np.asarray(-0.5 * (square + 2.0 * np.sum(np.log(np.diag(factor[0])))))
