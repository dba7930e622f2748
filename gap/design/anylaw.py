"""Responses of skin of any law: features of its load and of its own answer, with fading memories of both.

An elastic curve of the load and of the answer (cubic B-splines), memories before and behind it (lags from 60 ms to
200 s), for the observer who knows no law. Without ``memory`` it is a reference membrane of any elastic curve.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.interpolate import BSpline
from scipy.signal import lfilter

from sim_devices.chain import FloatArray

LAGS = np.geomspace(0.06, 200.0, 8)
"""Time constants of fading memories, s."""
KNOTS = 5
REACH = 1.25
"""Range of the splines, in sizes of the signal."""


def remembered(
    times: Sequence[FloatArray], given: Sequence[FloatArray], answers: Sequence[FloatArray], memory: bool = True
) -> Iterator[list[FloatArray]]:
    """Features, one array (n,) a recording each.

    ``times`` (n,) s, ``given`` (k, n) the load's components, ``answers`` (n,) one component of the answer, all of size
    1 in the session at hand.
    """
    components = range(len(given[0]))
    several = len(given[0]) > 1
    for c in components:
        signal = [g[c] for g in given]
        yield from _bumps(signal)
        if memory:
            for tau in LAGS:
                late = lagged(times, signal, float(tau))
                yield from ([late] if several else _bumps(late))
    if several:  # a law of the distance couples the components
        for c in components:
            bent = [g[c] * np.sum(np.square(g), axis=0) for g in given]
            yield bent
            if memory:
                for tau in LAGS[1::2]:
                    yield lagged(times, bent, float(tau))
    if memory:
        if not several:
            yield from _bumps(answers)
        for tau in LAGS:
            yield lagged(times, answers, float(tau))


def _bumps(x: Sequence[FloatArray]) -> Iterator[list[FloatArray]]:
    """Cubic B-splines of a signal, over both its signs if it has both."""
    low = -REACH if min(float(v.min()) for v in x) < -0.02 else 0.0
    high = REACH if max(float(v.max()) for v in x) > 0.02 else 0.0
    if low == high:
        return
    inner = np.linspace(low, high, KNOTS - 1)
    knots = np.r_[[low] * 3, inner, [high] * 3]
    for k in range(len(knots) - 4):
        spline = BSpline.basis_element(knots[k : k + 5], extrapolate=False)
        at_rest = float(np.nan_to_num(spline(0.0)))
        yield [np.nan_to_num(spline(np.clip(v, low, high))) - at_rest for v in x]


def lagged(times: Sequence[FloatArray], x: Sequence[FloatArray], tau: float) -> list[FloatArray]:
    """First-order lags of a signal through recordings, at rest between them."""
    out = []
    state, last = 0.0, float(times[0][0])
    for t, v in zip(times, x, strict=True):
        state *= float(np.exp(-max(t[0] - last, 0.0) / tau))
        keep = float(np.exp(-(t[1] - t[0]) / tau)) if len(t) > 1 else 0.0
        y, _ = lfilter([1.0 - keep], [1.0, -keep], v, zi=[keep * state])
        out.append(np.asarray(y))
        state, last = float(y[-1]), float(t[-1])
    return out
