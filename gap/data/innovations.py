"""Noise that a sensor remembers: white noise and, beside it, a first-order (Ornstein-Uhlenbeck) process.

Neighbouring samples then have a part in common, so that residuals over σ are not independent. Their innovations are:
the difference of each sample from the one foretold by all before it (Kalman filter of a scalar state).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sim_devices.chain import FloatArray

SHARES, MOST = (0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.45, 0.6, 0.8, 1.2), 0.45
"""Standard deviation of the slow part over the white one's, and the most that is believed: a real sensor has 5 to 20 %
of its variance in it (assumed). More is a misfit, and none of it is the sensor's."""
TIMES = (0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 6.4)
"""s within which the slow part forgets."""
EARNED = 10.0
"""Nats that a slow part must earn in a channel to be believed."""
IGNORED = 1e3
"""Times the noise of rows that are left out."""


@njit(cache=True, error_model="numpy")
def _gains(
    time: FloatArray, recording: NDArray[np.int64], white: FloatArray, slow: float, tau: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Variance (n,) of the innovations of a channel, their weight in the state, and its decay since the row before."""
    variance, gain, decay = np.empty(len(time)), np.empty(len(time)), np.zeros(len(time))
    state = slow
    for i in range(len(time)):
        if i > 0 and recording[i] == recording[i - 1]:
            decay[i] = np.exp(-max(time[i] - time[i - 1], 0.0) / tau)
            state = decay[i] ** 2 * state + (1.0 - decay[i] ** 2) * slow
        else:
            state = slow
        variance[i] = state + white[i]
        gain[i] = state / variance[i]
        state *= 1.0 - gain[i]
    return variance, gain, decay


@njit(cache=True, error_model="numpy")
def _innovations(x: FloatArray, gain: FloatArray, decay: FloatArray, sd: FloatArray) -> FloatArray:
    """Columns of x (n, p) as innovations over their standard deviations ``sd`` (n,)."""
    out = np.empty_like(x)
    state = np.zeros(x.shape[1])
    for i in range(len(x)):
        for j in range(x.shape[1]):
            foretold = decay[i] * state[j]
            new = x[i, j] - foretold
            out[i, j] = new / sd[i]
            state[j] = foretold + gain[i] * new
    return out


@njit(cache=True, error_model="numpy")
def _undone(e: FloatArray, gain: FloatArray, decay: FloatArray, sd: FloatArray) -> FloatArray:
    """The column (n,) whose innovations over ``sd`` are e (n,)."""
    out = np.empty_like(e)
    state = 0.0
    for i in range(len(e)):
        foretold = decay[i] * state
        new = e[i] * sd[i]
        out[i] = foretold + new
        state = foretold + gain[i] * new
    return out


def _log_likelihood(
    time: FloatArray, recording: NDArray[np.int64], rest: FloatArray, new: FloatArray, slow: float, tau: float
) -> float:
    """Of noise ``rest`` (n,), white of variances ``new`` (n,) but for a ``slow`` part that forgets within ``tau`` s."""
    variance, gain, decay = _gains(time, recording, new, slow**2, tau)
    innovations = _innovations(rest[:, None], gain, decay, np.sqrt(variance))
    return -0.5 * float(np.sum(np.square(innovations)) + np.sum(np.log(variance)))


class RowNoise:
    """Noise of rows: C channels at the same n time stamps, recordings by themselves.

    ``new`` (C, n) is the variance of the white part, row by row. ``slow`` (C,) is the standard deviation, SI, of the
    part that neighbouring rows have in common: a floor that averaging does not lower, and rows count as independent,
    unless `remember` finds its correlation time. Then residuals are innovations.
    """

    def __init__(
        self, time: FloatArray, recording: NDArray[np.int64], new: FloatArray, slow: Sequence[float] | None = None
    ) -> None:
        self._time, self._recording, self._new = np.asarray(time, dtype=float), recording, new
        self._slow = np.zeros(len(new)) if slow is None else np.asarray(slow, dtype=float)
        self._taus: FloatArray | None = None  # s, (C,), once they are known

    @property
    def sigma(self) -> FloatArray:
        """Standard deviation (C·n,) of the rows, SI."""
        out: FloatArray = np.sqrt(self._new + self._slow[:, None] ** 2).ravel()
        return out

    @property
    def memory(self) -> tuple[FloatArray, FloatArray] | None:
        """Standard deviation (C,) of the slow part, SI, and the s (C,) within which it forgets; None unless known."""
        return None if self._taus is None else (self._slow, self._taus)

    def share(self, other: RowNoise) -> None:
        """Have the slow part of another record as well, from which this one is foretold."""
        if other._taus is not None:
            self._slow, self._taus = np.hypot(self._slow, other._slow), other._taus

    def blur(self, sd: FloatArray) -> None:
        """Add independent noise of standard deviation ``sd`` (C·n,), SI, to the rows."""
        self._new = self._new + np.square(sd).reshape(self._new.shape)

    def widen(self, rows: NDArray[np.int64], times: float = IGNORED) -> None:
        """Let some ``rows``, by number, scatter so many times as wide: without a number, so that they tell nothing."""
        new = self._new.ravel().copy()
        new[rows] += np.square(self.sigma[rows]) * (times**2 - 1.0)
        self._new = new.reshape(self._new.shape)

    def alike(self, other: RowNoise) -> None:
        """Have the slow part that the same sensor has in ``other`` rows, where it is known there."""
        if other._taus is not None:
            self._slow, self._taus = other._slow, other._taus

    def remember(self, left: FloatArray, noise: Sequence[float], among: NDArray[np.bool_] | None = None) -> None:
        """Take a slow part into account if the rest ``left`` (C·n,) of a fit of all channels shows one, ``among`` some
        of the n time stamps where others would not tell.

        ``noise`` (C,) is the white noise of a sample. Channels are alike: share and time are those of the middle one by
        each, as one that sticks, or misfits otherwise, does not tell for the others.
        """
        found, told = [], np.ones(len(self._time), dtype=bool) if among is None else among
        for new, rest, sigma in zip(self._new[:, told], left.reshape(self._new.shape)[:, told], noise, strict=True):
            alone = -0.5 * float(np.sum(np.square(rest) / new + np.log(new)))
            rows = self._time[told], self._recording[told]
            likely = ((_log_likelihood(*rows, rest, new, s * sigma, tau), s, tau) for s, tau in product(SHARES, TIMES))
            best, share, tau = max(likely)
            found.append((best - alone, share, tau))
        earned, share, tau = (float(np.median(values)) for values in zip(*found, strict=True))
        if earned > EARNED and share <= MOST:
            self._slow, self._taus = share * np.asarray(noise), np.full(len(noise), tau)

    def _filters(self, added: FloatArray | None) -> list[tuple[FloatArray, FloatArray, FloatArray]]:
        """Gains, decays and standard deviations (n,) of each channel's filter, with ``added`` variance (C·n,). Of rows
        that count as independent the filter remembers nothing."""
        new = self._new if added is None else self._new + added.reshape(self._new.shape)
        if self._taus is None:
            nothing = np.zeros(len(self._time))
            return [(nothing, nothing, np.sqrt(own + slow**2)) for own, slow in zip(new, self._slow, strict=True)]
        filters = []
        for own, slow, tau in zip(new, self._slow, self._taus, strict=True):
            variance, gain, decay = _gains(self._time, self._recording, own, slow**2, tau)
            filters.append((gain, decay, np.sqrt(variance)))
        return filters

    def sd(self, added: FloatArray | None = None) -> FloatArray:
        """Standard deviation (C·n,) of the innovations, with ``added`` variance (C·n,)."""
        return np.concatenate([sd for _, _, sd in self._filters(added)])

    def whitened(self, difference: FloatArray, added: FloatArray | None = None) -> FloatArray:
        """``difference`` (C·n,) or (C·n, p) in σ, with ``added`` variance (C·n,): independent parts if it is noise."""
        columns = difference if difference.ndim > 1 else difference[:, None]
        parts = zip(np.split(columns, len(self._new)), self._filters(added), strict=True)
        return np.concatenate([_innovations(x, *f) for x, f in parts]).reshape(difference.shape)

    def unwhitened(self, residual: FloatArray, added: FloatArray | None = None) -> FloatArray:
        """The difference (C·n,), SI, that is whitened to ``residual`` (C·n,)."""
        parts = zip(np.split(residual, len(self._new)), self._filters(added), strict=True)
        return np.concatenate([_undone(e, *f) for e, f in parts])
