"""Small operators on sampled signals, integrated exactly between samples (numba).

Every operator takes a signal ``x`` of shape (N,) on a grid whose steps are ``dt`` (N,), ``dt[i]`` leading from
sample i-1 to i (``dt[0]`` is not used), and returns a signal of the same shape and unit.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.special import gamma

Array = NDArray[np.float64]


@njit(cache=True)
def lag(x: Array, dt: Array, tau: float) -> Array:
    """First-order lag tau y' + y = x [s], exact for piecewise linear x; starts in equilibrium."""
    y = np.empty_like(x)
    y[0] = x[0]
    step, e = -1.0, 0.0
    for i in range(1, x.size):
        if dt[i] != step:
            step = dt[i]
            e = np.exp(-step / tau)
        ramp = (x[i] - x[i - 1]) * tau / step
        y[i] = x[i] - ramp + (y[i - 1] - x[i - 1] + ramp) * e
    return y


@njit(cache=True)
def uneven_lag(x: Array, dt: Array, rise: float, fall: float) -> Array:
    """First-order lag with one time constant while y rises and another while it falls [s]."""
    y = np.empty_like(x)
    y[0] = x[0]
    for i in range(1, x.size):
        tau = rise if x[i] > y[i - 1] else fall
        y[i] = x[i] + (y[i - 1] - x[i]) * np.exp(-dt[i] / tau)
    return y


@njit(cache=True)
def play(x: Array, width: float, share: float = 0.0) -> Array:
    """Rate-independent play (backlash): y stays until x is ``width + share * x`` away from it."""
    y = np.empty_like(x)
    y[0] = x[0]
    for i in range(1, x.size):
        w = width + share * x[i]
        y[i] = min(max(y[i - 1], x[i] - w), x[i] + w)
    return y


@njit(cache=True)
def bristle(x: Array, scale: float) -> Array:
    """Dahl's friction state in -1..1: it turns with the sign of dx, exponentially over the distance ``scale``."""
    z = np.zeros_like(x)
    for i in range(1, x.size):
        d = x[i] - x[i - 1]
        goal = 1.0 if d > 0 else -1.0
        z[i] = goal + (z[i - 1] - goal) * np.exp(-abs(d) / scale)
    return z


@njit(cache=True)
def sticky(x: Array, band: float, release: float) -> Array:
    """A valve that sleeps until x is off by more than ``band``, then follows until within ``release``, and sleeps."""
    y = np.empty_like(x)
    y[0] = x[0]
    awake = False
    for i in range(1, x.size):
        off = abs(x[i] - y[i - 1])
        awake = off > (release if awake else band)
        y[i] = x[i] if awake or x[i] == 0.0 else y[i - 1]
    return y


@njit(cache=True)
def running_max(x: Array) -> Array:
    """Largest value so far."""
    y = np.empty_like(x)
    y[0] = x[0]
    for i in range(1, x.size):
        y[i] = max(y[i - 1], x[i])
    return y


def spectrum(x: Array, dt: Array, taus: Array, weights: Array) -> Array:
    """Weighted sum of first-order lags of x."""
    total = np.zeros_like(x)
    for tau, w in zip(taus, weights, strict=True):
        total += w * lag(x, dt, tau)
    return total


def power_law_memory(x: Array, dt: Array, alpha: float, shortest: float = 0.02, longest: float = 2e3) -> Array:
    """Creep (t / 1 s)^alpha of x by a spectrum of nine lags; a lag below ``shortest`` [s] is instantaneous.

    t^alpha = int alpha tau^alpha (1 - exp(-t / tau)) d(ln tau) / Gamma(1 - alpha) (Schapery).
    """
    taus = np.geomspace(shortest, longest, 9)
    spacing = np.log(taus[1] / taus[0])
    instant = (shortest * np.exp(-0.5 * spacing)) ** alpha
    response: Array = (spectrum(x, dt, taus, taus**alpha * alpha * spacing) + instant * x) / float(gamma(1 - alpha))
    return response


def wander(t: Array, rng: np.random.Generator, slowest: float, fastest: float) -> Array:
    """Unit-rms random motion with a 1/f spectrum between two frequencies [Hz], a sum of twelve sines."""
    f = np.geomspace(slowest, fastest, 12)
    phases = rng.uniform(0, 2 * np.pi, f.size)
    total = sum(np.sin(2 * np.pi * fi * t + ph) for fi, ph in zip(f, phases, strict=True))
    return np.asarray(total / np.sqrt(f.size / 2))


def coarsened(x: Array, step: float, coarse: float, uneven: float, noisy: bool) -> Array:
    """Resolution: x rounded to ``step``, or to steps wider by ``coarse``, or cut to ``uneven`` ones of two sizes.

    Without noise the nominal rounding counts as noise and is left out, and a coarser one keeps only the error it adds.
    """
    wide = step + max(coarse, uneven)
    if uneven:
        cell = np.floor(x / wide)
        rounded = wide * (cell + 0.35 * (cell % 2))
    else:
        rounded = np.round(x / wide) * wide
    share = 1.0 if noisy else float(np.sqrt(1 - (step / wide) ** 2))
    return np.asarray(x + share * (rounded - x))
