"""An emulator for a posterior: trained where the draws go, and checked at held-out ones until it is right there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import stats

from ..api import Array
from ..emulator import Basis, Emulator, Region, Solve, train
from .sampling import sample
from .target import Emulated, Target, reach

CHECKS = 8  # held-out full solves a round
GOOD = 0.25  # largest error of the log density at a held-out draw, up to a common shift, that is accepted
ROUNDS = 8
MOST_SOLVES = 240
WIDE = 1.15  # of the region over the farthest of nearly all draws
SHARE = 0.999  # of the draws that the region must hold

SPREAD = 1.2  # of training points over the posterior's own deviations
ROUGH = 3.0  # error of the log density above which an emulator's draws do not move the region
STEPS = 8  # towards the maximum
NEAR = 0.1  # squared length of a step in the density's own deviations at which it counts as reached
Told = Callable[[str], None]


@dataclass(frozen=True)
class Check:
    """How right the emulator is at held-out draws: largest error of a curve in its noise's deviations, and of the log
    density up to a common shift; ``refined`` rounds, ``degree`` and ``modes`` of the emulator."""

    curve_error: float
    density_error: float
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
    region = _first_region(target, _towards_maximum(target, z)) if around is None else _region_of(around, target)
    wanted = max(4, int(np.ceil(1.3 * len(Basis.of(m, 2 if m > 8 else 3).orders) / (m + 1))))
    target.solve(region.points(_scattered(wanted, region, seed)))
    check = Check(np.inf, np.inf, 0, 0, 0, 0, 0)
    for number in range(1, ROUNDS + 1):
        emulator = train(target.solves, region, lambda curves: _weights(target, curves))
        density = Emulated(target, emulator, strict=True)
        draws = sample(density, _starts(density, target, random), seed + number, 2000, 1000, 1).draws
        held_out = draws[random.choice(len(draws), CHECKS, replace=False)]
        check = _check(target, emulator, held_out, number)
        told(f"emulator, round {number}: log density off by {check.density_error:.2g} at held-out solves")
        fits = _fits(region, draws)
        if (check.good and fits) or target.full_solves - spent + CHECKS > MOST_SOLVES:
            break
        if check.density_error > ROUGH:  # its draws are no guide to where the posterior lies
            target.solve(region.points(_scattered(wanted // 2, region, seed + number)))
        elif not fits:
            region = _region_of(draws, target)
    return emulator, draws, check


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


def _fits(region: Region, draws: Array) -> bool:
    """Whether the draws keep away from the region's rim, and fill a good part of it."""
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
    z = region.points(u)
    value = density(z)
    good = np.isfinite(value)
    if not good.any():
        raise ValueError("the posterior is zero all around the fit's optimum")
    order = np.argsort(value[good])[::-1]
    return np.asarray(z[good][order[: max(64, 8 * m)]])


def _check(target: Target, emulator: Emulator, z: Array, number: int) -> Check:
    solved = [s for s in target.solve(z) if s is not None]
    if not solved:
        return Check(np.inf, np.inf, 0, emulator.solves, emulator.degree, emulator.modes.shape[1], number)
    points, curves = np.array([s.z for s in solved]), np.array([s.curve for s in solved])
    guess = emulator.curves(points)
    used = target.share > 0.0
    off = target.log_likelihood(guess) - target.log_likelihood(curves)
    return Check(
        float(np.abs(guess - curves)[:, used].max()), float(np.abs(off - off.mean()).max()), len(solved),
        emulator.solves, emulator.degree, emulator.modes.shape[1], number,
    )  # fmt: skip
