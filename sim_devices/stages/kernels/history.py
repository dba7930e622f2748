"""Kernels that earlier load has changed: stores that empty, softening, flow."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from sim_devices.stages.kernels.base import SAME, STEPS, FloatArray, place

SLOWEST_PACE = 1e-3
"""Of `exposed`, without a load."""


@njit(cache=True, error_model="numpy")
def exposed(w: float, q: float, end: float, rises: float, falls: float) -> float:
    """Exposure after a step under a load ``q``, from ``w`` on: w' = (q - w (1 + end (q - 1))) / T, which comes to q at
    ``end`` 0, and at 1 to no more than 1, the sooner the larger q; or it goes back. ``rises`` or ``falls`` is the share
    of the way that is left after the step."""
    pace = max(1.0 + end * (q - 1.0), SLOWEST_PACE)
    goal = q / pace
    if goal > w:
        return goal + (w - goal) * (rises if pace == 1.0 else rises**pace)
    return goal + (w - goal) * falls


@njit(cache=True, error_model="numpy")
def exposure_gain(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """A gain that load builds up and rest restores: y = u (1 + a w), w -> |u|/ref within tau_up, back within tau_down.

    ``p`` = (a, ref, tau_up s, tau_down s, end as of `exposed`). Emptying stores (a < 0), softening by loading (a > 0).
    """
    if s[0] == 0.0 and t.size:
        s[0], s[1], s[2] = 1.0, t[0], abs(u[0])
    last, before, w = s[1], s[2], s[3]
    known, up, down = np.zeros(STEPS), np.empty(STEPS), np.empty(STEPS)
    for i in range(t.size):
        now, dt = abs(u[i]), t[i] - last
        mean = 0.5 * (before + now) / p[1]
        if dt > 0.0:
            j = place(dt)
            if abs(dt - known[j]) > SAME * dt:
                known[j], up[j], down[j] = dt, math.exp(-dt / p[2]), math.exp(-dt / p[3])
            w = exposed(w, mean, p[4], up[j], down[j])
        last, before, y[i] = t[i], now, u[i] * (1.0 + p[0] * w)
    s[1], s[2], s[3] = last, before, w


@njit(cache=True, error_model="numpy")
def sealing(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """A leak that closes once suction draws its edges together, and opens again without: y = u (1 - a w), w' = -w/tau
    while |u| is above ``least``, else w = 1. ``p`` = (a, tau s, least)."""
    if s[0] == 0.0 and t.size:
        s[0], s[1], s[2], s[3] = 1.0, t[0], abs(u[0]), 1.0
    for i in range(t.size):
        now, dt = abs(u[i]), t[i] - s[1]
        if now <= p[2]:
            s[3] = 1.0
        elif s[2] <= p[2]:  # closes from when suction passed ``least``
            s[3] = math.exp(-dt * (now - p[2]) / (now - s[2]) / p[1])
        else:
            s[3] *= math.exp(-dt / p[1])
        s[1], s[2] = t[i], now
        y[i] = u[i] * (1.0 - p[0] * s[3])


@njit(cache=True, error_model="numpy")
def emptying_store(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """A store that runs empty: y = u (1 - a (E - 1)+), where E' = (|u| - kept) / (ref tau) while a pump, which alone
    keeps ``kept``, cannot follow, and E falls back to 0 within tau_back while it can.

    ``p`` = (a, ref, kept, tau s, tau_back s).
    """
    if s[0] == 0.0 and t.size:
        s[0], s[1], s[2] = 1.0, t[0], abs(u[0])
    for i in range(t.size):
        now, dt = abs(u[i]), t[i] - s[1]
        missing = 0.5 * (s[2] + now) - p[2]
        s[3] = s[3] + missing * dt / (p[1] * p[3]) if missing > 0.0 else s[3] * math.exp(-dt / p[4])
        s[1], s[2] = t[i], now
        y[i] = u[i] * (1.0 - min(p[0] * max(s[3] - 1.0, 0.0), 1.0))


@njit(cache=True, error_model="numpy")
def _through_a_valve(u: float, has: float, soft: float) -> float:
    """Suction, negative, of a store that ``has`` so much and is asked for ``u``; at most none, of an empty store."""
    apart = abs(has + u)
    short = soft * math.log1p(math.exp(-apart / soft)) if apart < 30.0 * soft else 0.0
    return min(max(u, -has) + short, 0.0) if u < 0.0 else u


@njit(cache=True, error_model="numpy")
def limited_store(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """A store that suction cannot exceed: y = max(u, -c S). Growth of |y| takes the share a/ref of it, a bleed b |y| dt
    as much, and it fills up again, S -> 1 within tau. Suction is negative. Through a valve suction falls short before
    the store does: by w ln(1 + exp(-|c S + u|/w)), and to nought at most.

    ``p`` = (a, ref, c, b 1/s, tau s, w).
    """
    if s[0] == 0.0 and t.size:
        s[0], s[1], s[2], s[3] = 1.0, t[0], u[0], 1.0
    for i in range(t.size):
        dt = t[i] - s[1]
        full = 1.0 - (1.0 - s[3]) * math.exp(-dt / p[4])
        now = _through_a_valve(u[i], p[2] * full, p[5])
        drawn = max(s[2] - now, 0.0) + p[3] * max(-0.5 * (now + s[2]), 0.0) * dt
        s[3] = max(full - p[0] * drawn / p[1], 0.0)
        s[1], s[2] = t[i], _through_a_valve(u[i], p[2] * s[3], p[5])
        y[i] = s[2]


@njit(cache=True, error_model="numpy")
def sagging_store(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """Suction that sags by what its store lacks: y = u (1 - e), of which growth of |u| takes a share c/ref, and a bleed
    b |u| dt as much, and which fills up again, e -> 0 within tau. Suction is negative.

    ``p`` = (c, ref, b 1/s, tau s).
    """
    if s[0] == 0.0 and t.size:
        s[0], s[1], s[2] = 1.0, t[0], abs(u[0])
    for i in range(t.size):
        now, dt = abs(u[i]), t[i] - s[1]
        drawn = max(now - s[2], 0.0) + 0.5 * p[2] * (now + s[2]) * dt
        s[3] = s[3] * math.exp(-dt / p[3]) + p[0] * drawn / p[1]
        s[1], s[2] = t[i], now
        y[i] = u[i] * max(1.0 - s[3], 0.0)


@njit(cache=True, error_model="numpy")
def yield_flow(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """Slow flow under load that comes back slower: y = u + r, r -> k (u - y0)+ within tau_up, back within tau_down.

    ``p`` = (k, y0, tau_up s, tau_down s); odd in u.
    """
    if s[0] == 0.0 and t.size:
        s[0], s[1], s[2] = 1.0, t[0], u[0]
    last, before, r = s[1], s[2], s[3]
    if p[0] == 0.0 and r == 0.0 and t.size:  # nothing flows
        s[1], s[2] = t[-1], u[-1]
        y[:] = u
        return
    known, up, down = np.zeros(STEPS), np.empty(STEPS), np.empty(STEPS)
    for i in range(t.size):
        dt, mean = t[i] - last, 0.5 * (before + u[i])
        goal = p[0] * math.copysign(max(abs(mean) - p[1], 0.0), mean)
        if dt > 0.0:
            j = place(dt)
            if abs(dt - known[j]) > SAME * dt:
                known[j], up[j], down[j] = dt, math.exp(-dt / p[2]), math.exp(-dt / p[3])
            r = goal + (r - goal) * (up[j] if abs(goal) > abs(r) else down[j])
        last, before, y[i] = t[i], u[i], u[i] + r
    s[1], s[2], s[3] = last, before, r


@njit(cache=True, error_model="numpy")
def mullins(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """Softening by the greatest load so far: y = u (1 + a (1 - |u|/m)), m the maximum, forgotten within tau.

    ``p`` = (a, tau s).
    """
    if s[0] == 0.0 and t.size:
        s[0], s[1] = 1.0, t[0]
    for i in range(t.size):
        now = abs(u[i])
        s[3] = max(s[3] * math.exp(-(t[i] - s[1]) / p[1]), now)
        s[1] = t[i]
        y[i] = u[i] * (1.0 + p[0] * (1.0 - now / s[3])) if s[3] > 0.0 else u[i]


@njit(cache=True, error_model="numpy")
def worked_off(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """Softening by work alone: y = u (1 + a (1 - exp(-w/W))), w the integral of |u|.

    ``p`` = (a, W).
    """
    if s[0] == 0.0 and t.size:
        s[0], s[1], s[2] = 1.0, t[0], abs(u[0])
    for i in range(t.size):
        now = abs(u[i])
        s[3] += 0.5 * (now + s[2]) * (t[i] - s[1])
        s[1], s[2] = t[i], now
        y[i] = u[i] * (1.0 + p[0] * (1.0 - math.exp(-s[3] / p[1])))


@njit(cache=True, error_model="numpy")
def worked(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """Softening by work and off the virgin path: y = u (1 + a (v erf((1 - |u|/m)/b) + (1 - v) (1 - exp(-w/W)))), m the
    maximum so far, w the integral of |u|.

    ``p`` = (a, v, b, W). The first part is Ogden and Roxburgh's (Proc. R. Soc. A 455, 2861, 1999), of |u| in place of
    the energy; the second goes on with every loading.
    """
    if s[0] == 0.0 and t.size:
        s[0], s[1] = 1.0, t[0]
    for i in range(t.size):
        now = abs(u[i])
        s[2] += now * (t[i] - s[1])
        s[3] = max(s[3], now)
        s[1] = t[i]
        off = math.erf((1.0 - now / s[3]) / p[2]) if s[3] > 0.0 else 0.0
        y[i] = u[i] * (1.0 + p[0] * (p[1] * off - (1.0 - p[1]) * math.expm1(-s[2] / p[3])))


@njit(cache=True, error_model="numpy")
def by_loadings(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """A gain that changes with every loading that is over: y = u (1 + a (1 - exp(-n/N))), n their number.

    A loading begins at two fifths of the greatest load so far and ends at a quarter. ``p`` = (a, N).
    """
    for i in range(t.size):
        now = abs(u[i])
        s[1] = max(s[1], now)
        if s[0] == 0.0 and now > 0.4 * s[1]:
            s[0] = 1.0
        elif s[0] == 1.0 and now < 0.25 * s[1]:
            s[0] = 0.0
            s[2] += 1.0
        y[i] = u[i] * (1.0 - p[0] * math.expm1(-s[2] / p[1]))
