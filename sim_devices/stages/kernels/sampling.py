"""Kernels of what happens by chance: samples that are lost, late or taken at scattered instants, and a reading that
walks at random."""

from __future__ import annotations

import math

from numba import njit

from sim_devices.stages.kernels.base import FloatArray, hash_uniform


@njit(cache=True, error_model="numpy")
def faulty_samples(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """Late or lost samples at stamps k T: with probability q the one before is delivered. ``p`` = (T s, q, seed, lost).

    lost = 0: late, the true value of the stamp before; lost = 1: lost, the value last delivered is repeated.
    """
    for i in range(t.size):
        k = math.floor(t[i] / p[0] + 1e-6)
        if s[0] == 0.0 or k != s[3]:
            s[5], s[4] = s[4], u[i]  # true values at the last stamp and at this one
            s[7] = 1.0 if hash_uniform(p[2], k) < p[1] and s[0] != 0.0 else 0.0
            s[6] = s[6] if s[7] == 1.0 else u[i]  # last delivered
            s[0], s[3] = 1.0, k
        y[i] = u[i] if s[7] == 0.0 else (s[6] if p[3] >= 0.5 else s[5])


@njit(cache=True, error_model="numpy")
def slope_so_far(s: FloatArray, now: float, value: float) -> float:
    """The slope of a signal since its value before, which the state ``s`` (0 … 3) keeps."""
    if s[0] == 0.0:
        s[0], s[1], s[2] = 1.0, now, value
    if now - s[1] > 1e-6:
        s[3] = (value - s[2]) / (now - s[1])
        s[1], s[2] = now, value
    return float(s[3])


@njit(cache=True, error_model="numpy")
def late_by_any(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """Samples at stamps k T of which some are old: with probability q, y = u - u' d_k, d_k uniform up to 2 d.

    ``p`` = (T s, q, seed, d s).
    """
    for i in range(t.size):
        chance = hash_uniform(p[2], math.floor(t[i] / p[0] + 1e-6)) / p[1]  # below 1: late, by so much of the most
        y[i] = u[i] - slope_so_far(s, t[i], u[i]) * (2.0 * p[3] * chance if chance < 1.0 else 0.0)


@njit(cache=True, error_model="numpy")
def jittered(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """Sampling instants that scatter about the stamps k T: y = u + u' d_k, d_k uniform, rms sigma.

    ``p`` = (T s, sigma s, seed).
    """
    for i in range(t.size):
        shift = (2.0 * hash_uniform(p[2], math.floor(t[i] / p[0] + 1e-6)) - 1.0) * math.sqrt(3.0) * p[1]
        y[i] = u[i] + slope_so_far(s, t[i], u[i]) * shift


STRIDE = 0.05
"""s between the steps of a random walk."""


@njit(cache=True, error_model="numpy")
def random_walk(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """A reading that walks at random: y = u + W(t), W of rms r √(t / s), drawn by a seed. ``p`` = (r, seed).

    W goes straight on between steps at k `STRIDE`, each a uniform draw.
    """
    size = p[0] * math.sqrt(3.0 * STRIDE)
    for i in range(t.size):
        k = math.floor(t[i] / STRIDE)
        if s[0] == 0.0:
            s[0], s[1] = 1.0, k
        while s[1] < k:
            s[2] += size * (2.0 * hash_uniform(p[1], s[1]) - 1.0)
            s[1] += 1.0
        y[i] = u[i] + s[2] + size * (2.0 * hash_uniform(p[1], s[1]) - 1.0) * (t[i] / STRIDE - k)
