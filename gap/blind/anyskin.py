"""Responses that skin of any law could have, for the observer who knows nothing of it (delta_free).

Suction: any elastic curve (splines of pressure and of height), fading memories before and behind it (lags from 60 ms
to 200 s). Robot: the same of each component of the displacement and the force. Zero and gain of each recording.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.interpolate import BSpline

from .session import Session
from .signals import Array, lag

LAGS = np.geomspace(0.06, 200.0, 9)
KNOTS = 6
Channels = dict[str, list[Array]]


def _bumps(x: list[Array]) -> list[list[Array]]:
    """Cubic B-splines over the range of a signal that comes in recordings, one signal each."""
    low, high = min(float(v.min()) for v in x), max(float(v.max()) for v in x)
    if high - low < 1e-12 * max(abs(high), abs(low), 1e-300) or high == low:
        return []
    inner = np.linspace(low, high, KNOTS - 2)
    knots = np.r_[[low] * 3, inner, [high] * 3]
    out = []
    for k in range(len(knots) - 4):
        spline = BSpline.basis_element(knots[k : k + 5], extrapolate=False)
        out.append([np.nan_to_num(spline(v)) for v in x])
    return out


def _remembered(s: Session, x: list[Array], on_skin: list[bool]) -> Iterator[list[Array]]:
    """Lags of a signal through the whole session, at rest between recordings and on other specimens."""
    times = [s.stamps(k) for k in range(len(x))]
    joined, steps = list[Array](), list[Array]()
    last = times[0][0] - 10.0
    for t, v, skin in zip(times, x, on_skin, strict=True):
        joined += [np.zeros(2), v if skin else np.zeros_like(v), np.zeros(1)]
        steps += [np.array([max(t[0] - last - 0.01, 0.01), 0.01]), np.diff(t, prepend=t[0] - 0.01), np.array([0.01])]
        last = t[-1]
    signal, dt = np.concatenate(joined), np.maximum(np.concatenate(steps), 1e-4)
    ends = np.cumsum([2 + len(v) + 1 for v in x])
    for tau in LAGS:
        y = lag(signal, dt, float(tau))
        yield [y[e - 1 - len(v) : e - 1] for e, v in zip(ends, x, strict=True)]


def responses(s: Session, nominal: Channels, answers: list[str]) -> Iterator[Channels]:
    """Changes by skin of another law that may be added to the channels ``answers``, one set of channels
    after another."""
    on_skin = [r.specimen == "skin" for r in s.recordings]
    robot = s.instrument == "microrobot"
    sources = [f"probe_{a}" for a in "xyz"] if robot else ["pressure"]
    features: list[list[Array]] = []
    for name in sources:
        features += _bumps(nominal[name])
        for remembered in _remembered(s, nominal[name], on_skin):
            features += [remembered] if robot else _bumps(remembered)
    for name in answers:
        own = nominal[name]
        for feature in features + ([] if robot else _bumps(own)) + list(_remembered(s, own, on_skin)):
            yield {name: [f * float(skin) for f, skin in zip(feature, on_skin, strict=True)]}
        for k in range(len(own)):
            for part in (np.ones_like(own[k]), own[k] * float(on_skin[k])):
                yield {name: [part if i == k else np.zeros_like(x) for i, x in enumerate(own)]}
