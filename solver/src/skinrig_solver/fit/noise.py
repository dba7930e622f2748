"""The noise of a compared curve, read from a fit's residual: a white part, and one that remembers.

A fit follows slow noise and takes it for its parameters, so that its residual shows less of it than there was. Both
shares and the time constant are therefore those of the largest restricted likelihood (Patterson and Thompson 1971;
Harville 1977), which counts the directions that the parameters have taken.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import comb

import numpy as np
from numba import njit
from scipy.optimize import minimize

from ..api import Array

LEAST = 20  # samples of which memory can be told at all
WORTH = 6.0  # twice the rise of the log likelihood from which noise is said to remember: 95 % of chi-squared with two
SHARES = (0.1, 0.4, 0.75, 0.9, 0.96, 0.99)  # of the variance that remembers, where a search begins
TIMES = 9  # time constants of the same, from one sample to the slowest
SLOWEST = 0.2  # of the recording: a longer memory is a misfit's or a drift's, of which one sample is at hand
ORDERS = (2, 3, 4)  # of differences, in which noise is left of a smooth curve
FAR = 50.0  # minus log likelihood above the white one's, where none can be computed


@dataclass(frozen=True)
class Scatter:
    """Stationary noise at times (n,): ``deviation``, the ``share`` of its variance that fades with ``constant`` [s]."""

    time: Array
    deviation: float
    share: float = 0.0
    constant: float = 1.0

    def covariance(self, rows: Array) -> Array:
        """rows' V rows (m, m) for rows (n, m), V the covariance (n, n) of the samples."""
        if self.share == 0.0:
            return np.asarray(self.deviation**2 * rows.T @ rows)
        spread = _coloured(np.ascontiguousarray(rows), _decay(self.time, self.constant), self.share)
        return np.asarray(self.deviation**2 * rows.T @ spread)

    def widening(self, basis: Array) -> float:
        """Variance along basis (n, m) over that of white noise with the same deviation, at least 1."""
        if self.share == 0.0 or self.deviation == 0.0 or not basis.shape[1]:
            return 1.0
        return max(1.0, float(np.trace(self.covariance(basis)) / self.deviation**2 / basis.shape[1]))


def scatter_of(residual: Array, slopes: Array, time: Array) -> Scatter:
    """The noise behind a residual (n,) [SI] that is left by parameters of slopes (n, m) at times (n,)."""
    basis = directions(slopes)
    freedom = max(residual.size - basis.shape[1], 1)
    left = residual - basis @ (basis.T @ residual)
    white = Scatter(time, float(np.sqrt(left @ left / freedom)))
    if residual.size < LEAST or white.deviation == 0.0 or freedom < LEAST // 2:
        return white
    columns = np.ascontiguousarray(np.column_stack([residual / white.deviation, basis]))
    base = _minus_log(columns, np.zeros(time.size - 1), 0.0)[0]
    step, span = float(np.median(np.diff(time))), float(np.ptp(time))

    def minus(place: Array) -> float:
        share, constant = _unpacked(place, step, span)
        return float(min(_minus_log(columns, _decay(time, constant), share)[0] - base, FAR))

    starts = [
        np.array([np.log(s / (1.0 - s)), np.log(c)]) for s in SHARES for c in np.geomspace(step, SLOWEST * span, TIMES)
    ]
    first = min(starts, key=minus)
    if minus(first) > -0.25 * WORTH:
        return white  # no start comes near a rise that is worth it
    inwards = first + np.array([[0.0, 0.0], [-0.7, 0.0], [0.0, -0.7]])  # a place at the end of a range is left so
    options = {"initial_simplex": inwards, "xatol": 0.01, "fatol": 0.005, "maxfev": 150}
    best = minimize(minus, first, method="Nelder-Mead", options=options)
    if -2.0 * best.fun < WORTH:
        return white
    share, constant = _unpacked(best.x, step, span)
    size = _minus_log(columns, _decay(time, constant), share)[1]
    return Scatter(time, white.deviation * size, share, constant)


def white_noise(value: Array) -> float:
    """Standard deviation of the white noise of a curve (n,), by differences of neighbours, of which steps spoil few."""
    value = value[np.isfinite(value)]
    found = []
    for order in ORDERS:
        if value.size > 4 * order:
            rough = np.median(np.abs(np.diff(value, order))) / 0.6745
            found.append(float(rough) / np.sqrt(comb(2 * order, order)))
    return min(found, default=0.0)


def directions(slopes: Array) -> Array:
    """An orthonormal basis (n, k) of slopes (n, m), without directions that are next to nothing."""
    size = np.linalg.norm(slopes, axis=0)
    kept = slopes[:, size > 1e-12 * size.max(initial=0.0)]
    if not kept.shape[1]:
        return np.zeros((len(slopes), 0))
    left, values, _ = np.linalg.svd(kept / np.linalg.norm(kept, axis=0), full_matrices=False)
    return np.asarray(left[:, values > 1e-7 * values[0]])


def _unpacked(place: Array, step: float, span: float) -> tuple[float, float]:
    """Share and time constant [s] of a place of the search, within their bounds."""
    share = 1.0 / (1.0 + np.exp(-np.clip(place[0], -8.0, 12.0)))
    return float(share), float(np.clip(np.exp(place[1]), 0.3 * step, SLOWEST * span))


def _minus_log(columns: Array, decay: Array, share: float) -> tuple[float, float]:
    """Minus the restricted log likelihood of the first column given the others, and the deviation."""
    white, determinant = _whitened(columns, decay, share)
    y, x = white[:, 0], white[:, 1:]
    freedom = y.size - x.shape[1]
    if x.shape[1]:
        q, r = np.linalg.qr(x)
        y = y - q @ (q.T @ y)
        determinant += 2.0 * float(np.log(np.abs(np.diag(r)).clip(1e-300)).sum())
    left = float(y @ y)
    return 0.5 * (freedom * np.log(max(left, 1e-300) / freedom) + determinant), float(np.sqrt(left / freedom))


def _decay(time: Array, constant: float) -> Array:
    return np.asarray(np.exp(-np.diff(time) / constant))


@njit(cache=True)
def _whitened(columns: Array, decay: Array, share: float) -> tuple[Array, float]:  # pragma: no cover
    """Columns (n, k) whose noise of variance 1 was made white by Kalman's filter, and the log determinant."""
    n, k = columns.shape
    found = np.empty((n, k))
    mean = np.zeros(k)
    variance, determinant = share, 0.0
    for t in range(n):
        total = max(variance + 1.0 - share, 1e-12)
        determinant += np.log(total)
        for j in range(k):
            new = columns[t, j] - mean[j]
            found[t, j] = new / np.sqrt(total)
            mean[j] += variance / total * new
        variance *= (1.0 - share) / total
        if t < n - 1:
            for j in range(k):
                mean[j] *= decay[t]
            variance = decay[t] ** 2 * variance + share * (1.0 - decay[t] ** 2)
    return found, determinant


@njit(cache=True)
def _coloured(rows: Array, decay: Array, share: float) -> Array:  # pragma: no cover
    """The correlation matrix (n, n) times rows (n, m)."""
    n, m = rows.shape
    found = rows.copy()
    for j in range(m):
        before = 0.0
        for t in range(1, n):
            before = decay[t - 1] * (before + rows[t - 1, j])
            found[t, j] += share * before
        after = 0.0
        for t in range(n - 2, -1, -1):
            after = decay[t] * (after + rows[t + 1, j])
            found[t, j] += share * after
    return found
