"""The density that a posterior is: likelihood of the curves times priors, by full solves or by their emulator."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import stats

from ..api import Array, Model
from ..emulator import Emulator, Solve
from .cases import Case
from .features import exchanges, relaxes_wholly, series
from .priors import log_prior
from .problem import Problem, simulate
from .statistics import Uncertainty
from .variables import Variables

NEARLY_ALL = 0.9999  # of a normal density's mass: so far an emulator's region reaches
MATTERS = 0.999  # of it: a point beyond the region that would lie within so much is run in full
FULL_RUNS = 8  # of points beyond the region, in one chain; the others have no density then
STEP = 1e-4  # of a coordinate, in differences of the log prior


@dataclass(frozen=True)
class Noise:
    """Of each compared curve: residual standard deviation [SI of its channel] and samples that count as one."""

    deviation: tuple[float, ...]
    persistence: tuple[float, ...]

    @staticmethod
    def of(known: Uncertainty) -> Noise:
        return Noise(known.noise, known.persistence)


@dataclass
class Target:
    """The log posterior over the fit's coordinates z (m,).

    Curves are model minus data over each curve's own noise (n,). A sample counts as the inverse of its curve's
    persistence, and not at all where the fit gave it no weight; other weights steer the fit, not the posterior. Noise
    is taken from the fit's residuals, as known.
    """

    problem: Problem
    noise: Noise
    executor: Executor | None = None
    full_solves: int = 0
    failed_solves: int = 0
    beyond: int = 0  # points outside the emulator's region that were run in full
    dropped: int = 0  # of them, those that had to go without: the chain is cut there
    mattered: int = 0  # of those run in full, those that turned out to be worth a draw
    evaluations: int = 0
    solves: list[Solve] = field(default_factory=list)

    def __post_init__(self) -> None:
        groups = self.problem.groups()
        self._series = series(self.variables)
        self._exchanges = exchanges(self.variables)
        self._orders = float(np.sum([np.log(e.orders) for e in self._exchanges]))
        self._floating: list[slice] = []
        self._scale, self.share = np.empty(self.problem.size), np.empty(self.problem.size)
        for (number, channel, where), sd, together in zip(
            groups, self.noise.deviation, self.noise.persistence, strict=True
        ):
            self._scale[where] = sd
            case = self.problem.cases[number]
            self.share[where] = (case.weight[channel] > 0.0) / together
            if channel in case.floating and self.share[where].any():
                self._floating.append(where)
        self._data = np.concatenate([case.data[k] for case in self.problem.cases for k in case.data])
        # of a Gaussian with known deviations, each sample to the power of its share
        self.constant = -0.5 * float((self.share * np.log(2.0 * np.pi * self._scale**2)).sum())

    @property
    def variables(self) -> Variables:
        return self.problem.variables

    def begin_chain(self) -> None:
        """Count anew what lies beyond the emulator's region."""
        self.beyond = self.dropped = self.mattered = self.evaluations = 0

    @property
    def lost(self) -> float:
        """Share of the evaluations that had to go without a density and would have had one worth a draw."""
        return self.dropped * self.mattered / max(self.beyond - self.dropped, 1) / max(self.evaluations, 1)

    def solve(self, points: Array) -> list[Solve | None]:
        """Full solves at points (b, m), side by side on the executor, kept for training; None where one failed."""
        jobs = [(self.problem.model, self.problem.cases, self.variables, z) for z in points]
        if self.executor is None:
            raw = [full_solve(*job) for job in jobs]
        else:
            raw = [future.result() for future in [self.executor.submit(full_solve, *job) for job in jobs]]
        found: list[Solve | None] = []
        for z, result in zip(points, raw, strict=True):
            self.full_solves += 1
            if result is None:
                self.failed_solves += 1
                found.append(None)
                continue
            curve, slopes = result
            off, slopes = (curve - self._data) / self._scale, slopes / self._scale[:, None]
            found.append(Solve(z, self._levelled(off), self._levelled(slopes)))
        self.solves += [s for s in found if s is not None]
        return found

    def _levelled(self, rows: Array) -> Array:
        """Rows (n,) or (n, m) with each zero that is not known where it fits best: integrated over, as it is linear."""
        found = rows.copy()
        for where in self._floating:
            share = self.share[where]
            found[where] -= share @ rows[where] / share.sum()
        return found

    def log_prior(self, z: Array) -> Array:
        """(b,) at points (b, m); minus infinity where Prony terms leave no stress.

        Of terms that may change places one order has all the density, so that it adds up to one as before.
        """
        total = np.sum([log_prior(free, z[:, k]) for k, free in enumerate(self.variables.free)], axis=0)
        forbidden = relaxes_wholly(self._series, z)
        for exchange in self._exchanges:
            forbidden |= ~exchange.in_order(z)
        return np.where(forbidden, -np.inf, total + self._orders)

    def in_order(self, z: Array) -> Array:
        """The same points (b, m), with Prony terms that may change places in order of their time constants."""
        for exchange in self._exchanges:
            z = exchange.sorted(z)
        return z

    def log_likelihood(self, curves: Array) -> Array:
        """(b,) of curves (b, n)."""
        return np.asarray(self.constant - 0.5 * (curves**2 @ self.share))

    def prior_slope(self, z: Array) -> Array:
        """(m,): the log prior's derivative at z (m,), zero at a bound."""
        return self._prior_differences(z)[0]

    def prior_curvature(self, z: Array) -> Array:
        """(m,): minus the second derivative of the log prior at z (m,), zero where it is flat or hollow."""
        return self._prior_differences(z)[1].clip(0.0)

    def _prior_differences(self, z: Array) -> tuple[Array, Array]:
        slope, curvature = np.zeros(z.size), np.zeros(z.size)
        for k, free in enumerate(self.variables.free):
            step = STEP * max(abs(free.coordinate(free.upper) - free.coordinate(free.lower)), 1e-12)
            values = log_prior(free, z[k] + step * np.array([-1.0, 0.0, 1.0]))
            if np.all(np.isfinite(values)):
                slope[k] = 0.5 * (values[2] - values[0]) / step
                curvature[k] = -(values[0] - 2.0 * values[1] + values[2]) / step**2
        return slope, curvature


class Emulated:
    """The log posterior by an emulator; ``strict`` gives no density outside its region, else full solves do."""

    def __init__(self, target: Target, emulator: Emulator, strict: bool) -> None:
        self.target, self.emulator, self.strict = target, emulator, strict
        weighted = emulator.modes * target.share[:, None]
        self._square = emulator.modes.T @ weighted
        self._linear = weighted.T @ emulator.mean
        self._rest = float(emulator.mean**2 @ target.share)
        self._best = -np.inf

    def log_likelihood(self, z: Array) -> Array:
        """(b,) by the emulator, wherever the points (b, m) lie."""
        c = self.emulator.coefficients(z)
        chi = ((c @ self._square + 2.0 * self._linear) * c).sum(axis=1) + self._rest
        return np.asarray(self.target.constant - 0.5 * chi)

    def with_gradient(self, z: Array) -> tuple[float, Array]:
        """The emulated log likelihood at z (m,) and its derivative (m,)."""
        c = self.emulator.coefficients(z[None])[0]
        pull = self._square @ c
        value = self.target.constant - 0.5 * float(c @ pull + 2.0 * c @ self._linear + self._rest)
        return value, np.asarray(-(pull + self._linear) @ self.emulator.slopes(z))

    def information(self, z: Array) -> Array:
        """(m, m): Fisher's information of the curves at z (m,)."""
        slopes = self.emulator.slopes(z)
        return np.asarray(slopes.T @ self._square @ slopes)

    def __call__(self, z: Array) -> Array:
        """Log posterior (b,) at points (b, m)."""
        target = self.target
        target.evaluations += len(z)
        total = target.log_prior(z)
        possible = np.isfinite(total)
        inside = possible & self.emulator.inside(z)
        outside = np.flatnonzero(possible & ~inside)
        if inside.any():
            total[inside] += self.log_likelihood(z[inside])
            self._best = max(self._best, float(total[inside].max()))
        if self.strict:
            total[outside] = -np.inf
        elif outside.size:
            total[outside] = self._in_full(z[outside], total[outside])
        return np.asarray(total)

    def _in_full(self, z: Array, prior: Array) -> Array:
        """Points that even the extrapolated emulator does not rule out are run in full."""
        guess = prior + self.log_likelihood(z)
        least = self._best - 0.5 * reach(z.shape[1], MATTERS) ** 2
        near = np.flatnonzero(guess > least)
        found = np.full(len(z), -np.inf)
        self.target.beyond += near.size
        allowed = max(0, FULL_RUNS - (self.target.beyond - near.size))
        self.target.dropped += max(0, near.size - allowed)
        near = near[:allowed]
        for k, solve in zip(near, self.target.solve(z[near]), strict=True):
            if solve is not None:
                found[k] = prior[k] + self.target.log_likelihood(solve.curve[None])[0]
        self.target.mattered += int(np.count_nonzero(found > least))
        return found


def reach(m: int, mass: float = NEARLY_ALL) -> float:
    """How many standard deviations hold so much of a normal density of m parameters."""
    return float(np.sqrt(stats.chi2.ppf(mass, m)))


def full_solve(model: str | Model, cases: Sequence[Case], variables: Variables, z: Array) -> tuple[Array, Array] | None:
    """Curves (n,) in SI and their derivatives (n, m) by the coordinates, of all cases; None where a run failed."""
    values = variables.values(z)
    chain = variables.chain(values)
    curves, slopes = [], []
    for case in cases:
        result = simulate(model, replace(case.experiment, snapshots=()), case.values(values), variables.wanted)
        if isinstance(result, str):
            return None
        assert result.sensitivities is not None
        for channel in case.data:
            curves.append(result.channels[channel])
            slopes.append(result.sensitivities[channel] @ chain)
    return np.concatenate(curves), np.concatenate(slopes)
