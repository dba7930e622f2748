"""Noise that a sensor remembers: white noise and, beside it, a first-order (Ornstein-Uhlenbeck) process.

Neighbouring samples then have a part in common, so that residuals over σ are not independent. Their innovations are:
the difference of each sample from the one foretold by all before it (Kalman filter of a scalar state).
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sim_devices.chain import FloatArray

SHARES, MOST = (0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.45, 0.6, 0.8, 1.2), 0.45
"""Standard deviation of the slow part over the white one's, and the most that is believed: a real sensor has 5 to 20 %
of its variance in it (assumed). More is a misfit, and none of it is the sensor's."""
TIMES = (0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 6.4)
"""s within which the slow part forgets."""
PIECE, TELLS = 20.0, 40
"""s, and rows at least, of a piece of a recording that is asked by itself."""
EARNED = 10.0
"""Nats that a slow part must earn in all channels to be believed."""
IGNORED = 1e3
"""Times the noise of rows that are left out."""


@njit(cache=True, error_model="numpy")
def _gains(
    time: FloatArray,
    recording: NDArray[np.int64],
    white: FloatArray,
    slow: float,
    tau: float,
    walk: FloatArray,
    kept: FloatArray,
    load: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Variance (n,) of the innovations of a channel, their weights (n, 2) in two states, and the decay (n, 2) of these
    since the row before: the slow part, and a random walk, of rms ``walk`` (n,) after a second at the rate of each row,
    of which ``kept`` (n,) says where it goes on, 1, and where it begins anew, 0, as it does in each recording;
    ``load`` (n,) times it is in the row."""
    variance, gain, decay = np.empty(len(time)), np.empty((len(time), 2)), np.zeros((len(time), 2))
    a, b, c = slow, 0.0, 0.0  # covariance of the states: slow with itself, with the walk, the walk with itself
    for i in range(len(time)):
        if i > 0 and recording[i] == recording[i - 1]:
            passed = max(time[i] - time[i - 1], 0.0)
            decay[i, 0], decay[i, 1] = np.exp(-passed / tau), kept[i]
            a = decay[i, 0] ** 2 * a + (1.0 - decay[i, 0] ** 2) * slow
            b, c = decay[i, 0] * kept[i] * b, kept[i] ** 2 * c + walk[i] ** 2 * passed
        else:
            a, b, c = slow, 0.0, 0.0
        seen_slow, seen_walk = a + load[i] * b, b + load[i] * c
        variance[i] = seen_slow + load[i] * seen_walk + white[i]
        gain[i, 0], gain[i, 1] = seen_slow / variance[i], seen_walk / variance[i]
        a, b, c = a - gain[i, 0] * seen_slow, b - gain[i, 0] * seen_walk, c - gain[i, 1] * seen_walk
    return variance, gain, decay


@njit(cache=True, error_model="numpy")
def _innovations(x: FloatArray, gain: FloatArray, decay: FloatArray, load: FloatArray, sd: FloatArray) -> FloatArray:
    """Columns of x (n, p) as innovations over their standard deviations ``sd`` (n,)."""
    out = np.empty_like(x)
    slow, walk = np.zeros(x.shape[1]), np.zeros(x.shape[1])
    for i in range(len(x)):
        for j in range(x.shape[1]):
            slow[j] *= decay[i, 0]
            walk[j] *= decay[i, 1]
            new = x[i, j] - slow[j] - load[i] * walk[j]
            out[i, j] = new / sd[i]
            slow[j] += gain[i, 0] * new
            walk[j] += gain[i, 1] * new
    return out


@njit(cache=True, error_model="numpy")
def _undone(e: FloatArray, gain: FloatArray, decay: FloatArray, load: FloatArray, sd: FloatArray) -> FloatArray:
    """The columns (n, p) whose innovations over ``sd`` are e (n, p)."""
    out = np.empty_like(e)
    slow, walk = np.zeros(e.shape[1]), np.zeros(e.shape[1])
    for i in range(len(e)):
        for j in range(e.shape[1]):
            new = e[i, j] * sd[i]
            slow[j], walk[j] = decay[i, 0] * slow[j], decay[i, 1] * walk[j]
            out[i, j] = slow[j] + load[i] * walk[j] + new
            slow[j], walk[j] = slow[j] + gain[i, 0] * new, walk[j] + gain[i, 1] * new
    return out


def _log_likelihood(
    time: FloatArray, recording: NDArray[np.int64], rest: FloatArray, new: FloatArray, slow: float, tau: float
) -> float:
    """Of noise ``rest`` (n,), white of variances ``new`` (n,) but for a ``slow`` part that forgets within ``tau`` s."""
    no, all_of_it = np.zeros(len(time)), np.ones(len(time))
    variance, gain, decay = _gains(time, recording, new, slow**2, tau, no, all_of_it, all_of_it)
    innovations = _innovations(rest[:, None], gain, decay, all_of_it, np.sqrt(variance))
    return -0.5 * float(np.sum(np.square(innovations)) + np.sum(np.log(variance)))


class _Rest(NamedTuple):
    """What a fit leaves of a channel: time, recording, rest, variance (n,) of its rows, and white noise of a sample."""

    time: FloatArray
    recording: NDArray[np.int64]
    rest: FloatArray
    new: FloatArray
    sigma: float

    def earned(self, share: float, tau: float) -> float:
        """Nats that a slow part of a ``share`` of the white noise earns."""
        alone = -0.5 * float(np.sum(np.square(self.rest) / self.new + np.log(self.new)))
        return _log_likelihood(self.time, self.recording, self.rest, self.new, share * self.sigma, tau) - alone

    def pieces(self) -> list[_Rest]:
        """Its pieces of `PIECE` s of a recording, without those that are too short to tell where others are not."""
        places = np.floor(self.time / PIECE)
        edges = np.flatnonzero((np.diff(self.recording) != 0) | (np.diff(places) != 0)) + 1
        split = (np.split(values, edges) for values in (self.time, self.recording, self.rest, self.new))
        every = [_Rest(time, run, rest, new, self.sigma) for time, run, rest, new in zip(*split, strict=True)]
        return [piece for piece in every if len(piece.time) >= TELLS] or every


class Wider(NamedTuple):
    """The noise that effects by chance add to C channels at n time stamps.

    ``scattered`` (C·n,) is the variance, SI, of each row by itself; ``walks`` (C, n) the rms after a second of random
    walks, at the rate of each row, which are there ``loads`` (C, n) times (once, if not given), and go on to all
    rows or to those that ``kept`` (n,), of 0 and 1, says."""

    scattered: FloatArray | None = None
    walks: FloatArray | None = None
    loads: FloatArray | None = None
    kept: FloatArray | None = None


NOTHING = Wider()
_Filter = tuple[FloatArray, FloatArray, FloatArray, FloatArray]


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

    def remembering(self, share: float, tau: float, noise: Sequence[float]) -> RowNoise:
        """The same rows, of whose white ``noise`` (C,) a ``share`` more forgets within ``tau`` s."""
        out = copy.copy(self)
        out._slow, out._taus = share * np.asarray(noise), np.full(len(noise), tau)
        return out

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

        ``noise`` (C,) is the white noise of a sample. Channels are alike: share and time are those of the middle piece
        of a channel's recordings, as one that sticks, misfits or holds an event does not tell for the others.
        """
        told = np.ones(len(self._time), dtype=bool) if among is None else among
        rows = zip(left.reshape(self._new.shape)[:, told], self._new[:, told], noise, strict=True)
        channels = [_Rest(self._time[told], self._recording[told], *own) for own in rows]
        found = [max((p.earned(*q), *q) for q in product(SHARES, TIMES)) for c in channels for p in c.pieces()]
        _, share, tau = (float(np.median(values)) for values in zip(*found, strict=True))
        earned = len(channels) * float(np.median([channel.earned(share, tau) for channel in channels]))
        if earned > EARNED and share <= MOST:
            self._slow, self._taus = share * np.asarray(noise), np.full(len(noise), tau)

    def _filters(self, wider: Wider) -> list[tuple[_Filter | None, FloatArray]]:
        """Of each channel gains, decays, loads and standard deviations of its filter, none if its rows are independent,
        and the latter (n,)."""
        new = self._new if wider.scattered is None else self._new + wider.scattered.reshape(self._new.shape)
        if self._taus is None:
            white, slow, taus = new + self._slow[:, None] ** 2, np.zeros(len(new)), np.ones(len(new))
        else:
            white, slow, taus = new, self._slow, self._taus
        walks = np.zeros_like(new) if wider.walks is None else wider.walks
        loads = np.ones_like(new) if wider.loads is None else wider.loads
        kept = np.ones(len(self._time)) if wider.kept is None else wider.kept
        filters: list[tuple[_Filter | None, FloatArray]] = []
        for own, floor, tau, walk, load in zip(white, slow, taus, walks, loads, strict=True):
            if self._taus is None and not np.any(walk):
                filters.append((None, np.sqrt(own)))
                continue
            variance, gain, decay = _gains(self._time, self._recording, own, floor**2, tau, walk, kept, load)
            sd = np.sqrt(variance)
            filters.append(((gain, decay, load, sd), sd))
        return filters

    def sd(self, wider: Wider = NOTHING) -> FloatArray:
        """Standard deviation (C·n,) of the innovations, with the noise of ``wider``."""
        return np.concatenate([sd for _, sd in self._filters(wider)])

    def whitened(self, difference: FloatArray, wider: Wider = NOTHING) -> FloatArray:
        """``difference`` (C·n,) or (C·n, p) in σ, with the noise of ``wider``: independent parts if it is noise."""
        parts = zip(self._parts(difference), self._filters(wider), strict=True)
        white = [x / sd[:, None] if f is None else _innovations(x, *f) for x, (f, sd) in parts]
        return np.concatenate(white).reshape(difference.shape)

    def unwhitened(self, residual: FloatArray, wider: Wider = NOTHING) -> FloatArray:
        """The difference (C·n,) or (C·n, p), SI, that is whitened to ``residual``."""
        parts = zip(self._parts(residual), self._filters(wider), strict=True)
        undone = [e * sd[:, None] if f is None else _undone(e, *f) for e, (f, sd) in parts]
        return np.concatenate(undone).reshape(residual.shape)

    def _parts(self, rows: FloatArray) -> list[FloatArray]:
        """Channel by channel, in columns."""
        return np.split(rows if rows.ndim > 1 else rows[:, None], len(self._new))
