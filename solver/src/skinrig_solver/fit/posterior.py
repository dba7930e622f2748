"""The posterior of a fit's parameters: Laplace's approximation, MCMC, predictive bands, profiles, evidence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np
from scipy import optimize

from ..api import Array
from ..emulator import Emulator, Index, Region
from . import units
from .problem import Problem
from .sampling import Chain, log_evidence, sample
from .statistics import CONFIDENCE
from .surrogate import CONFIRM, Check, Told, checked, emulated
from .target import Emulated, Noise, Target
from .variables import Free

CHAINS = 3  # at most: a chain that leaves the emulator's region too often asks for a wider one
LOST = 0.01  # of the evaluations, beyond the region and worth a draw but not run in full: too often
BANDS = 400  # draws behind a predictive band
GRID = 21  # points of a profile
KEPT = 500  # draws written to JSON


@dataclass(frozen=True)
class Marginal:
    """One parameter, SI: ``quantiles`` 2.5, 25, 50, 75, 97.5 %; Laplace's mean and deviation; ``profile`` (k, 2) of
    values and rises of chi-squared of the likelihood alone, its 95 % interval infinite where it does not close."""

    free: Free
    unit: str
    mean: float
    deviation: float
    quantiles: tuple[float, ...]
    laplace_value: float
    laplace_deviation: float
    rhat: float
    profile: Array
    profile_interval: tuple[float, float]

    @property
    def interval(self) -> tuple[float, float]:
        """The central 95 %."""
        return self.quantiles[0], self.quantiles[-1]


@dataclass(frozen=True)
class Posterior:
    """Draws (count, m) of the parameters in SI and everything that follows from them. ``bands`` (3, n) are 2.5, 50 and
    97.5 % of each compared curve, noise included, in the order of the problem's groups. ``log_evidence`` holds the
    value by importance sampling, its error, and Laplace's."""

    marginals: tuple[Marginal, ...]
    draws: Array
    correlation: Array
    chain: Chain
    check: Check
    bands: tuple[Array, ...]
    log_evidence: tuple[float, float, float]
    noise: Noise
    full_solves: int
    beyond: int
    left_out: int
    evaluations: int
    seconds: float
    microseconds: float
    warnings: tuple[str, ...]

    @property
    def trusted(self) -> bool:
        """Whether the chains converged on an emulator that held-out solves confirm."""
        return self.chain.converged and self.check.good

    def as_dict(self) -> dict[str, Any]:
        """Plain data, SI."""
        step = max(1, len(self.draws) // KEPT)
        return {
            "trusted": self.trusted,
            "warnings": self.warnings,
            "parameters": [_plain_marginal(m) for m in self.marginals],
            "correlation": self.correlation,
            "draws": self.draws[::step],
            "mcmc": {
                "converged": self.chain.converged,
                "steps": self.chain.steps,
                "walkers": self.chain.walkers,
                "autocorrelation_steps": self.chain.autocorrelation,
                "effective_draws": self.chain.effective,
                "acceptance": self.chain.acceptance,
                "rhat": max(m.rhat for m in self.marginals),
            },
            "emulator": {
                **self.check.__dict__,
                "good": self.check.good,
                "full_solves": self.full_solves,
                "evaluations": self.evaluations,
                "beyond": self.beyond,
                "left_out": self.left_out,
                "microseconds_a_curve": self.microseconds,
            },
            "log_evidence": dict(zip(("value", "error", "laplace"), self.log_evidence, strict=True)),
            "noise": {"deviation": self.noise.deviation, "persistence": self.noise.persistence},
            "seconds": self.seconds,
        }

    def in_words(self) -> str:
        """A short report for a terminal."""
        size = max(len(m.free.symbol) for m in self.marginals)
        chain, check = self.chain, self.check
        lines = [
            f"posterior: {len(self.draws)} draws worth {chain.effective:.0f} independent ones "
            f"(R-hat {max(m.rhat for m in self.marginals):.3f}, autocorrelation {chain.autocorrelation:.0f} of "
            f"{chain.steps} steps), {self.full_solves} full solves, {self.seconds:.1f} s"
        ]
        for m in self.marginals:
            low, high = (units.show(x, m.unit, 3) for x in m.interval)
            lines.append(f"  {m.free.symbol:<{size}}  {units.show(m.quantiles[2], m.unit):>12}  95 %: {low} … {high}")
        lines.append(
            f"  emulator of degree {check.degree}: {self.microseconds:.0f} µs a curve. At {check.held_out} draws run "
            f"in full it is off by {check.density_error:.2g} r.m.s. in the log density and {check.curve_error:.2g} "
            f"noise deviations; weighed by the full model draws are worth {100 * check.worth:.0f} % and no mean moves "
            f"by more than {check.shift:.2g} of its deviations; "
            f"{self.beyond} of {self.evaluations} evaluations beyond it, {self.beyond - self.left_out} run in full"
        )
        return "\n".join(lines + [f"! {warning}" for warning in self.warnings])


def posterior(
    problem: Problem,
    z: Array,
    noise: Noise,
    seed: int = 0,
    executor: Executor | None = None,
    told: Told = lambda _: None,
) -> Posterior:
    """The posterior around a fit's optimum z (m,): see `Target` for the density.

    Raises ImportError naming a missing package; ValueError where the model cannot be run around the optimum.
    """
    began = perf_counter()
    target = Target(problem, noise, executor)
    emulator, draws, check = emulated(target, z, seed, told)
    for again in range(CHAINS):
        target.begin_chain()
        told("drawing from the posterior")
        density = Emulated(target, emulator, strict=False)
        chain = sample(density, draws, seed + 1)
        if target.lost <= LOST or again == CHAINS - 1:
            break
        emulator, draws, check = emulated(target, z, seed, told, chain.draws)  # the posterior reaches farther
    told("comparing draws with the full model")
    check = checked(target, emulator, chain.draws, np.random.default_rng(seed + 4), check.rounds, CONFIRM)
    best = _maximum(Emulated(target, emulator, strict=True), chain.draws[np.argmax(chain.log_density)])
    marginals = _marginals(density, chain, best)
    strict = Emulated(target, emulator, strict=True)
    evidence = (*log_evidence(strict, chain.draws, seed + 2), _laplace_evidence(density, best))
    bands = _bands(problem, emulator, chain.draws, noise, seed + 3)
    clock = perf_counter()
    for point in chain.draws[:100]:
        emulator.curves(point[None])
    micro = 1e6 * (perf_counter() - clock) / min(100, len(chain.draws))
    with np.errstate(invalid="ignore", divide="ignore"):
        correlation = np.atleast_2d(np.corrcoef(chain.draws.T))
    return Posterior(
        marginals, _values(problem, chain.draws), correlation, chain, check, bands, evidence, noise,
        target.full_solves, target.beyond, target.dropped, target.evaluations, perf_counter() - began, micro,
        tuple(_doubts(target, chain, check)),
    )  # fmt: skip


def _maximum(density: Emulated, start: Array) -> Array:
    """The density's highest point near ``start``."""
    shape = density.emulator.region.shape

    def objective(x: Array) -> float:
        value = float(density((start + shape @ x)[None])[0])
        return -value if np.isfinite(value) else 1e30

    done = optimize.minimize(objective, np.zeros(start.size), method="Powell", options={"xtol": 1e-4, "ftol": 1e-9})
    return np.asarray(start + shape @ done.x)


def _laplace_covariance(density: Emulated, best: Array) -> Array:
    """Inverse of Gauss and Newton's curvature of the log posterior at its maximum: (m, m)."""
    lower, upper = density.target.variables.bounds
    curvature = density.information(best) + np.diag(density.target.prior_curvature(best))
    return np.asarray(np.linalg.inv(curvature + np.diag(1e-9 / (upper - lower) ** 2)))


def _laplace_evidence(density: Emulated, best: Array) -> float:
    top = float(density(best[None])[0])
    covariance = _laplace_covariance(density, best)
    return top + 0.5 * best.size * float(np.log(2.0 * np.pi)) + 0.5 * float(np.linalg.slogdet(covariance)[1])


def _marginals(density: Emulated, chain: Chain, best: Array) -> tuple[Marginal, ...]:
    variables = density.target.variables
    laplace = np.sqrt(np.diag(_laplace_covariance(density, best)))
    draws = _values(density.target.problem, chain.draws)
    found = []
    for k, free in enumerate(variables.free):
        own = draws[:, k]
        value = free.value(float(best[k]))
        curve, interval = _profile(density, chain, best, k)
        quantiles = tuple(float(q) for q in np.quantile(own, [0.025, 0.25, 0.5, 0.75, 0.975]))
        found.append(
            Marginal(
                free, variables.info[free.symbol].unit, float(own.mean()), float(own.std(ddof=1)), quantiles, value,
                float(laplace[k]) * free.slope(value), float(chain.rhat[k]), curve, interval,
            )
        )  # fmt: skip
    return tuple(found)


def _profile(density: Emulated, chain: Chain, best: Array, k: int) -> tuple[Array, tuple[float, float]]:
    """Profile likelihood of parameter k on the emulator: (points, 2), and where its chi-squared has risen by 3.84."""
    region, free = density.emulator.region, density.target.variables.free[k]
    low, high = np.quantile(chain.draws[:, k], [0.0005, 0.9995])
    grid = np.linspace(low, high, GRID)
    others = np.delete(np.arange(best.size), k)
    chi = np.empty(GRID)
    middle = int(np.argmin(np.abs(grid - best[k])))
    for side in (range(middle, GRID), range(middle, -1, -1)):
        z = best.copy()
        for i in side:
            z[k] = grid[i]
            if others.size:
                z[others] = _followed(density, region, z, others)
            chi[i] = -2.0 * float(density.log_likelihood(z[None])[0])
    rise = chi - min(float(chi.min()), -2.0 * float(density.log_likelihood(best[None])[0]))
    values = np.array([free.value(float(x)) for x in grid])
    inner = np.flatnonzero(rise <= CONFIDENCE)
    ends = [-np.inf, np.inf]
    if inner.size and inner[0] > 0:
        ends[0] = float(np.interp(CONFIDENCE, rise[[inner[0], inner[0] - 1]], values[[inner[0], inner[0] - 1]]))
    if inner.size and inner[-1] < GRID - 1:
        ends[1] = float(np.interp(CONFIDENCE, rise[[inner[-1], inner[-1] + 1]], values[[inner[-1], inner[-1] + 1]]))
    return np.stack([values, rise], axis=1), (ends[0], ends[1])


def _followed(density: Emulated, region: Region, z: Array, others: Index) -> Array:
    """The other coordinates that make the likelihood largest, within their bounds."""

    def objective(x: Array) -> tuple[float, Array]:
        point = z.copy()
        point[others] = x
        value, slope = density.with_gradient(point)
        return -value, -slope[others]

    bounds = list(zip(region.lower[others], region.upper[others], strict=True))
    done = optimize.minimize(objective, z[others], jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": 40})
    return np.asarray(done.x)


def _bands(problem: Problem, emulator: Emulator, draws: Array, noise: Noise, seed: int) -> tuple[Array, ...]:
    random = np.random.default_rng(seed)
    step = max(1, len(draws) // BANDS)
    curves = emulator.curves(draws[::step])  # model minus data over noise
    found = []
    for (number, channel, where), sd in zip(problem.groups(), noise.deviation, strict=True):
        own = curves[:, where] + random.standard_normal(curves[:, where].shape)
        data = problem.cases[number].data[channel]
        found.append(np.quantile(own, [0.025, 0.5, 0.975], axis=0) * sd + data)
    return tuple(found)


def _values(problem: Problem, draws: Array) -> Array:
    """Draws (count, m) of coordinates as values in SI."""
    return np.array([[f.value(float(x)) for f, x in zip(problem.variables.free, z, strict=True)] for z in draws])


def _doubts(target: Target, chain: Chain, check: Check) -> Sequence[str]:
    words = []
    if not chain.converged:
        words.append(
            f"the posterior did not converge: R-hat {chain.rhat.max():.3f}, autocorrelation time "
            f"{chain.autocorrelation:.0f} of {chain.steps} steps; its intervals are a guess"
        )
    if not check.good:
        words.append(
            f"the emulator is off by {check.density_error:.2g} in the log density at held-out solves after "
            f"{target.full_solves} full ones: the posterior's shape is a guess to that extent"
        )
    if target.lost > LOST:
        words.append(
            f"{target.beyond} of {target.evaluations} evaluations lay beyond the emulator's region, too many to be run "
            f"in full: {target.dropped} were left out, so the posterior may be cut short there"
        )
    return words


def _plain_marginal(m: Marginal) -> Mapping[str, Any]:
    return {
        "symbol": m.free.symbol,
        "unit": m.unit,
        "prior": m.free.prior.in_words(m.unit) if m.free.prior else "flat between the bounds",
        "mean": m.mean,
        "standard_deviation": m.deviation,
        "quantiles": dict(zip(("2.5", "25", "50", "75", "97.5"), m.quantiles, strict=True)),
        "laplace": {"value": m.laplace_value, "standard_deviation": m.laplace_deviation},
        "rhat": m.rhat,
        "profile": m.profile,
        "profile_interval_95": m.profile_interval,
    }
