"""How chance scatters the instants of samples: all of them a little, or some of them a lot and one way.

Both make the noise wider where a signal is steep, by the same rms if need be. The law of it tells them apart:
jitter is as often early as late and leaves no sample alone, samples delivered late (or repeated for lost ones) are old,
and the others are in time.
"""

from __future__ import annotations

import numpy as np
from scipy.special import log_ndtr

from sim_devices.chain import FloatArray

SHOWN = 0.5
"""σ that the scatter must move a sample by to be asked for its law."""
TIMES = np.geomspace(0.4, 2.5, 17)
"""Sizes of an even scatter that are tried, as multiples of the rms that was fitted."""
SHARES = np.array([0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.35, 0.5])
"""Shares of the samples that may be late."""
LATE = np.geomspace(1e-3, 0.3, 24)
"""s by which these are late, or twice the most of it where they differ."""
TAKEN = np.array([0.0, 0.5, 1.0])
"""How much of the mean lateness other parameters of the fit have taken on."""
FREEDOM = 2.0
"""Nats that the second parameter of a law of some samples costs."""


def timing_log_bayes(residual: FloatArray, reach: FloatArray, rms: float, sparse: bool) -> float:
    """Nats by which the other law describes a residual (n,) σ better than the one that an effect of ``rms`` s has;
    none where it does not.

    ``reach`` (n,) is how many σ a sample moves when it is taken a second later. ``sparse`` if chance hits some samples
    and makes them older, else it scatters them all.
    """
    at = np.abs(reach) * rms > SHOWN
    if not np.any(at):
        return 0.0
    every, some = _all(residual[at], reach[at], rms), _some(residual[at], reach[at]) - FREEDOM
    return max(every - some if sparse else some - every, 0.0)


def _normal(z: FloatArray, width: FloatArray) -> FloatArray:
    """Log density of normal noise of 1 and a normal scatter of ``width``."""
    variance = 1.0 + np.square(width)
    return np.asarray(-0.5 * np.square(z) / variance - 0.5 * np.log(2.0 * np.pi * variance))


def _uniform(z: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Log density of normal noise of 1 and a scatter that is uniform between ``low`` and ``high``."""
    width = np.maximum(high - low, 1e-6)
    upper, lower = z - low, z - high  # the difference of two tails, on the side where it does not cancel
    turn = upper + lower > 0
    upper, lower = np.where(turn, -lower, upper), np.where(turn, -upper, lower)
    far = log_ndtr(upper)
    return np.asarray(far + np.log1p(-np.exp(np.minimum(log_ndtr(lower) - far, -1e-12))) - np.log(width))


def _all(z: FloatArray, k: FloatArray, rms: float) -> float:
    """The best log likelihood of instants that scatter all alike, normally or uniformly."""
    found = -np.inf
    for times in TIMES:
        half = np.abs(k) * (np.sqrt(3.0) * rms * times)
        found = max(found, float(np.sum(_normal(z, k * rms * times))), float(np.sum(_uniform(z, -half, half))))
    return found


def _some(z: FloatArray, k: FloatArray) -> float:
    """The best log likelihood of a share of old samples, all equally late or by anything up to twice as much."""
    found = -np.inf
    share = SHARES[:, None, None]
    for late in LATE:
        off = z - k * (TAKEN[:, None] * share * late)  # from where samples in time are, (shares, taken, m)
        in_time = np.log1p(-share) + _normal(off, 0.0 * k)
        equal = _normal(off + k * late, 0.0 * k)
        spread = _uniform(off, np.minimum(-2.0 * late * k, 0.0), np.maximum(-2.0 * late * k, 0.0))
        for old in (equal, spread):
            found = max(found, float(np.max(np.sum(np.logaddexp(in_time, np.log(share) + old), axis=-1))))
    return found
