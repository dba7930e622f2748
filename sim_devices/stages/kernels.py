"""Compiled laws with memory, from one time series to another: the building blocks of stages, effects and user rigs.

Every kernel has the signature ``kernel(s, t, u, p, y)``: state ``s`` (``STATE``,), zeros for rest and changed in place;
times ``t`` (n,) s, strictly increasing, of any spacing; input ``u`` (n,), piecewise linear between samples; parameters
``p``; output ``y`` (n,). Calls join without a seam. Linear memory is integrated exactly (first-order hold), so that the
step hardly matters; rate-independent laws are exact for inputs that are monotone within a step. Before the first sample
the input was zero.

>>> import numpy as np
>>> t = np.array([0.0, 1e-9, 1.0])
>>> evaluate(low_pass, t, np.array([0.0, 1.0, 1.0]), 0.5).round(4).tolist()
[0.0, 0.0, 0.8647]
"""

from __future__ import annotations

import math
from collections.abc import Callable

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
SAME = 1e-9
"""Relative difference below which two steps are of one length."""


def evaluate(kernel: Kernel, time: FloatArray, signal: FloatArray, *parameters: float) -> FloatArray:
    """Output of ``kernel`` from rest, shape (n,), for ``signal`` (n,) on ``time`` (n,) s."""
    out = np.empty(len(time))
    u = np.ascontiguousarray(signal, dtype=float)
    kernel(np.zeros(STATE), np.ascontiguousarray(time, dtype=float), u, np.array(parameters, dtype=float), out)
    return out


@njit(cache=True)
def hold_weights(dt: float, tau: float) -> tuple[float, float, float]:
    """Weights (e, a, b) of y1 = e y0 + a u0 + b u1, the exact step of tau y' = u - y for u linear in between."""
    if tau <= 0.0:
        return 0.0, 0.0, 1.0
    x = dt / tau
    e = math.exp(-x)
    f = (1.0 - e) / x if x > 1e-4 else 1.0 - x * (0.5 - x / 6.0)
    return e, f - e, 1.0 - f


@njit(cache=True)
def place(dt: float) -> int:
    """Where among ``STEPS`` the weights of a step of ``dt`` s are kept: a grid has few lengths of steps, in any order,
    and their exponentials are most of a kernel's work."""
    return ((int(dt * 1e6 + 0.5) * 40503) >> 4) & (STEPS - 1)  # whole milliseconds are spread as well


@njit(cache=True)
def hash_uniform(seed: float, index: float) -> float:
    """A number in [0, 1) that depends on seed and index only: the same whatever the chunks (splitmix64)."""
    z = np.uint64(np.int64(seed)) * np.uint64(0x9E3779B97F4A7C15) + np.uint64(np.int64(index)) * np.uint64(
        0xBF58476D1CE4E5B9
    )
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    return float(z >> np.uint64(11)) / 9007199254740992.0


@njit(cache=True)
def low_pass(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """First-order lag, tau y' = u - y. ``p`` = (tau s,)."""
    if s[0] == 0.0 and t.size:
        s[0], s[1], s[2] = 1.0, t[0], u[0]
    last, e, a, b = -1.0, 1.0, 0.0, 0.0
    for i in range(t.size):
        dt = t[i] - s[1]
        if abs(dt - last) > 1e-9 * last:
            e, a, b = hold_weights(dt, p[0])
            last = dt
        s[3] = e * s[3] + a * s[2] + b * u[i] if dt > 0.0 or p[0] <= 0.0 else s[3]
        s[1], s[2] = t[i], u[i]
        y[i] = s[3]


@njit(cache=True)
def uneven_low_pass(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """First-order lag that rises within one time and falls within another. ``p`` = (tau up, tau down), s; from 0."""
    if s[0] == 0.0 and t.size:
        s[0], s[1], s[2] = 1.0, t[0], u[0]
    for i in range(t.size):
        e, a, b = hold_weights(t[i] - s[1], p[0] if 0.5 * (s[2] + u[i]) > s[3] else p[1])
        s[3] = e * s[3] + a * s[2] + b * u[i]
        s[1], s[2] = t[i], u[i]
        y[i] = s[3]


@njit(cache=True)
def oscillation(dt: float, w: float, z: float) -> tuple[float, float, float, float]:
    """Matrix (by rows) that takes (y, y') of y'' + 2 z w y' + w² y = 0 over ``dt`` s."""
    d2 = w * w * (z * z - 1.0)
    d = math.sqrt(abs(d2))
    if d * dt < 1e-6:
        c = math.exp(-z * w * dt)
        q = dt * c
    elif d2 > 0.0:
        slow, fast = math.exp((d - z * w) * dt), math.exp(-(d + z * w) * dt)
        c, q = 0.5 * (slow + fast), 0.5 * (slow - fast) / d
    else:
        decay = math.exp(-z * w * dt)
        c, q = decay * math.cos(d * dt), decay * math.sin(d * dt) / d
    return c + z * w * q, q, -w * w * q, c - z * w * q


@njit(cache=True)
def second_order(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """Second-order lag, tau² y'' + 2 zeta tau y' + y = u. ``p`` = (tau s, zeta)."""
    if s[0] == 0.0 and t.size:
        s[0], s[1], s[2] = 1.0, t[0], u[0]
    w, z = 1.0 / max(p[0], 1e-9), p[1]
    last, e = -1.0, (1.0, 0.0, 0.0, 1.0)
    for i in range(t.size):
        dt = t[i] - s[1]
        if dt * w > 1e-7:
            if abs(dt - last) > 1e-9 * last:
                last, e = dt, oscillation(dt, w, z)
            rate = (u[i] - s[2]) / dt
            lag = rate * 2.0 * z / w  # a ramp is followed this far behind
            x, v = s[3] - (s[2] - lag), s[4] - rate
            s[3] = u[i] - lag + e[0] * x + e[1] * v
            s[4] = rate + e[2] * x + e[3] * v
        else:
            s[3] += s[4] * dt
        s[1], s[2] = t[i], u[i]
        y[i] = s[3]


@njit(cache=True)
def hurried(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """Second-order lag whose own rate is limited: tau² y'' + 2 zeta tau y' + y = u, -down <= y' <= up.

    ``p`` = (tau s, zeta, up 1/s, down 1/s). Exact while it is free; the limit acts at the ends of eighths of tau.
    """
    if s[0] == 0.0 and t.size:
        s[0], s[1], s[2] = 1.0, t[0], u[0]
    w, z = 1.0 / max(p[0], 1e-9), p[1]
    last, e = -1.0, (1.0, 0.0, 0.0, 1.0)
    for i in range(t.size):
        dt = t[i] - s[1]
        parts = min(max(math.ceil(8.0 * dt * w), 1), 256)
        h = dt / parts
        if h * w > 1e-7:
            if abs(h - last) > 1e-9 * last:
                last, e = h, oscillation(h, w, z)
            rate = (u[i] - s[2]) / dt
            lag = rate * 2.0 * z / w
            for k in range(parts):
                before = s[2] + k / parts * (u[i] - s[2])
                x, v = s[3] - (before - lag), s[4] - rate
                free = rate + e[2] * x + e[3] * v
                held = min(max(free, -p[3]), p[2])
                if free == held:
                    s[3] = before + rate * h - lag + e[0] * x + e[1] * v
                else:
                    s[3] += 0.5 * (s[4] + held) * h
                s[4] = held
        else:
            s[3] += s[4] * dt
        s[1], s[2] = t[i], u[i]
        y[i] = s[3]


@njit(cache=True)
def lead(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """What moves is exaggerated: y = u + a (u - lag of u). ``p`` = (a, tau s)."""
    low_pass(s, t, u, p[1:2], y)
    for i in range(t.size):
        y[i] = u[i] + p[0] * (u[i] - y[i])


@njit(cache=True)
def prony(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """Linear memory, y = g0 u + sum g_i lag(u, tau_i).

    ``p`` = (g0, g1, tau1 s, g2, tau2 s, ...), at most ``TERMS`` pairs.
    """
    if s[0] == 0.0 and t.size:
        s[0], s[1], s[2] = 1.0, t[0], u[0]
    n = (p.size - 1) // 2
    last, before, lagged = s[1], s[2], s[3 : 3 + n].copy()
    known, e, a, b = np.zeros(STEPS), np.empty((STEPS, n)), np.empty((STEPS, n)), np.empty((STEPS, n))
    for i in range(t.size):
        dt, now = t[i] - last, u[i]
        if dt > 0.0:
            j = place(dt)
            if abs(dt - known[j]) > SAME * dt:
                known[j] = dt
                for k in range(n):
                    e[j, k], a[j, k], b[j, k] = hold_weights(dt, p[2 + 2 * k])
            for k in range(n):
                lagged[k] = e[j, k] * lagged[k] + a[j, k] * before + b[j, k] * now
        out = p[0] * now
        for k in range(n):
            out += p[1 + 2 * k] * lagged[k]
        last, before, y[i] = t[i], now, out
    s[1], s[2], s[3 : 3 + n] = last, before, lagged


@njit(cache=True)
def rate_limit(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """Slew limit. ``p`` = (fastest rise, fastest fall), both positive, in the signal's unit per second."""
    if s[0] == 0.0 and t.size:
        s[0], s[1] = 1.0, t[0]
    for i in range(t.size):
        dt = t[i] - s[1]
        s[3] = min(max(u[i], s[3] - p[1] * dt), s[3] + p[0] * dt)
        s[1] = t[i]
        y[i] = s[3]


@njit(cache=True)
def play(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """Backlash, also Coulomb friction behind a spring: y moves only when |u - y| reaches ``p`` = (half width,)."""
    for i in range(t.size):
        s[3] = min(max(s[3], u[i] - p[0]), u[i] + p[0])
        y[i] = s[3]


@njit(cache=True)
def soft_play(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """Backlash taken up gradually (Dahl): u - y nears ±``p`` = (half width,) exponentially over that distance."""
    half = max(p[0], 1e-300)
    for i in range(t.size):
        du = u[i] - s[2]
        edge = p[0] if du > 0.0 else -p[0]
        s[3] = edge + (s[3] - edge) * math.exp(-abs(du) / half)
        s[2] = u[i]
        y[i] = u[i] - s[3]


@njit(cache=True)
def play_within(s: FloatArray, u: FloatArray, width: FloatArray, soft: float, y: FloatArray) -> None:
    """``play`` whose half ``width`` (n,) changes, as dry friction does with the normal load.

    ``soft`` > 0.5: y approaches the edge exponentially over a distance of one half width (Dahl) instead of being
    carried by it.
    """
    for i in range(u.size):
        w = width[i]
        if soft > 0.5:
            du = u[i] - s[2]
            edge = w if du > 0.0 else -w
            lag = edge + (s[4] - edge) * math.exp(-abs(du) / max(w, 1e-300))
            s[4] = min(max(lag, -w), w)
            s[3] = u[i] - s[4]
        else:
            s[3] = min(max(s[3], u[i] - w), u[i] + w)
        s[2] = u[i]
        y[i] = s[3]


@njit(cache=True)
def slipping(s: FloatArray, u: FloatArray, reach: float, share: float, out: FloatArray) -> None:
    """Play in k directions at once: point s (k,) is carried along at a distance ``reach`` of u (k, n).

    ``out`` = u - share s. As friction with kinematic hardening: ``share`` of the displacement beyond ``reach`` is slip.
    """
    for i in range(u.shape[1]):
        far = 0.0
        for k in range(s.size):
            far += (u[k, i] - s[k]) ** 2
        far = math.sqrt(far)
        for k in range(s.size):
            if far > reach:
                s[k] += (far - reach) / far * (u[k, i] - s[k])
            out[k, i] = u[k, i] - share * s[k]


@njit(cache=True)
def sticking(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """A controller that rests until its error exceeds ``p`` = (half band,), then corrects it wholly."""
    for i in range(t.size):
        if abs(u[i] - s[3]) > p[0]:
            s[3] = u[i]
        y[i] = s[3]


@njit(cache=True)
def prandtl(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """Prandtl–Ishlinskii hysteresis, a sum of stops each within ±w_i.

    ``p`` = (r1, w1, r2, w2, ...), r_i half widths of u.
    """
    for i in range(t.size):
        y[i] = 0.0
        for k in range(p.size // 2):
            r = max(p[2 * k], 1e-300)
            s[3 + k] = min(max(s[3 + k], u[i] - r), u[i] + r)
            y[i] += p[2 * k + 1] * (u[i] - s[3 + k]) / r


@njit(cache=True)
def bouc_wen(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """Bouc–Wen hysteresis within ±a: dz = (1 - |z|^n (1 + sign(z du))/2) du/d, y = a z. ``p`` = (a, d, n >= 1).

    Wen 1976. Reversals unload along the initial slope a/d. Reduces to ``dahl``-like saturation for n = 1 in loading.
    """
    for i in range(t.size):
        du = (u[i] - s[2]) / max(p[1], 1e-300)
        if p[2] == 2.0:  # back along the initial slope, then a hyperbolic tangent
            way = 1.0 if du > 0.0 else -1.0
            z = way * s[3]
            back = min(max(-z, 0.0), way * du)
            z += back
            if way * du > back:
                z = math.tanh(math.atanh(min(z, 1.0 - 1e-15)) + way * du - back)
            s[3] = way * z
        else:
            steps = int(min(math.ceil(abs(du) * 8.0), 256.0))
            for _ in range(steps):
                h = du / steps
                z = s[3]
                for stage in range(2):  # midpoint rule
                    back = 1.0 if z * h > 0.0 else 0.0
                    slope = 1.0 - back * abs(z) ** p[2]
                    z = s[3] + slope * h * (0.5 if stage == 0 else 1.0)
                s[3] = min(max(z, -1.0), 1.0)
        s[2] = u[i]
        y[i] = p[0] * s[3]


@njit(cache=True)
def friction(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """Friction force of a contact at position u: Coulomb, Stribeck, Dahl and LuGre's steady part in one.

    F' = (sign(v) g(v) - F) |v| / d, g(v) = Fc + (Fs - Fc) exp(-(v/vs)²), y = F + c v. ``p`` = (Fc N, Fs N, vs m/s, d m,
    c N s/m); d is the presliding distance (0: Coulomb). Canudas de Wit et al. 1995; exact for constant v in a step.
    """
    if s[0] == 0.0 and t.size:
        s[0], s[1], s[2] = 1.0, t[0], u[0]
    for i in range(t.size):
        du, dt = u[i] - s[2], t[i] - s[1]
        v = du / dt if dt > 0.0 else 0.0
        if du != 0.0:
            ratio = v / max(p[2], 1e-12)
            level = p[0] + (p[1] - p[0]) * math.exp(-ratio * ratio)
            level = level if du > 0.0 else -level
            s[3] = level + (s[3] - level) * (math.exp(-abs(du) / p[3]) if p[3] > 0.0 else 0.0)
        s[1], s[2] = t[i], u[i]
        y[i] = s[3] + p[4] * v


@njit(cache=True)
def exposure_gain(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """A gain that load builds up and rest restores: y = u (1 + a w), w -> |u|/ref within tau_up, back within tau_down.

    ``p`` = (a, ref, tau_up s, tau_down s). Emptying stores (a < 0), softening by loading (a > 0).
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
            w = mean + (w - mean) * (up[j] if mean > w else down[j])
        last, before, y[i] = t[i], now, u[i] * (1.0 + p[0] * w)
    s[1], s[2], s[3] = last, before, w


@njit(cache=True)
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


@njit(cache=True)
def yield_flow(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """Slow flow under load that comes back slower: y = u + r, r -> k (u - y0)+ within tau_up, back within tau_down.

    ``p`` = (k, y0, tau_up s, tau_down s); odd in u.
    """
    if s[0] == 0.0 and t.size:
        s[0], s[1], s[2] = 1.0, t[0], u[0]
    last, before, r = s[1], s[2], s[3]
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


@njit(cache=True)
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


@njit(cache=True)
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


@njit(cache=True)
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


@njit(cache=True)
def slope_so_far(s: FloatArray, now: float, value: float) -> float:
    """The slope of a signal since its value before, which the state ``s`` (0 … 3) keeps."""
    if s[0] == 0.0:
        s[0], s[1], s[2] = 1.0, now, value
    if now - s[1] > 1e-6:
        s[3] = (value - s[2]) / (now - s[1])
        s[1], s[2] = now, value
    return float(s[3])


@njit(cache=True)
def late_by_any(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """Samples at stamps k T of which some are old: with probability q, y = u - u' d_k, d_k uniform up to 2 d.

    ``p`` = (T s, q, seed, d s).
    """
    for i in range(t.size):
        chance = hash_uniform(p[2], math.floor(t[i] / p[0] + 1e-6)) / p[1]  # below 1: late, by so much of the most
        y[i] = u[i] - slope_so_far(s, t[i], u[i]) * (2.0 * p[3] * chance if chance < 1.0 else 0.0)


@njit(cache=True)
def jittered(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """Sampling instants that scatter about the stamps k T: y = u + u' d_k, d_k uniform, rms sigma.

    ``p`` = (T s, sigma s, seed).
    """
    for i in range(t.size):
        shift = (2.0 * hash_uniform(p[2], math.floor(t[i] / p[0] + 1e-6)) - 1.0) * math.sqrt(3.0) * p[1]
        y[i] = u[i] + slope_so_far(s, t[i], u[i]) * shift
