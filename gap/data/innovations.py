"""Noise that a sensor remembers: white noise and, beside it, a first-order (Ornstein-Uhlenbeck) process; and the
noise that an effect by chance adds, a random walk or a rhythm whose phase wanders.

Neighbouring samples then have a part in common, so that residuals over σ are not independent. Their innovations are:
the difference of each sample from the one foretold by all before it (a Kalman filter of few states).
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
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


class _States(NamedTuple):
    """What a channel remembers from one of its n rows to the next, as K states with a part in each row.

    ``keeps`` (n, K, K) is their transition since the row before, nought where a recording begins; ``grows`` (n, K, K)
    the covariance that is new; ``load`` (n, K) how often each state is in the row."""

    keeps: FloatArray
    grows: FloatArray
    load: FloatArray


@njit(cache=True, error_model="numpy")
def _gains(white: FloatArray, keeps: FloatArray, grows: FloatArray, load: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Variance (n,) of the innovations of a channel whose rows have the variance ``white`` (n,) by themselves, and
    their weights (n, K) in its states."""
    n, k = load.shape
    variance, gain = np.empty(n), np.empty((n, k))
    covariance, moved, seen = np.zeros((k, k)), np.empty((k, k)), np.empty(k)
    for i in range(n):
        for a in range(k):
            for b in range(k):
                moved[a, b] = 0.0
                for c in range(k):
                    moved[a, b] += keeps[i, a, c] * covariance[c, b]
        for a in range(k):
            for b in range(k):
                covariance[a, b] = grows[i, a, b]
                for c in range(k):
                    covariance[a, b] += moved[a, c] * keeps[i, b, c]
        variance[i] = white[i]
        for a in range(k):
            seen[a] = 0.0
            for b in range(k):
                seen[a] += covariance[a, b] * load[i, b]
            variance[i] += load[i, a] * seen[a]
        for a in range(k):
            gain[i, a] = seen[a] / variance[i]
            for b in range(k):
                covariance[a, b] -= gain[i, a] * seen[b]
    return variance, gain


@njit(cache=True, error_model="numpy")
def _innovations(
    x: FloatArray, gain: FloatArray, keeps: FloatArray, load: FloatArray, sd: FloatArray, undo: bool
) -> FloatArray:
    """Columns of x (n, p) as innovations over their standard deviations ``sd`` (n,); where it is to ``undo`` that, the
    columns whose innovations x are. Columns are innermost, as they are many."""
    n, p = x.shape
    k = load.shape[1]
    out, states, moved, new = np.empty_like(x), np.zeros((k, p)), np.zeros((k, p)), np.empty(p)
    for i in range(n):
        for j in range(p):
            out[i, j] = 0.0
        for a in range(k):
            for j in range(p):
                moved[a, j] = keeps[i, a, 0] * states[0, j]
            for b in range(1, k):
                for j in range(p):
                    moved[a, j] += keeps[i, a, b] * states[b, j]
            for j in range(p):
                out[i, j] += load[i, a] * moved[a, j]
        for j in range(p):  # ``out`` is the foretold part until here
            new[j] = x[i, j] * sd[i] if undo else x[i, j] - out[i, j]
            out[i, j] = out[i, j] + new[j] if undo else new[j] / sd[i]
        for a in range(k):
            for j in range(p):
                states[a, j] = moved[a, j] + gain[i, a] * new[j]
    return out


def _passed(time: FloatArray, recording: NDArray[np.int64]) -> FloatArray:
    """s (n,) since the row before, infinite where a recording begins."""
    same = np.append(False, np.diff(recording) == 0)
    return np.where(same, np.maximum(np.diff(time, prepend=time[:1]), 0.0), np.inf)


def _slow_states(passed: FloatArray, slow: float, tau: float) -> _States:
    """Of a first-order process of variance ``slow`` that forgets within ``tau`` s."""
    keeps = np.exp(-passed / tau)
    return _States(keeps[:, None, None], (slow * (1.0 - keeps**2))[:, None, None], np.ones((len(passed), 1)))


def _walk_states(passed: FloatArray, walk: FloatArray, kept: FloatArray, load: FloatArray) -> _States:
    """Of a random walk, of rms ``walk`` (n,) after a second at the rate of each row, of which ``kept`` (n,) says where
    it goes on, 1, and where it begins anew, 0, as it does in each recording; ``load`` (n,) times it is in the row."""
    goes_on = np.isfinite(passed)
    grows = np.where(goes_on, walk**2 * np.where(goes_on, passed, 0.0), 0.0)
    return _States(np.where(goes_on, kept, 0.0)[:, None, None], grows[:, None, None], load[:, None])


def _rhythm_states(passed: FloatArray, rhythm: Rhythm, rms: float) -> _States:
    """Of a rhythm of an ``rms``, whose phase wanders: a sine and a cosine that turn and forget. Its mean over the time
    that a row stands for is less than itself."""
    goes_on = np.isfinite(passed)
    since = np.where(goes_on, passed, 0.0)
    turn, decay = 2.0 * np.pi * rhythm.frequency * since, np.where(goes_on, np.exp(-since / rhythm.lasts), 0.0)
    cos, sin = decay * np.cos(turn), decay * np.sin(turn)
    keeps = np.stack([cos, -sin, sin, cos], axis=1).reshape(-1, 2, 2)
    grows = (rms**2 * (1.0 - decay**2))[:, None, None] * np.eye(2)
    width = np.minimum(passed, np.append(passed[1:], np.inf))
    width[~np.isfinite(width)] = 0.0
    return _States(keeps, grows, np.column_stack([np.sinc(rhythm.frequency * width), np.zeros(len(since))]))


def _together(parts: Sequence[_States]) -> _States:
    """Independent states beside each other."""
    if len(parts) == 1:
        return parts[0]
    n, sizes = len(parts[0].load), [part.load.shape[1] for part in parts]
    keeps, grows = np.zeros((n, sum(sizes), sum(sizes))), np.zeros((n, sum(sizes), sum(sizes)))
    for part, end, size in zip(parts, np.cumsum(sizes), sizes, strict=True):
        keeps[:, end - size : end, end - size : end] = part.keeps
        grows[:, end - size : end, end - size : end] = part.grows
    return _States(keeps, grows, np.hstack([part.load for part in parts]))


def _log_likelihood(passed: FloatArray, rest: FloatArray, new: FloatArray, slow: float, tau: float) -> float:
    """Of noise ``rest`` (n,), white of variances ``new`` (n,) but for a ``slow`` part that forgets within ``tau`` s."""
    states = _slow_states(passed, slow**2, tau)
    variance, gain = _gains(new, *states)
    innovations = _innovations(rest[:, None], gain, states.keeps, states.load, np.sqrt(variance), False)
    return -0.5 * float(np.sum(np.square(innovations)) + np.sum(np.log(variance)))


@dataclass(frozen=True)
class _Rest:
    """What a fit leaves of a channel: time, recording, rest, variance (n,) of its rows, and white noise of a sample."""

    time: FloatArray
    recording: NDArray[np.int64]
    rest: FloatArray
    new: FloatArray
    sigma: float

    @cached_property
    def passed(self) -> FloatArray:
        """s (n,) since the row before (`_passed`)."""
        return _passed(self.time, self.recording)

    def earned(self, share: float, tau: float) -> float:
        """Nats that a slow part of a ``share`` of the white noise earns."""
        alone = -0.5 * float(np.sum(np.square(self.rest) / self.new + np.log(self.new)))
        return _log_likelihood(self.passed, self.rest, self.new, share * self.sigma, tau) - alone

    def pieces(self) -> list[_Rest]:
        """Its pieces of `PIECE` s of a recording, without those that are too short to tell where others are not."""
        places = np.floor(self.time / PIECE)
        edges = np.flatnonzero((np.diff(self.recording) != 0) | (np.diff(places) != 0)) + 1
        split = (np.split(values, edges) for values in (self.time, self.recording, self.rest, self.new))
        every = [_Rest(time, run, rest, new, self.sigma) for time, run, rest, new in zip(*split, strict=True)]
        return [piece for piece in every if len(piece.time) >= TELLS] or every


class Rhythm(NamedTuple):
    """A rhythm of a ``frequency``, Hz, whose phase is its own for so many s as it ``lasts``, with an ``rms`` (C,), SI,
    in each channel."""

    frequency: float
    lasts: float
    rms: FloatArray


class Wider(NamedTuple):
    """The noise that effects by chance add to C channels at n time stamps.

    ``scattered`` (C·n,) is the variance, SI, of each row by itself; ``walks`` (C, n) the rms after a second of random
    walks, at the rate of each row, which are there ``loads`` (C, n) times (once, if not given), and go on to all
    rows or to those that ``kept`` (n,), of 0 and 1, says; ``rhythm`` is one that wanders."""

    scattered: FloatArray | None = None
    walks: FloatArray | None = None
    loads: FloatArray | None = None
    kept: FloatArray | None = None
    rhythm: Rhythm | None = None

    @property
    def remembers(self) -> bool:
        """Whether the rows before foretell a part of it."""
        return self.walks is not None or self.rhythm is not None


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
        self._passed = _passed(self._time, recording)

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
        filters: list[tuple[_Filter | None, FloatArray]] = []
        for c, own in enumerate(white):
            states = self._states(c, slow[c], taus[c], wider)
            if not states:
                filters.append((None, np.sqrt(own)))
                continue
            keeps, grows, load = _together(states)
            variance, gain = _gains(own, keeps, grows, load)
            sd = np.sqrt(variance)
            filters.append(((gain, keeps, load, sd), sd))
        return filters

    def _states(self, channel: int, slow: float, tau: float, wider: Wider) -> list[_States]:
        """What a channel remembers, with the noise of ``wider``; nothing where its rows are independent."""
        rms = 0.0 if wider.rhythm is None else float(wider.rhythm.rms[channel])
        walks = None if wider.walks is None or not np.any(wider.walks[channel]) else wider.walks[channel]
        if self._taus is None and walks is None and not rms:
            return []
        states = [_slow_states(self._passed, slow**2, tau)] if self._taus is not None else []
        if walks is not None:
            ones = np.ones(len(self._time))
            loads = ones if wider.loads is None else wider.loads[channel]
            states.append(_walk_states(self._passed, walks, ones if wider.kept is None else wider.kept, loads))
        if wider.rhythm is not None and rms:
            states.append(_rhythm_states(self._passed, wider.rhythm, rms))
        return states

    def sd(self, wider: Wider = NOTHING) -> FloatArray:
        """Standard deviation (C·n,) of the innovations, with the noise of ``wider``."""
        return np.concatenate([sd for _, sd in self._filters(wider)])

    def whitened(self, difference: FloatArray, wider: Wider = NOTHING) -> FloatArray:
        """``difference`` (C·n,) or (C·n, p) in σ, with the noise of ``wider``: independent parts if it is noise."""
        parts = zip(self._parts(difference), self._filters(wider), strict=True)
        white = [x / sd[:, None] if f is None else _innovations(x, *f, False) for x, (f, sd) in parts]
        return np.concatenate(white).reshape(difference.shape)

    def unwhitened(self, residual: FloatArray, wider: Wider = NOTHING) -> FloatArray:
        """The difference (C·n,) or (C·n, p), SI, that is whitened to ``residual``."""
        parts = zip(self._parts(residual), self._filters(wider), strict=True)
        undone = [e * sd[:, None] if f is None else _innovations(e, *f, True) for e, (f, sd) in parts]
        return np.concatenate(undone).reshape(residual.shape)

    def _parts(self, rows: FloatArray) -> list[FloatArray]:
        """Channel by channel, in columns."""
        return np.split(rows if rows.ndim > 1 else rows[:, None], len(self._new))
