"""Random draws from a density, and whether there are enough of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..api import Array

LogDensity = Callable[[Array], Array]  # (b,) at points (b, m)
ENSEMBLES = 4  # independent ones, for R-hat
RHAT = 1.01  # Vehtari et al. (Bayesian Analysis 16, 2021)
LENGTHS = 50.0  # autocorrelation times that a chain must last (emcee's own advice)
CHUNK = 500
MOST = 8000  # steps of each ensemble


@dataclass(frozen=True)
class Chain:
    """Draws (count, m) with their log densities (count,), thinned and mixed over ensembles; what says they suffice.

    ``autocorrelation`` is the longest of any parameter, in steps of ``steps``; ``rhat`` (m,) compares halves of
    ensembles.
    """

    draws: Array
    log_density: Array
    steps: int
    walkers: int
    acceptance: float
    autocorrelation: float
    rhat: Array

    @property
    def converged(self) -> bool:
        return bool(self.steps >= LENGTHS * self.autocorrelation and np.all(self.rhat <= RHAT))

    @property
    def effective(self) -> float:
        """Independent draws that the chain is worth."""
        return ENSEMBLES * self.walkers * self.steps / max(self.autocorrelation, 1.0)


def sample(
    density: LogDensity, starts: Array, seed: int, keep: int = 2000, most: int = MOST, ensembles: int = ENSEMBLES
) -> Chain:
    """Draw by affine-invariant ensembles (Goodman and Weare 2010; `emcee`) until they converged or ``most`` steps.

    ``starts`` (count, m) are points of positive density; walkers begin at different ones of them. Raises ImportError
    naming the package that is missing; ValueError for too few starts.
    """
    try:
        import emcee
    except ImportError as error:
        raise ImportError("posteriors need emcee: pip install 'skinrig-solver[posterior]'") from error
    m = starts.shape[1]
    walkers = max(2 * m + 2, 16)
    random = np.random.default_rng(seed)
    samplers, states = [], []
    moves = [(emcee.moves.DEMove(), 0.7), (emcee.moves.DESnookerMove(), 0.1), (emcee.moves.StretchMove(), 0.2)]
    for number in range(ensembles):
        if len(starts) < walkers:
            raise ValueError(f"{walkers} walkers need as many starts, there are {len(starts)}")
        chosen = starts[random.choice(len(starts), walkers, replace=False)]
        sampler = emcee.EnsembleSampler(walkers, m, density, moves=moves, vectorize=True)
        sampler._random.seed(seed + 7919 * number)  # the sampler has no public way to be repeatable
        samplers.append(sampler)
        states.append(emcee.State(chosen))
    chain: Chain | None = None
    done = 0
    while done < most and (chain is None or not chain.converged):
        count = min(CHUNK, most - done)
        states = [
            s.run_mcmc(state, count, skip_initial_state_check=True) for s, state in zip(samplers, states, strict=True)
        ]
        done += count
        chain = _chain([s.get_chain() for s in samplers], [s.get_log_prob() for s in samplers], samplers, keep, random)
    assert chain is not None
    return chain


def _chain(
    runs: list[Array], densities: list[Array], samplers: list[object], keep: int, random: np.random.Generator
) -> Chain:
    steps, walkers, m = runs[0].shape
    first = steps // 4  # the way in from the starts
    late = np.stack([run[first:] for run in runs])  # (ensembles, steps, walkers, m)
    times = [autocorrelation_time(late[..., k]) for k in range(m)]
    flat, density = late.reshape(-1, m), np.stack([d[first:] for d in densities]).ravel()
    chosen = np.sort(random.choice(len(flat), min(keep, len(flat)), replace=False))
    accepted = float(np.mean([s.acceptance_fraction.mean() for s in samplers]))  # type: ignore[attr-defined]
    return Chain(flat[chosen], density[chosen], late.shape[1], walkers, accepted, max(times), split_rhat(late))


def autocorrelation_time(values: Array) -> float:
    """Integrated autocorrelation time [steps] of (ensembles, steps, walkers), at least 1 (Sokal's window of five).

    The walkers' autocorrelation functions are averaged before they are summed, as Goodman and Weare (2010) advise
    against for one ensemble only, and emcee does.
    """
    series = np.moveaxis(values, 1, -1).reshape(-1, values.shape[1])
    series = series - series.mean()
    n = series.shape[1]
    power = np.abs(np.fft.rfft(series, 2 * n, axis=1)) ** 2
    correlation = np.fft.irfft(power, axis=1)[:, :n].mean(axis=0)
    if not correlation[0] > 0.0:
        return 1.0
    total = 2.0 * np.cumsum(correlation / correlation[0]) - 1.0
    window = np.flatnonzero(np.arange(n) >= 5.0 * total)
    return float(max(1.0, total[window[0] if window.size else -1]))


def split_rhat(values: Array) -> Array:
    """R-hat (m,) of (ensembles, steps, walkers, m): each half of each ensemble is a chain (Gelman et al. 2013)."""
    half = values.shape[1] // 2
    parts = np.concatenate([values[:, :half], values[:, half : 2 * half]])
    parts = parts.reshape(len(parts), -1, values.shape[-1])
    within = parts.var(axis=1, ddof=1).mean(axis=0)
    between = parts.mean(axis=1).var(axis=0, ddof=1)
    return np.asarray(np.sqrt(1.0 + between / np.where(within > 0.0, within, 1.0)))


def log_evidence(density: LogDensity, draws: Array, seed: int, count: int = 4000) -> tuple[float, float]:
    """Log of the density's integral and its standard error, by importance sampling around draws from it.

    Points come from a multivariate t of five degrees of freedom with the draws' mean and covariance: its tails are
    wider than the density's. An infinite error says that too few of them met it.
    """
    from scipy.special import gammaln

    random, (_, m), dof = np.random.default_rng(seed), draws.shape, 5.0
    mean, factor = draws.mean(axis=0), np.linalg.cholesky(np.cov(draws.T).reshape(m, m) + 1e-300 * np.eye(m))
    normal = random.standard_normal((count, m))
    chi = random.chisquare(dof, count)
    u = normal * np.sqrt(dof / chi)[:, None]
    log_t = (
        gammaln(0.5 * (dof + m)) - gammaln(0.5 * dof) - 0.5 * m * np.log(dof * np.pi)
        - np.log(np.diag(factor)).sum() - 0.5 * (dof + m) * np.log1p((u**2).sum(axis=1) / dof)
    )  # fmt: skip
    log_weight = density(mean + u @ factor.T) - log_t
    good: NDArray[np.bool_] = np.isfinite(log_weight)
    if not good.any():
        return -np.inf, np.inf
    top = float(log_weight[good].max())
    weight = np.where(good, np.exp(np.where(good, log_weight - top, -np.inf)), 0.0)
    average = float(weight.mean())
    return top + float(np.log(average)), float(weight.std() / average / np.sqrt(count))
