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
SETTLE = 250  # steps between two fits of the mixture
MOST = 8000  # steps of each ensemble
PARTS = 24  # of the mixture that proposals are drawn from
ROUNDS = 25  # of fitting it
LEAST = 1e-2  # of the starts' covariance, which each part has beside its own
TAILS = 5.0  # degrees of freedom of its parts
TRIES = 12  # points of it from which a walker chooses
ADAPTED = 3  # times that the mixture is fitted anew to where walkers went, before the first draw that counts


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
    proposes points of a mixture fitted to them, and to where the walkers went before draws count. Raises ImportError
    naming the package that is missing; ValueError for too few starts.
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
    state = starts[np.concatenate([random.choice(count, walkers, replace=False) for _ in range(ensembles)])]
    settled = min(SETTLE, most // 4)
    for _ in range(ADAPTED):
        sampler = _sampler(emcee, density, starts, ensembles, state, random)
        state = sampler.run_mcmc(state, settled, skip_initial_state_check=True).coords
        late = sampler.get_chain()[settled // 2 :].reshape(-1, m)
        starts = late[random.choice(len(late), min(keep, len(late)), replace=False)]
    sampler = _sampler(emcee, density, starts, ensembles, state, random)
    chain: Chain | None = None
    done = 0
    while done < most and (chain is None or not chain.converged):
        steps = min(CHUNK, most - done)
        state = sampler.run_mcmc(state, steps, skip_initial_state_check=True)
        done += steps
        chain = _chain(sampler, ensembles, keep, random)
    assert chain is not None
    return chain


def _sampler(
    emcee: Any, density: LogDensity, starts: Array, ensembles: int, state: Array, random: np.random.Generator
) -> Any:
    """One whose far proposals lie as the starts do."""
    moves = [(_differences(emcee, ensembles), 0.5), (_chosen(emcee, _Jumps(starts, random)), 0.5)]
    sampler = emcee.EnsembleSampler(*state.shape, density, moves=moves, vectorize=True)
    sampler._random.seed(int(random.integers(1 << 31)))  # the sampler has no public way to be repeatable
    return sampler


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


def _chosen(emcee: Any, jumps: _Jumps) -> Any:
    """Each walker goes to one of `TRIES` draws from the mixture or stays, by the weights density over mixture.

    Iterated sampling importance resampling (Andrieu, Lee and Vihola, Bernoulli 24, 2018) keeps the density exactly. A
    density costs a tenth for each of many points at once, so that many tries are better than many steps.
    """

    class Chosen(emcee.moves.Move):  # type: ignore[misc]
        def propose(self, model: Any, state: Any) -> tuple[Any, NDArray[np.bool_]]:
            count, m = state.coords.shape
            there = jumps.draw(count * TRIES, model.random).reshape(count, -1, m)
            points = np.concatenate([state.coords[:, None], there], axis=1)
            tried, _ = model.compute_log_prob_fn(points[:, 1:].reshape(-1, m))
            density = np.concatenate([state.log_prob[:, None], tried.reshape(count, -1)], axis=1)
            weight = density - jumps.log_density(points.reshape(-1, m)).reshape(count, -1)
            chosen = np.argmax(weight + model.random.gumbel(size=weight.shape), axis=1)  # by softmax of the weights
            own = np.arange(count)
            new = emcee.State(points[own, chosen], log_prob=density[own, chosen], random_state=state.random_state)
            return new, chosen > 0

    return Chosen()


class _Jumps:
    """Points that do not depend on where a walker stands: draws from a mixture of Student's t about the starts.

    Where a posterior is long and bent they carry a walker across at once, if the starts lie as the posterior does. The
    mixture is a normal one by expectation maximisation (Dempster, Laird and Rubin 1977), its parts each with a
    covariance of its own, with heavy tails.
    """

    def __init__(self, starts: Array, random: np.random.Generator) -> None:
        count, m = starts.shape
        parts = max(1, min(PARTS, count // (4 * (m + 1))))
        whole = np.cov(starts.T).reshape(m, m) + 1e-12 * np.diag(np.ptp(starts, axis=0) ** 2 + 1e-300)
        self.weights = np.full(parts, 1.0 / parts)
        self.centres = starts[random.choice(count, parts, replace=False)]
        self._shape(np.broadcast_to(whole * parts ** (-2.0 / m), (parts, m, m)))
        for _ in range(ROUNDS):
            share = self._log_parts(starts, -1.0)
            share = np.exp(share - share.max(axis=1, keepdims=True))
            share /= share.sum(axis=1, keepdims=True)
            size = share.sum(axis=0) + 1e-9
            self.weights = size / size.sum()
            self.centres = share.T @ starts / size[:, None]
            off = starts[:, None, :] - self.centres
            own = np.einsum("bk,bki,bkj->kij", share, off, off, optimize=True)
            self._shape((own + LEAST * m * whole) / (size[:, None, None] + m))

    def _shape(self, covariances: Array) -> None:
        self.shapes = np.linalg.cholesky(covariances)
        self.inverses = np.linalg.inv(self.shapes)
        self._units = np.einsum("kij,kj->ki", self.inverses, self.centres)
        self.log_size = np.log(np.diagonal(self.shapes, axis1=1, axis2=2)).sum(axis=1)

    def draw(self, count: int, random: np.random.RandomState) -> Array:
        """(count, m)"""
        part = random.choice(len(self.weights), size=count, p=self.weights)
        tail = np.sqrt(TAILS / random.chisquare(TAILS, count))
        steps = random.standard_normal((count, self.centres.shape[1])) * tail[:, None]
        return np.asarray(self.centres[part] + np.einsum("bij,bj->bi", self.shapes[part], steps))

    def log_density(self, z: Array) -> Array:
        """(b,) of the mixture of Student's t, up to a constant."""
        logs = self._log_parts(z, TAILS)
        top = logs.max(axis=1)
        return np.asarray(top + np.log(np.exp(logs - top[:, None]).sum(axis=1)))

    def _log_parts(self, z: Array, tails: float) -> Array:
        """(b, parts): log density of each part times its weight, normal without ``tails``."""
        parts, m = self.centres.shape
        off = (z @ self.inverses.reshape(parts * m, m).T).reshape(-1, parts, m) - self._units
        square = (off**2).sum(axis=2)
        kernel = -0.5 * square if tails < 0.0 else -0.5 * (tails + m) * np.log1p(square / tails)
        return np.asarray(np.log(self.weights + 1e-300) - self.log_size + kernel)


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
