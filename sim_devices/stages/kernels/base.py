"""The shape of a kernel, and parts that kernels share: exact weights of a step, where they are kept, random numbers."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Kernel = Callable[[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray], None]

STATE = 64
"""Length of a kernel's state: [0] started, [1] last time, [2] last input, [3:] its own."""
TERMS = (STATE - 3) // 2
"""How many terms ``prony`` and ``prandtl`` can have at most."""
STEPS = 512
"""Lengths of steps of which a kernel keeps the weights."""
QUICKEST_LAG = 1e-3
"""s: a lag that is stepped in parts of itself counts as so quick where it is quicker. No sampled pressure tells them
apart, and a fit that tries a shorter one is not to take minutes."""
SAME = 1e-9
"""Relative difference below which two steps are of one length."""


def evaluate(kernel: Kernel, time: FloatArray, signal: FloatArray, *parameters: float) -> FloatArray:
    """Output of ``kernel`` from rest, shape (n,), for ``signal`` (n,) on ``time`` (n,) s."""
    out = np.empty(len(time))
    u = np.ascontiguousarray(signal, dtype=float)
    kernel(np.zeros(STATE), np.ascontiguousarray(time, dtype=float), u, np.array(parameters, dtype=float), out)
    return out


def anew(
    kernel: Kernel,
    s: FloatArray,
    t: FloatArray,
    u: FloatArray,
    p: FloatArray,
    marks: Sequence[float],
    forgotten: slice = slice(None),
) -> FloatArray:
    """Output (n,) of a ``kernel`` that begins anew at each of ``marks`` (s) that its state ``s`` has not seen yet: the
    ``forgotten`` part of the state is zero from there."""
    out, begin, last = np.empty(len(t)), 0, s[1] if s[0] else -np.inf
    for end in (*np.searchsorted(t, [mark for mark in marks if mark > last]).tolist(), len(t)):
        kernel(s, t[begin:end], u[begin:end], p, out[begin:end])
        if end < len(t):
            s[forgotten] = 0.0
        begin = end
    return out


@njit(cache=True, error_model="numpy")
def hold_weights(dt: float, tau: float) -> tuple[float, float, float]:
    """Weights (e, a, b) of y1 = e y0 + a u0 + b u1, the exact step of tau y' = u - y for u linear in between."""
    if tau <= 0.0:
        return 0.0, 0.0, 1.0
    x = dt / tau
    e = math.exp(-x)
    f = (1.0 - e) / x if x > 1e-4 else 1.0 - x * (0.5 - x / 6.0)
    return e, f - e, 1.0 - f


@njit(cache=True, error_model="numpy")
def place(dt: float) -> int:
    """Where among ``STEPS`` the weights of a step of ``dt`` s are kept: a grid has few lengths of steps, in any order,
    and their exponentials are most of a kernel's work."""
    return ((int(dt * 1e6 + 0.5) * 40503) >> 4) & (STEPS - 1)  # whole milliseconds are spread as well


@njit(cache=True, error_model="numpy")
def hash_uniform(seed: float, index: float) -> float:
    """A number in [0, 1) that depends on seed and index only: the same whatever the chunks (splitmix64)."""
    z = np.uint64(np.int64(seed)) * np.uint64(0x9E3779B97F4A7C15) + np.uint64(np.int64(index)) * np.uint64(
        0xBF58476D1CE4E5B9
    )
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    return float(z >> np.uint64(11)) / 9007199254740992.0
