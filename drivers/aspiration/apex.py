"""The apex of a profile: a robust polynomial over the cap, so that noise averages out and dents do not count."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_TERMS = 5  # quartic: a parabola would put the top of a round bubble several pixels too low
_ROUNDS = 5
_NOTCH = 15  # columns; a dent narrower than this (a reflection on the edge) is filled
_SPECK = 14  # a bump narrower than the image by this factor (dirt on the edge) is cut off


@njit(cache=True)
def cleaned(profile: FloatArray) -> FloatArray:
    """``profile`` (columns,) of rows, NaN for none, without narrow dents and bumps: where to look, not a measurement.

    A morphological closing, then an opening; gaps narrower than a bump are bridged, wider ones are infinitely low.
    """
    columns = len(profile)
    bump = max(24, columns // _SPECK)
    filled = np.where(np.isfinite(profile), profile, np.inf)
    last = -1  # the last column with an edge
    for column in range(columns):
        if not np.isfinite(profile[column]):
            continue
        if last >= 0 and column - last <= bump:
            filled[last + 1 : column] = max(profile[last], profile[column])
        last = column
    closed = _highest(_lowest(filled, _NOTCH), _NOTCH)
    # A bump at the border of the image is cut in half: the rim goes on beyond, so that it is cut off all the same.
    padded = np.empty(columns + 2 * bump)
    padded[:bump] = np.median(closed[: 3 * bump])
    padded[bump : bump + columns] = closed
    padded[bump + columns :] = np.median(closed[-3 * bump :])
    return _lowest(_highest(padded, bump), bump)[bump : bump + columns]


@njit(cache=True)
def _lowest(values: FloatArray, width: int) -> FloatArray:
    """The least value within ``width`` of each (n,); beyond the ends there is nothing."""
    found = np.empty(len(values))
    for k in range(len(values)):
        first = k - width // 2
        found[k] = values[max(first, 0) : first + width].min()
    return found


@njit(cache=True)
def _highest(values: FloatArray, width: int) -> FloatArray:
    """As `_lowest`, the greatest."""
    return -_lowest(-values, width)


@njit(cache=True)
def cap(clean: FloatArray, base: float) -> tuple[int, int]:
    """First and past-last column of the cap: around the highest point, down by a fifth of the height (4 to 30 px).

    ``clean`` (columns,) is a `cleaned` profile; higher is smaller. (0, 0) when there is nothing.
    """
    columns = clean.shape[0]
    best = int(np.argmin(clean))
    if not np.isfinite(clean[best]):
        return 0, 0
    floor = clean[best] + min(max(4.0, 0.2 * (base - clean[best])), 30.0)
    reach = columns // 4
    first = best
    while first > 0 and best - first < reach and clean[first - 1] <= floor:
        first -= 1
    last = best
    while last < columns - 1 and last - best < reach and clean[last + 1] <= floor:
        last += 1
    return first, last + 1


@njit(cache=True)
def fit(profile: FloatArray, first: int, last: int) -> tuple[float, float, float, float]:
    """Apex column, apex row, scatter (px) about the polynomial and share of columns used, of ``profile[first:last]``.

    Tukey's biweight, begun from the median scatter, gives dents and specks no weight. All NaN for fewer than 8 columns.
    """
    nothing = (np.nan, np.nan, np.nan, 0.0)
    width = last - first
    if width < 8:
        return nothing
    half = 0.5 * (width - 1)
    middle = first + half
    x, y = _edge(profile, first, last)
    if len(x) < 8:
        return nothing
    weight = np.ones(len(x))
    shift = y.min()
    coefficients = np.zeros(_TERMS)
    scatter = 0.0
    residual = np.empty(len(x))
    for _ in range(_ROUNDS):
        _fit_weighted(x, y, shift, weight, coefficients)
        for i in range(len(x)):
            residual[i] = y[i] - shift - _value(coefficients, x[i])
        scatter = max(1.4826 * np.sort(np.abs(residual))[len(x) // 2], 0.02)
        for i in range(len(x)):
            u = residual[i] / (4.685 * scatter)
            weight[i] = (1 - u * u) ** 2 if abs(u) < 1 else 0.0
        if weight.sum() < _TERMS + 2:
            return nothing
    at, best = _least(coefficients, 4 * width)
    return middle + half * at, best + shift, scatter, float((weight > 0.1).sum()) / width


@njit(cache=True)
def _edge(profile: FloatArray, first: int, last: int) -> tuple[FloatArray, FloatArray]:
    """Columns ``first`` to ``last`` of a profile that have an edge: places from -1 to 1 and rows, (n,) each."""
    half = 0.5 * (last - first - 1)
    n = 0
    for c in range(first, last):
        if np.isfinite(profile[c]):
            n += 1
    x = np.empty(n)
    y = np.empty(n)
    k = 0
    for c in range(first, last):
        if np.isfinite(profile[c]):
            x[k] = (c - (first + half)) / half
            y[k] = profile[c]
            k += 1
    return x, y


@njit(cache=True)
def _fit_weighted(x: FloatArray, y: FloatArray, shift: float, weight: FloatArray, coefficients: FloatArray) -> None:
    """Polynomial through ``y - shift`` (n,) at ``x`` (n,) with weights (n,): fills ``coefficients``."""
    matrix = np.zeros((_TERMS, _TERMS))
    right = np.zeros(_TERMS)
    powers = np.empty(2 * _TERMS - 1)
    moments = np.zeros(2 * _TERMS - 1)
    for i in range(len(x)):
        powers[0] = weight[i]
        for p in range(1, 2 * _TERMS - 1):
            powers[p] = powers[p - 1] * x[i]
        moments += powers
        for p in range(_TERMS):
            right[p] += powers[p] * (y[i] - shift)
    for p in range(_TERMS):
        for q in range(_TERMS):
            matrix[p, q] = moments[p + q]
        matrix[p, p] += 1e-9 * len(x)
    _solve(matrix, right, coefficients)


@njit(cache=True)
def _least(coefficients: FloatArray, steps: int) -> tuple[float, float]:
    """Where between -1 and 1 a polynomial is least, on a grid of ``steps`` parts, and its value there."""
    at = -1.0
    best = _value(coefficients, at)
    for k in range(1, steps + 1):
        here = -1.0 + 2.0 * k / steps
        value = _value(coefficients, here)
        if value < best:
            at, best = here, value
    return at, best


@njit(cache=True)
def _solve(matrix: FloatArray, right: FloatArray, solution: FloatArray) -> None:
    """Solve a symmetric positive definite system by Cholesky's method; ``matrix`` and ``right`` are used up."""
    n = right.shape[0]
    for j in range(n):
        for k in range(j):
            matrix[j, j] -= matrix[j, k] ** 2
        matrix[j, j] = np.sqrt(matrix[j, j])
        for i in range(j + 1, n):
            for k in range(j):
                matrix[i, j] -= matrix[i, k] * matrix[j, k]
            matrix[i, j] /= matrix[j, j]
    for i in range(n):
        for k in range(i):
            right[i] -= matrix[i, k] * right[k]
        right[i] /= matrix[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            right[i] -= matrix[k, i] * right[k]
        right[i] /= matrix[i, i]
        solution[i] = right[i]


@njit(cache=True)
def _value(coefficients: FloatArray, x: float) -> float:
    total = 0.0
    for p in range(coefficients.shape[0] - 1, -1, -1):
        total = total * x + coefficients[p]
    return total


@njit(cache=True)
def foot(profile: FloatArray, clean: FloatArray, edges: FloatArray) -> float:
    """The row on which the bubble stands.

    Where the outermost parts of the profile (given as found and `cleaned`) are level, the rim plane. Else the neck of a
    bubble on a needle, found in ``edges`` (2, rows; left and right).
    """
    columns = len(clean)
    seen = profile[np.abs(profile - clean) < 3.0]  # False for NaN
    border = max(4, columns // 32)
    if len(seen) > columns // 2:
        left, right = np.sort(seen[:border]), np.sort(seen[-border:])
        level = max(left[-1] - left[0], right[-1] - right[0]) <= 4.0
        one, other = left[border // 2], right[border // 2]
        if level and abs(one - other) <= 0.05 * columns:
            centre: float = 0.5 * (one + other)
            return centre
    return _neck(edges, clean.min())


@njit(cache=True)
def _neck(edges: FloatArray, apex_row: float) -> float:
    """Going down from the apex, the narrowest row after the widest; the lowest row where it does not narrow."""
    rows = edges.shape[1]
    widest, narrowest, narrow_row, lowest = 0.0, 0.0, -1, rows - 1
    for r in range(max(0, int(apex_row)), rows):
        width = edges[1, r] - edges[0, r]
        if np.isnan(width):
            continue
        lowest = r
        if width >= widest and narrow_row < 0:
            widest = width
        elif width < 0.95 * widest and (narrow_row < 0 or width < narrowest):
            narrowest, narrow_row = width, r
        elif narrow_row >= 0 and width > 1.05 * narrowest + 1.0:
            break
    if narrow_row < 0:
        return float(lowest)
    for r in range(max(0, int(apex_row)), narrow_row):
        # A needle of constant width begins above its noisiest row.
        width = edges[1, r] - edges[0, r]
        if r > apex_row + 0.25 * (narrow_row - apex_row) and width <= 1.02 * narrowest + 1.0:
            return float(r)
    return float(narrow_row)
