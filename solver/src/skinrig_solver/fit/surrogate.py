"""An emulator for a posterior: trained where the draws go, and checked at held-out ones until it is right there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import stats

from ..api import Array
from ..emulator import Basis, Emulator, Features, Region, Solve, train
from .features import features
from .sampling import sample
from .target import Emulated, Target, reach

CHECKS = 8  # held-out full solves a round
FARTHER = 4  # full solves a round where the draws of an emulator of features reach its rim
CONFIRM = 12  # of the final draws run in full
AIM = 0.2  # error of the log density at held-out draws, r.m.s. about a common shift, below which training ends
GOOD = 0.3  # at draws of the final chain that is accepted: no mean of the posterior can then be off by more than 0.3 of
# its deviation, and draws weighed by the full model would keep 91 % of their worth
ROUNDS = 8
MOST_SOLVES = 240
WIDE = 1.15  # of the region over the farthest of nearly all draws
SHARE = 0.999  # of the draws that the region must hold
MOST = 0.99  # of them that must keep away from its rim where features bound it: a posterior with long tails touches
# that rim however far out it lies, and the final chain counts what it loses beyond
AWAY = 0.9  # of the way to such a rim: nearer, the chain would lose too much beyond, and have to be drawn twice
SPREAD = 1.2  # of training points over the posterior's own deviations
ROUGH = 3.0  # error of the log density above which an emulator's draws do not move the region
STEPS = 8  # towards the maximum
NEAR = 0.1  # squared length of a step in the density's own deviations at which it counts as reached
Told = Callable[[str], None]


@dataclass(frozen=True)
class Check:
    """How right the emulator is at held-out draws: largest error of a curve in its noise's deviations, and r.m.s. error
    of the log density about a common shift; ``worth`` is the share of independent draws that remain when held-out ones
    are weighed by the full model, ``shift`` the farthest that so moves the mean of a parameter, in its deviations."""

    curve_error: float
    density_error: float
    worth: float
    shift: float
    held_out: int
    training: int
    degree: int
    modes: int
    rounds: int

    @property
    def good(self) -> bool:
        return self.density_error <= GOOD


def emulated(
    target: Target, z: Array, seed: int, told: Told, around: Array | None = None
) -> tuple[Emulator, Array, Check]:
    """An emulator of the region that the posterior fills, draws from it, and how right it is at held-out ones.

    The region follows the draws from round to round, and each round's held-out solves train the next one's emulator.
    It begins around the density's maximum near z (m,), or where the draws ``around`` of a chain lie, for which an
    earlier one was too small.
    """
    random = np.random.default_rng(seed)
    m = z.size
    told("training the emulator")
    spent = target.full_solves
    z = target.in_order(z[None])[0]
    region = _first_region(target, _towards_maximum(target, z)) if around is None else _region_of(around, target)
    own = features(target.variables, target.problem.cases)
    size = m if own is None else own.values(region.centre[None]).shape[1]
    wanted = max(4, int(np.ceil(1.3 * len(Basis.of(size, 2 if size > 8 else 3).orders) / (m + 1))))
    target.solve(region.points(_scattered(wanted, region, seed)))
    for number in range(1, ROUNDS + 1):
        emulator = _trained(target, region, own)
        density = Emulated(target, emulator, strict=True)
        draws = sample(density, _starts(density, target, random), seed + number, 2000, 500, 1).draws
        check = checked(target, emulator, draws, random, number)
        told(f"emulator, round {number}: log density off by {check.density_error:.2g} at held-out solves")
        fits = _fits(emulator, draws)
        if (check.density_error <= AIM and fits) or target.full_solves - spent + CHECKS > MOST_SOLVES:
            break
        if check.density_error > ROUGH:  # its draws are no guide to where the posterior lies
            target.solve(region.points(_scattered(wanted // 2, region, seed + number)))
        elif not fits:
            region = _region_of(draws, target)
            if own is not None:  # to where the features go farthest
                far = np.argsort(np.linalg.norm(emulator.chart.points(draws), axis=1))[-len(draws) // 50 :]
                target.solve(draws[random.choice(far, FARTHER, replace=False)])
    if check.density_error <= AIM:  # the held-out solves make it no worse
        emulator = _trained(target, region, own)
    return emulator, draws, check


def _trained(target: Target, region: Region, own: Features | None) -> Emulator:
    return train(target.solves, region, lambda curves: _weights(target, curves), own)


def _towards_maximum(target: Target, z: Array) -> Solve:
    """Gauss and Newton's steps from z to near the density's maximum: a prior may pull it away from the fit."""
    lower, upper = target.variables.bounds
    best, height = None, -np.inf
    for _ in range(STEPS):
        (here,) = target.solve(z[None])
        if here is None:
            break
        top = float(target.log_prior(z[None])[0] + target.log_likelihood(here.curve[None])[0])
        if top <= height:
            break
        best, height = here, top
        slope = target.prior_slope(z) - here.slopes.T @ (target.share * here.curve)
        step = _laplace(target, here) @ slope
        if step @ slope < NEAR:
            break
        margin = 1e-6 * (upper - lower)
        z = np.clip(z + step, lower + margin, upper - margin)
    if best is None:
        raise ValueError("the posterior cannot begin: the model cannot be run at the fit's optimum")
    return best


def _laplace(target: Target, here: Solve) -> Array:
    """Covariance (m, m) of the normal density that has the posterior's curvature, no wider than a flat prior's own."""
    lower, upper = target.variables.bounds
    information = here.slopes.T @ (here.slopes * target.share[:, None]) + np.diag(target.prior_curvature(here.z))
    flat = np.diag(12.0 / (upper - lower) ** 2)  # of a uniform density: what bounds alone tell
    return np.asarray(np.linalg.inv(information + flat))


def _first_region(target: Target, here: Solve) -> Region:
    shape = np.asarray(np.linalg.cholesky(_laplace(target, here)), dtype=np.float64)
    return Region(here.z, shape, reach(here.z.size), *target.variables.bounds)


def _region_of(draws: Array, target: Target) -> Region:
    lower, upper = target.variables.bounds
    m = draws.shape[1]
    centre = draws.mean(axis=0)
    covariance = np.cov(draws.T).reshape(m, m) + 1e-12 * np.diag((upper - lower) ** 2)
    shape = np.asarray(np.linalg.cholesky(covariance), dtype=np.float64)
    region = Region(centre, shape, 1.0, lower, upper)
    farthest = float(np.quantile(np.linalg.norm(region.units(draws), axis=1), SHARE))
    return Region(centre, shape, max(WIDE * farthest, reach(m)), lower, upper)


def _fits(emulator: Emulator, draws: Array) -> bool:
    """Whether the draws keep away from the region's rim, and fill a good part of it where it is an ellipsoid."""
    region, chart = emulator.region, emulator.chart
    if chart.features is not None:
        size = np.linalg.norm(chart.points(draws), axis=1)
        return float(np.quantile(size, MOST)) <= AWAY * chart.radius
    farthest = float(np.quantile(np.linalg.norm(region.units(draws), axis=1), SHARE))
    return 0.4 <= farthest <= 0.97


def _scattered(count: int, region: Region, seed: int) -> Array:
    """Points in the unit ball, as dense as a normal density that the region just holds (Sobol's sequence).

    In several dimensions nearly all of a ball's volume lies at its rim, where a posterior has next to nothing.
    """
    m = region.centre.size
    sequence = stats.qmc.Sobol(m, seed=seed).random_base2(max(1, int(np.ceil(np.log2(count)))))[:count]
    u = SPREAD * stats.norm.ppf(sequence.clip(1e-6, 1 - 1e-6)) / reach(m)
    return np.asarray(u / np.linalg.norm(u, axis=1, keepdims=True).clip(1.0))


def _weights(target: Target, curves: Array) -> Array:
    """How much a full solve counts in training (b,): less, the less likely its curves (b, n) are."""
    likely = target.log_likelihood(curves)
    m = target.variables.start.size
    return np.asarray(1.0 / np.sqrt(1.0 + (likely.max() - likely) / (2.0 * m)))


def _starts(density: Emulated, target: Target, random: np.random.Generator) -> Array:
    """Points of the region from which walkers set out: spread by importance, so that few begin where nothing is."""
    region = density.emulator.region
    m = region.centre.size
    u = _scattered(4096, region, int(random.integers(1 << 30)))
    z = target.in_order(region.points(u))
    value = density(z)
    good = np.isfinite(value)
    if not good.any():
        raise ValueError("the posterior is zero all around the fit's optimum")
    order = np.argsort(value[good])[::-1]
    return np.asarray(z[good][order[: max(64, 8 * m)]])


def checked(
    target: Target, emulator: Emulator, draws: Array, random: np.random.Generator, number: int, count: int = CHECKS
) -> Check:
    """The full model at ``count`` of the draws, which the emulator was not trained on."""
    z = draws[random.choice(len(draws), min(count, len(draws)), replace=False)]
    solved = [s for s in target.solve(z) if s is not None]
    if len(solved) < 2:
        return Check(np.inf, np.inf, 0.0, np.inf, 0, emulator.solves, emulator.degree, emulator.modes.shape[1], number)
    points, curves = np.array([s.z for s in solved]), np.array([s.curve for s in solved])
    guess = emulator.curves(points)
    used = target.share > 0.0
    off = target.log_likelihood(curves) - target.log_likelihood(guess)
    weight = np.exp(off - off.max())
    weight /= weight.sum()
    shift = (weight @ points - points.mean(axis=0)) / draws.std(axis=0).clip(1e-300)
    return Check(
        float(np.abs(guess - curves)[:, used].max()), float(off.std(ddof=1)),
        float(1.0 / (weight @ weight) / len(solved)), float(np.abs(shift).max()), len(solved),
        emulator.solves, emulator.degree, emulator.modes.shape[1], number,
    )  # fmt: skip
