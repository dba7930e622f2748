"""How well parameters are known: covariance, correlations, confounded groups, profile likelihood."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.sparse.csgraph import connected_components

from ..api import Array
from . import units
from .cases import Case
from .noise import Scatter, directions, scatter_of
from .problem import Evaluation, Problem
from .variables import Free, Variables

AT_BOUND = 1e-4  # of the range between bounds: how near counts as at the bound
NEAR_BOUND = 1e-2  # of the start's distance from the bound
POORLY = 0.5  # relative standard error above which a parameter is called not identifiable
EXPLAINED = 0.98  # share of the variance below which a fit whose residuals are no noise is not to be trusted
SYSTEMATIC = 3.0  # samples that count as one, from which residuals are no noise
INSEPARABLE = 0.995  # correlation from which two parameters count as one
ALIKE = 0.95  # correlation worth a warning
CARRIED = 0.5  # correlation with a parameter that may be nearly anything from which another is not known either
FEWEST = 3.0  # independent samples beyond the parameters that are taken to be there: Student's reach is 3.2 then
CONFIDENCE = 3.841  # 95 % of chi-squared with one degree of freedom
_SINGULAR = 1e-13  # relative eigenvalue below which a direction carries no information


@dataclass(frozen=True)
class Estimate:
    """One identified parameter, SI. ``interval`` is 95 %; ``at`` is 'lower' or 'upper' where it sits on a bound.

    ``standard_error`` is nan at a bound and inf where the data say nothing. ``profile`` (k, 2) holds values and
    rises of the likelihood's chi-squared, None where it was not asked for; ``profile_interval`` ends where that rise
    reaches 3.84, infinite on a side where it does not within the bounds.
    """

    free: Free
    unit: str
    value: float
    standard_error: float
    interval: tuple[float, float]
    identifiable: bool
    at: str = ""
    profile: Array | None = None
    profile_interval: tuple[float, float] | None = None


@dataclass(frozen=True)
class Uncertainty:
    """Covariance (m, m) in the optimiser's coordinates, correlations (m, m), and warnings in plain words.

    ``noise`` gives each compared curve's residual standard deviation [SI of its channel] and ``persistence`` by how
    much its noise remembers, as a number of samples that count as one (1: white noise). ``freedom`` counts the
    independent samples beyond the parameters.
    """

    covariance: Array
    correlation: Array
    noise: tuple[float, ...]
    persistence: tuple[float, ...]
    on_bound: tuple[str, ...]
    warnings: tuple[str, ...]
    freedom: float = np.inf

    @property
    def reach(self) -> float:
        """Standard errors to either side that hold 95 %: Student's, as the noise is known from the residual alone."""
        return float(stats.t.ppf(0.975, self.freedom))


def uncertainty(problem: Problem, optimum: Evaluation) -> Uncertainty:
    """Errors by the curvature at the optimum.

    The covariance is the sandwich H^-1 M H^-1 with H = J^T J and M = sum over curves of J^T W^1/2 V W^1/2 J, where V is
    the covariance of each curve's own noise, white or remembered (noise.py). It is right for any weights. A parameter
    on a bound has no error of its own, but widens the others' as if it were free: noise put it there, and the others
    followed it.
    """
    assert optimum.jacobian is not None
    variables = problem.variables
    sides = on_bounds(variables, optimum.z)
    inner = np.flatnonzero(sides == 0)
    jacobian = optimum.jacobian
    noise, persistence = [], []
    samples, middle = 0.0, np.zeros((jacobian.shape[1], jacobian.shape[1]))
    for number, channel, where in problem.groups():
        one = _curve_noise(problem.cases[number], channel, optimum.residual[where], jacobian[where][:, inner])
        case = problem.cases[number]
        weight = case.weight[channel] / case.scale[channel]
        used = weight > 0.0
        rows = jacobian[where][used] * weight[used, None]
        middle += one.scatter.covariance(rows)
        noise.append(one.deviation)
        persistence.append(one.persistence)
        samples += used.sum() / one.persistence - (channel in case.floating)
    covariance, blind = _sandwich(jacobian, middle)
    blind = np.intersect1d(blind, inner)
    covariance[sides != 0, :] = covariance[:, sides != 0] = np.nan
    deviation = np.sqrt(np.diag(covariance))
    with np.errstate(invalid="ignore"):
        correlation = np.clip(covariance / np.outer(deviation, deviation), -1.0, 1.0)
    names = [variables.symbols[k] for k in inner]
    on_bound = tuple("" if s == 0 else "lower" if s < 0 else "upper" for s in sides)
    warnings = _at_bounds(variables, optimum.z, on_bound)
    warnings += [f"the data say nothing about {listed([variables.symbols[k] for k in blind])}"] if len(blind) else []
    warnings += _pairs(names, correlation[np.ix_(inner, inner)])
    warnings += _curves(problem, persistence)
    freedom = max(samples - len(inner), FEWEST)
    return Uncertainty(covariance, correlation, tuple(noise), tuple(persistence), on_bound, tuple(warnings), freedom)


@dataclass(frozen=True)
class _CurveNoise:
    scatter: Scatter
    deviation: float
    persistence: float


def _curve_noise(case: Case, channel: str, residual: Array, jacobian: Array) -> _CurveNoise:
    """The noise of one curve, from its weighted residual (n,) and Jacobian (n, m).

    Slow noise is larger than its share in the residual: its persistence is the square of the factor on the residual's
    deviation that scatters the parameters as the noise does.
    """
    weight = case.weight[channel] / case.scale[channel]
    used = weight > 0.0
    if not used.any():
        return _CurveNoise(Scatter(case.experiment.time[used], 0.0), 0.0, 1.0)
    plain, slopes = residual[used] / weight[used], jacobian[used] / weight[used, None]
    if channel in case.floating:
        slopes = np.column_stack([slopes, np.ones(len(slopes))])
    scatter = scatter_of(plain, slopes, case.experiment.time[used])
    freedom = max(plain.size - slopes.shape[1], 1)
    deviation = float(np.sqrt(plain @ plain / freedom))
    if scatter.share == 0.0:
        return _CurveNoise(scatter, deviation, 1.0)
    wide = scatter.widening(directions(jacobian[used] * weight[used, None]))
    ratio = (scatter.deviation / deviation) ** 2 if deviation > 0.0 else 1.0
    return _CurveNoise(scatter, deviation, max(1.0, wide * ratio))


def _at_bounds(variables: Variables, z: Array, sides: Sequence[str]) -> list[str]:
    values = variables.values(z)
    return [
        f"{free.symbol} ended on its {side} bound, "
        f"{units.show(values[free.symbol], variables.info[free.symbol].unit)}: "
        "the data want it beyond, or do not feel it"
        for free, side in zip(variables.free, sides, strict=True)
        if side
    ]


def on_bounds(variables: Variables, z: Array) -> NDArray[np.int_]:
    """-1 for each coordinate of z (m,) that is on its lower bound, 1 on its upper one, else 0.

    How near counts as on it: a share of the range, but where the range is many times the start's own distance from the
    bound, a share of that. A modulus of kilopascals is not on a bound of zero because it might have been gigapascals.
    """
    lower, upper = variables.bounds
    wide = AT_BOUND * (upper - lower)
    below, above = variables.start - lower, upper - variables.start
    low = np.where(below > 0.0, np.minimum(wide, NEAR_BOUND * below), wide)
    high = np.where(above > 0.0, np.minimum(wide, NEAR_BOUND * above), wide)
    return np.where(z <= lower + low, -1, np.where(z >= upper - high, 1, 0))


def _sandwich(jacobian: Array, middle: Array) -> tuple[Array, NDArray[np.intp]]:
    """H^-1 M H^-1, and the columns that touch directions without information (infinite variance there)."""
    size = np.linalg.norm(jacobian, axis=0)
    unfelt = size <= 1e-12 * size.max(initial=0.0)
    size = np.where(unfelt, 1.0, size)
    scaled = jacobian / size
    values, vectors = np.linalg.eigh(scaled.T @ scaled)
    known = values > _SINGULAR * values.max(initial=1.0)
    inverse = (vectors[:, known] / values[known]) @ vectors[:, known].T
    covariance = inverse @ (middle / np.outer(size, size)) @ inverse / np.outer(size, size)
    blind = np.flatnonzero(unfelt | (np.abs(vectors[:, ~known]) > 0.1).any(axis=1))
    covariance[blind, blind] = np.inf
    return covariance, blind


def samples_as_one(residual: Array) -> float:
    """Integrated autocorrelation time in samples, at least 1: the window ends where it is five times the sum."""
    n = residual.size
    power = float(residual @ residual)
    if n < 20 or power == 0.0:
        return 1.0
    spectrum = np.abs(np.fft.rfft(residual - residual.mean(), 2 * n)) ** 2
    correlation = np.fft.irfft(spectrum)[: n // 2]
    if correlation[0] <= 0.0 or correlation[1] / correlation[0] < 3.0 / np.sqrt(n):
        return 1.0  # white, as far as n samples can tell
    total = 2.0 * np.cumsum(correlation / correlation[0]) - 1.0
    window = np.flatnonzero(np.arange(total.size) >= 5.0 * total)
    return float(max(1.0, total[window[0] if window.size else -1]))


def _pairs(names: Sequence[str], correlation: Array) -> list[str]:
    """One sentence for each set of parameters that count as one, and one for all weaker pairs."""
    strong = np.abs(correlation) >= INSEPARABLE
    count, group = connected_components(strong, directed=False)
    found = []
    for k in range(count):
        members = np.flatnonzero(group == k)
        if members.size > 1:
            block = np.abs(correlation[np.ix_(members, members)])
            worst = float(block[~np.eye(members.size, dtype=bool)].max())
            together = listed([names[int(j)] for j in members])
            found.append(
                f"{together} cannot be told apart (correlation up to {worst:.4f}): they can "
                "change together and the curves stay. Hold one, or measure something that separates them"
            )
    weak = [
        f"{names[j]} and {names[i]} ({correlation[i, j]:+.2f})"
        for i in range(len(names))
        for j in range(i)
        if abs(correlation[i, j]) >= ALIKE and group[i] != group[j]
    ]
    return found + ([f"hard to tell apart (correlation): {'; '.join(weak)}"] if weak else [])


def vaf(residual: Array, data: Array) -> float:
    """Variance accounted for as paper M counts it: 1 - sum of squared residuals over sum of squared data.

    nan for a curve that is zero or has no weight."""
    size = float(data @ data)
    return 1.0 - float(residual @ residual) / size if size > 0.0 else float("nan")


def misfit(known: Uncertainty, explained: float) -> str:
    """In plain words, why the parameters of a fit say little of the tissue; '' where the model describes the data.

    ``explained`` is the share of the variance that the fit accounts for. A residual that is no noise shifts every
    parameter by an amount that no standard error shows; a small one shifts them little.
    """
    if explained >= EXPLAINED or max(known.persistence, default=1.0) < SYSTEMATIC:
        return ""
    return f"the model leaves {100 * (1 - explained):.1f} % of the variance, and that is no noise"


def listed(names: Sequence[str]) -> str:
    """The names with commas and an "and"."""
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))


def _curves(problem: Problem, persistence: Sequence[float]) -> list[str]:
    rough = [
        f"{problem.cases[number].label} {channel}"
        for (number, channel, _), together in zip(problem.groups(), persistence, strict=True)
        if together >= SYSTEMATIC
    ]
    if not rough:
        return []
    return [
        f"the misfit of {', '.join(rough)} is systematic, not noise: the model lacks something there. Standard errors "
        "are widened for it, but say nothing of the error this makes in the parameters"
    ]


def hardly_known(problem: Problem, optimum: Evaluation, known: Uncertainty) -> NDArray[np.intp]:
    """Indices of the parameters whose standard error is more than half of their size, in the coordinate of the fit."""
    values = problem.variables.values(optimum.z)
    sizes = [abs(values[f.symbol]) / max(abs(f.slope(values[f.symbol])), 1e-300) for f in problem.variables.free]
    deviations = np.sqrt(np.diag(known.covariance))
    return np.flatnonzero(np.nan_to_num(deviations, nan=0.0) > POORLY * np.array(sizes))


def estimates(problem: Problem, optimum: Evaluation, known: Uncertainty) -> list[Estimate]:
    """Every free parameter with its standard error and verdict."""
    values = problem.variables.values(optimum.z)
    alike = np.nan_to_num(np.abs(known.correlation))
    np.fill_diagonal(alike, 0.0)
    together = np.any(alike >= INSEPARABLE, axis=1)
    # Standard errors are those of a straight ridge. Where it is long, parameters that bend with it are known less well.
    long = np.intersect1d(np.flatnonzero(together), hardly_known(problem, optimum, known))
    carried = np.any(alike[:, long] >= CARRIED, axis=1)
    found = []
    for k, free in enumerate(problem.variables.free):
        value, deviation = values[free.symbol], float(np.sqrt(known.covariance[k, k]))
        error = deviation * free.slope(value)
        if free.log and np.isfinite(deviation):
            spread = np.exp(min(known.reach * deviation, 300.0))
            interval = (value / spread, value * spread)
        else:
            interval = (value - known.reach * error, value + known.reach * error)
        interval = (max(interval[0], free.lower), min(interval[1], free.upper))
        relative = error / max(abs(value), 1e-300)
        identifiable = not known.on_bound[k] and not together[k] and not carried[k] and bool(relative <= POORLY)
        unit = problem.variables.info[free.symbol].unit
        found.append(Estimate(free, unit, value, error, interval, identifiable, known.on_bound[k]))
    return found


def doubts(found: Sequence[Estimate]) -> list[str]:
    """In plain words, the parameters whose value is little more than a guess."""
    poor = [e for e in found if not e.at and np.isfinite(e.standard_error) and e.standard_error > POORLY * abs(e.value)]
    errors = [100 * e.standard_error / max(abs(e.value), 1e-300) for e in poor]
    words = [
        f"{e.free.symbol} ({f'±{x:.0f}' if x < 1000 else 'over ±1000'} %)" for e, x in zip(poor, errors, strict=True)
    ]
    return [f"too uncertain to be called identified: {', '.join(words)}"] if words else []
