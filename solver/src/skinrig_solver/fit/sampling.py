"""Random draws from a density, and whether there are enough of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..api import Array

LogDensity = Callable[[Array], Array]  # (b,) at points (b, m)
ENSEMBLES = 4  # independent ones, for R-hat
RHAT = 1.01  # Vehtari et al. (Bayesian Analysis 16, 2021)
LENGTHS = 50.0  # autocorrelation times that a chain must last (emcee's own advice)
CHUNK = 500
MOST = 8000  # steps of each ensemble
KERNELS = 200  # of a density that proposals are drawn from
TAILS = 5.0  # degrees of freedom of its kernels


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

    ``starts`` (count, m) are points of positive density; walkers begin at different ones of them, and every other step
    proposes a point near any of them. Raises ImportError naming the package that is missing; ValueError for too few
    starts.
    """
    try:
        import emcee
    except ImportError as error:
        raise ImportError("posteriors need emcee: pip install 'skinrig-solver[posterior]'") from error
    count, m = starts.shape
    walkers = max(2 * m + 2, 16)
    if count < walkers:
        raise ValueError(f"{walkers} walkers need as many starts, there are {count}")
    random = np.random.default_rng(seed)
    moves = [(_differences(emcee, ensembles), 0.5), (emcee.moves.MHMove(_Jumps(starts)), 0.5)]
    sampler = emcee.EnsembleSampler(ensembles * walkers, m, density, moves=moves, vectorize=True)
    sampler._random.seed(seed)  # the sampler has no public way to be repeatable
    begin = np.concatenate([random.choice(count, walkers, replace=False) for _ in range(ensembles)])
    state = emcee.State(starts[begin])
    chain: Chain | None = None
    done = 0
    while done < most and (chain is None or not chain.converged):
        steps = min(CHUNK, most - done)
        state = sampler.run_mcmc(state, steps, skip_initial_state_check=True)
        done += steps
        chain = _chain(sampler, ensembles, keep, random)
    assert chain is not None
    return chain


def _differences(emcee: Any, ensembles: int) -> Any:
    """Differential evolution (ter Braak 2006) in several ensembles that share one call of the density but no walker.

    emcee moves walkers of even and of odd number in turn; those of one ensemble stand together.
    """

    class Differences(emcee.moves.RedBlueMove):  # type: ignore[misc]
        def __init__(self) -> None:
            super().__init__(nsplits=2, randomize_split=False)

        def get_proposal(self, moved: Array, others: list[Array], random: Any) -> tuple[Array, Array]:
            here = moved.reshape(ensembles, -1, moved.shape[-1])
            pool = others[0].reshape(here.shape)
            half, m = here.shape[1:]
            one = random.randint(half, size=(ensembles, half))
            two = (one + random.randint(1, half, size=one.shape)) % half
            own = np.arange(ensembles)[:, None]
            length = 2.38 / np.sqrt(2.0 * m) * (1.0 + 0.2 * random.standard_normal((ensembles, half, 1)))
            there = here + length * (pool[own, one] - pool[own, two])
            return there.reshape(moved.shape), np.zeros(len(moved))

    return Differences()


class _Jumps:
    """Proposals that do not depend on where a walker stands: draws from a kernel density of the starts.

    Where a posterior is long and bent they carry a walker across at once, if the starts lie as the posterior does; the
    rule of Metropolis and Hastings makes the draws right wherever they lie. Silverman's width, heavy tails.
    """

    def __init__(self, starts: Array) -> None:
        count, m = starts.shape
        width = (4.0 / (m + 2.0) / count) ** (1.0 / (m + 4.0))
        covariance = np.cov(starts.T).reshape(m, m) + 1e-12 * np.diag(np.ptp(starts, axis=0) ** 2 + 1e-300)
        self.shape = width * np.linalg.cholesky(covariance)
        self.starts = starts[np.linspace(0, count - 1, min(count, KERNELS)).astype(int)]
        self.inverse = np.linalg.inv(self.shape).T
        self.units = self.starts @ self.inverse

    def __call__(self, here: Array, random: np.random.RandomState) -> tuple[Array, Array]:
        """New points (b, m), and the log of the proposals' density at the old ones over that at the new."""
        count, m = here.shape
        chosen = self.starts[random.randint(len(self.starts), size=count)]
        tail = np.sqrt(TAILS / random.chisquare(TAILS, count))
        there = chosen + (random.standard_normal((count, m)) * tail[:, None]) @ self.shape.T
        density = self._log_density(np.concatenate([here, there]))
        return there, density[:count] - density[count:]

    def _log_density(self, z: Array) -> Array:
        """(b,) of Student's t kernels, up to a constant."""
        off = ((z @ self.inverse)[:, None, :] - self.units) ** 2
        log_kernel = -0.5 * (TAILS + z.shape[1]) * np.log1p(off.sum(axis=2) / TAILS)
        top = log_kernel.max(axis=1)
        return np.asarray(top + np.log(np.exp(log_kernel - top[:, None]).sum(axis=1)))


def _chain(sampler: Any, ensembles: int, keep: int, random: np.random.Generator) -> Chain:
    run = sampler.get_chain()
    steps, every, m = run.shape
    first = steps // 4  # the way in from the starts
    late = np.moveaxis(run[first:].reshape(steps - first, ensembles, -1, m), 1, 0)
    times = [autocorrelation_time(late[..., k]) for k in range(m)]
    flat, density = run[first:].reshape(-1, m), sampler.get_log_prob()[first:].ravel()
    chosen = np.sort(random.choice(len(flat), min(keep, len(flat)), replace=False))
    accepted = float(sampler.acceptance_fraction.mean())
    walkers = every // ensembles
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
