"""Curves of several repeats or persons together: mean with its 95 % band, and whether groups differ (paper F)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from acquire.recording.model import FloatArray

_ROUNDING = 1e-12  # by how much of themselves numbers differ that only rounding parts


@dataclass(frozen=True)
class MeanCurve:
    """Mean (n,) of ``count`` curves over ``time`` (n,) s, and the half-width (n,) of its 95 % confidence interval."""

    time: FloatArray
    mean: FloatArray
    half_width: FloatArray
    count: int


@dataclass(frozen=True)
class Spread:
    """Mean of ``count`` repeats of a number, half-width of its 95 % confidence interval, standard deviation / mean."""

    mean: float
    half_width: float
    relative: float
    count: int


@dataclass(frozen=True)
class Anova:
    """One-way analysis of variance: ``f`` with ``between`` and ``within`` degrees of freedom, and its ``p``."""

    f: float
    p: float
    between: int
    within: int


def mean_curve(curves: Sequence[tuple[FloatArray, FloatArray]], samples: int = 500) -> MeanCurve:
    """Mean of curves (time, value) whose times count from a common moment, over the time that all of them cover.

    The half-width is Student's t at 97.5 % times the standard error; NaN for one curve. Raises ValueError without any,
    or if they have no time in common.
    """
    from scipy.stats import t as student

    if not curves:
        raise ValueError("no curves to average")
    first, last = max(float(time[0]) for time, _ in curves), min(float(time[-1]) for time, _ in curves)
    if first >= last:
        raise ValueError("the curves have no time in common")
    grid = np.linspace(first, last, samples)
    values = np.stack([np.interp(grid, time, value) for time, value in curves])
    count = len(curves)
    if count < 2:
        return MeanCurve(grid, values[0], np.full(samples, np.nan), 1)
    error = values.std(axis=0, ddof=1) / np.sqrt(count)
    return MeanCurve(grid, values.mean(axis=0), student.ppf(0.975, count - 1) * error, count)


def spread(values: Sequence[float]) -> Spread:
    """`Spread` of the finite ``values``. Raises ValueError unless there are two of them."""
    from scipy.stats import t as student

    finite = np.array([value for value in values if np.isfinite(value)], float)
    count = len(finite)
    if count < 2:
        raise ValueError(f"a spread needs at least two repeats, not {count}")
    mean, scatter = float(finite.mean()), float(finite.std(ddof=1))
    if np.ptp(finite) <= _ROUNDING * np.abs(finite).max():
        scatter = 0.0  # the same number, worked out twice
    half_width = float(student.ppf(0.975, count - 1)) * scatter / count**0.5
    return Spread(mean, half_width, scatter / abs(mean) if mean else np.inf, count)


def anova(groups: Sequence[Sequence[float]]) -> Anova:
    """Whether the means of ``groups`` differ by more than their scatter explains.

    Raises ValueError unless there are two groups and one of them has two values.
    """
    from scipy.stats import f as fisher

    sizes = [len(group) for group in groups]
    if len(groups) < 2 or min(sizes) < 1 or max(sizes) < 2:
        raise ValueError(f"analysis of variance needs at least two groups and repeats, not groups of {sizes}")
    everything = np.concatenate([np.asarray(group, float) for group in groups])
    means = [float(np.mean(group)) for group in groups]
    between, within = len(groups) - 1, len(everything) - len(groups)
    explained = sum(n * (m - everything.mean()) ** 2 for n, m in zip(sizes, means, strict=True)) / between
    scatter = sum(float(np.sum((np.asarray(g) - m) ** 2)) for g, m in zip(groups, means, strict=True)) / within
    ratio = explained / scatter if scatter else np.inf
    return Anova(float(ratio), float(fisher.sf(ratio, between, within)), between, within)
