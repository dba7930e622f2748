"""Kernels of the robot's axes: the closed loops with their friction, and rate-limited or drawn motion."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

SUBSTEPS = 4  # of 1.25 ms in a grid step of 5 ms
STIFFEST = 25e3  # N/m, of a bristle: stiffer ones would need shorter steps


class Loop(NamedTuple):
    """Constants of the loops: the sound ones, then those of effects (0: absent). SI units."""

    mass: float
    kp: float
    ki: float
    kd: float
    limit: float  # N, hard bound of the coil force
    soft: float  # N, soft bound
    windup: float  # with a hard bound: how fast the integral goes on (1: rises and empties; less: empties slower)
    drag: float  # N s/m
    thin: float  # N at 1 mm/s, growing as the root of speed
    stribeck: float  # N above the dry friction at standstill
    stribeck_speed: float  # m/s
    friction_law: float  # 0: Coulomb; 1: exponential Stribeck; 2: hyperbolic Stribeck; 3: bristles (Dahl)
    bristle: float  # m
    vary: float  # loss of force constant at 5 mm, quadratic
    one_sided: float  # the same, linear, on the upper side only
    heating: float  # loss of force constant for each N^2 of mean square force
    cogging: float  # N
    cog_pitch: float  # m
    binding: float  # dry friction for each newton of load
    weight: float  # N that the hard bound has to carry as well
    unfed: float  # share of the set-point's speed that is not fed forward
    unweighed: float  # share of the set-point that the proportional part does not see


@njit(cache=True)
def _coil_force(a, e, de, at, h, c, integral, warm):  # type: ignore[no-untyped-def]
    """Force [N] of axis ``a`` at ``at`` [m] for its error ``e`` [m] and speed error ``de`` [m/s]; moves its states."""
    u = c.kp * (e - c.unweighed * (e + at)) + c.ki * integral[a] + c.kd * de
    if c.soft > 0.0:
        u = c.soft * np.tanh(u / c.soft)
    held = c.limit > 0.0 and abs(u + c.weight) > c.limit
    if held:
        u = (c.limit if u + c.weight > 0 else -c.limit) - c.weight
    if not held:
        integral[a] += h * e
    elif c.windup > 0.0:
        integral[a] += h * e * (1.0 if e * u > 0.0 else c.windup)
    if c.vary > 0.0:
        u *= 1.0 - c.vary * (at / 5e-3) ** 2
    if c.one_sided > 0.0:
        u *= 1.0 - c.one_sided * max(at, 0.0) / 5e-3
    if c.heating > 0.0:
        warm[a] += h * (u * u - warm[a]) / 20.0
        u *= max(1.0 - c.heating * warm[a], 0.2)
    return u


@njit(cache=True)
def _less_friction(a, f, push, v, h, c, dry, stribeck, z):  # type: ignore[no-untyped-def]
    """Force ``f`` [N] on axis ``a`` less its dry friction under the load ``push`` [N] at the speed ``v`` [m/s].

    Friction is the force that would just stop the mass, if that is within its bound; bristles keep theirs in ``z``.
    """
    bound = dry + c.binding * abs(push)
    if c.friction_law == 1:
        bound += (c.stribeck + stribeck) * np.exp(-abs(v) / c.stribeck_speed)
    elif c.friction_law == 2:
        bound += c.stribeck / (1.0 + (v / c.stribeck_speed) ** 2)
    if c.friction_law == 3:
        goal = 1.0 if v > 0 else -1.0
        give = max(c.bristle, dry / STIFFEST)
        z[a] = goal + (z[a] - goal) * np.exp(-abs(v) * h / give)
        f -= dry * z[a]
    elif bound > 0.0:
        stop = c.mass * v / h + f
        f -= min(max(stop, -bound), bound)
    return f


@njit(cache=True)
def loops(ref, load, base, tangent, h, c, dry, one):  # type: ignore[no-untyped-def]
    """Three PID loops under a load (N, 3) [N], each a mass with its friction; returns axis positions (N, 3) [m].

    Forces are held over a substep; drag is implicit in speed, and dry friction is the force that would just stop the
    mass at the end of the substep, if that is within its bound. ``dry`` (3,) is the Coulomb friction of each axis [N],
    ``one`` (2, 3) further drag [N s/m] and Stribeck friction [N] of each. The load acts at positions ``base`` (N, 3);
    elsewhere ``tangent`` (3, 3) [N/m] corrects it.
    """
    out = np.empty_like(ref)
    q, v, integral, z = ref[0].copy(), np.zeros(3), np.zeros(3), np.zeros(3)
    warm, off = np.zeros(3), np.zeros(3)
    out[0] = q
    n, g = SUBSTEPS, tangent
    for i in range(1, ref.shape[0]):
        for j in range(n):
            w = (j + 0.5) / n
            for a in range(3):
                off[a] = q[a] - base[i - 1, a] - (base[i, a] - base[i - 1, a]) * w
            for a in range(3):
                push = load[i - 1, a] + (load[i, a] - load[i - 1, a]) * w
                push -= g[a, 0] * off[0] + g[a, 1] * off[1] + g[a, 2] * off[2]
                r = ref[i - 1, a] + (ref[i, a] - ref[i - 1, a]) * w
                vr = (ref[i, a] - ref[i - 1, a]) / (n * h)
                e = r - q[a]
                u = _coil_force(a, e, vr * (1.0 - c.unfed) - v[a], q[a], h, c, integral, warm)
                f = u + push
                drag = c.drag + one[0, a]
                if c.thin > 0.0:
                    drag += c.thin / np.sqrt(1e-3 * max(abs(v[a]), 1e-5))
                if c.cogging > 0.0:
                    f += c.cogging * np.sin(2 * np.pi * q[a] / c.cog_pitch)
                f = _less_friction(a, f, push, v[a], h, c, dry[a], one[1, a], z)
                f = (f - drag * v[a]) / (1.0 + h * drag / c.mass)
                v[a] += h * f / c.mass
                q[a] += h * v[a]
        out[i] = q
    return out


@njit(cache=True)
def limited(x, dt, rate):  # type: ignore[no-untyped-def]
    y = np.empty_like(x)
    y[0] = x[0]
    for i in range(1, x.size):
        y[i] = y[i - 1] + min(max(x[i] - y[i - 1], -rate * dt[i]), rate * dt[i])
    return y


@njit(cache=True)
def drawn_after(x, dt, width, rate, power):  # type: ignore[no-untyped-def]
    """A rest point that is drawn after x where |x - y| exceeds ``width``, at ``rate`` (over / width)^power."""
    y = np.zeros_like(x)
    for i in range(1, x.size):
        d = x[i] - y[i - 1]
        over = max(abs(d) - width, 0.0)
        step = min(rate * dt[i] * over**power, over)
        y[i] = y[i - 1] + (step if d > 0 else -step)
    return y
