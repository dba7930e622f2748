"""Kernels that follow their input late: lags, resonance, limits of rate, linear memory."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from sim_devices.stages.kernels.base import QUICKEST_LAG, SAME, STEPS, FloatArray, hold_weights, place


@njit(cache=True, error_model="numpy")
def low_pass(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """First-order lag, tau y' = u - y. ``p`` = (tau s,)."""
    if s[0] == 0.0 and t.size:
        s[0], s[1], s[2] = 1.0, t[0], u[0]
    last, before, lagged = s[1], s[2], s[3]
    known, e, a, b = np.zeros(STEPS), np.empty(STEPS), np.empty(STEPS), np.empty(STEPS)
    for i in range(t.size):
        dt = t[i] - last
        if dt > 0.0:
            j = place(dt)
            if abs(dt - known[j]) > SAME * dt:
                known[j] = dt
                e[j], a[j], b[j] = hold_weights(dt, p[0])
            lagged = e[j] * lagged + a[j] * before + b[j] * u[i]
        elif p[0] <= 0.0:
            lagged = u[i]
        last, before, y[i] = t[i], u[i], lagged
    s[1], s[2], s[3] = last, before, lagged


@njit(cache=True, error_model="numpy")
def uneven_low_pass(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """First-order lag that rises within one time and falls within another. ``p`` = (tau up, tau down), s; from 0."""
    if s[0] == 0.0 and t.size:
        s[0], s[1], s[2] = 1.0, t[0], u[0]
    for i in range(t.size):
        e, a, b = hold_weights(t[i] - s[1], p[0] if 0.5 * (s[2] + u[i]) > s[3] else p[1])
        s[3] = e * s[3] + a * s[2] + b * u[i]
        s[1], s[2] = t[i], u[i]
        y[i] = s[3]


@njit(cache=True, error_model="numpy")
def adaptive_low_pass(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """First-order lag that lets what moves far pass: tau (1 + ((u - y) / reach)²)⁻¹ y' = u - y. ``p`` = (tau s, reach).

    A noise filter of frames that looks for motion does so. From the first input on.
    """
    if s[0] == 0.0 and t.size:
        s[0], s[1], s[2], s[3] = 1.0, t[0], u[0], u[0]
    for i in range(t.size):
        away = (0.5 * (s[2] + u[i]) - s[3]) / p[1]
        e, a, b = hold_weights(t[i] - s[1], p[0] / (1.0 + away * away))
        s[3] = e * s[3] + a * s[2] + b * u[i]
        s[1], s[2] = t[i], u[i]
        y[i] = s[3]


@njit(cache=True, error_model="numpy")
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


@njit(cache=True, error_model="numpy")
def second_order(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """Second-order lag, tau² y'' + 2 zeta tau y' + y = u. ``p`` = (tau s, zeta)."""
    if s[0] == 0.0 and t.size:
        s[0], s[1], s[2] = 1.0, t[0], u[0]
    w, z = 1.0 / max(p[0], 1e-9), p[1]
    last, before, level, speed = s[1], s[2], s[3], s[4]
    known, kept = np.zeros(STEPS), np.empty((STEPS, 4))
    for i in range(t.size):
        dt = t[i] - last
        if dt * w > 1e-7:
            j = place(dt)
            if abs(dt - known[j]) > SAME * dt:
                known[j] = dt
                kept[j, 0], kept[j, 1], kept[j, 2], kept[j, 3] = oscillation(dt, w, z)
            rate = (u[i] - before) / dt
            lag = rate * 2.0 * z / w  # a ramp is followed this far behind
            x, v = level - (before - lag), speed - rate
            level = u[i] - lag + kept[j, 0] * x + kept[j, 1] * v
            speed = rate + kept[j, 2] * x + kept[j, 3] * v
        else:
            level += speed * dt
        last, before, y[i] = t[i], u[i], level
    s[1], s[2], s[3], s[4] = last, before, level, speed


@njit(cache=True, error_model="numpy")
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


@njit(cache=True, error_model="numpy")
def eased(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """Second-order lag whose own rate approaches a limit: y' = r tanh(v/r), tau² v' = u - y - 2 zeta tau v.

    ``p`` = (tau s, zeta, up 1/s, down 1/s), r = up while v > 0, else down. By midpoints of sixteenths of tau or less;
    where it is overdamped, implicit in the damping.
    """
    if s[0] == 0.0 and t.size:
        s[0], s[1], s[2] = 1.0, t[0], u[0]
    w, z = 1.0 / max(p[0], QUICKEST_LAG), p[1]
    implicit = 1.0 if z > 1.0 else 0.0  # explicit steps diverge from a damping of 16 on
    for i in range(t.size):
        dt, change = t[i] - s[1], u[i] - s[2]
        parts = max(math.ceil(16.0 * dt * w), 1)
        h = dt / parts
        for k in range(parts):
            x, v = s[3], s[4]
            off = abs(s[2] - x) + abs(v) / w
            if change == 0.0 and off < 1e-12 * abs(x):  # at rest
                break
            now = s[2] + (k + 0.5) / parts * change
            r = p[2] if v > 0.0 else p[3]
            half_x = x + 0.5 * h * r * math.tanh(v / r)
            brake = 2.0 * z * w * h
            half_v = (v + 0.5 * (h * w * w * (now - x) - (1.0 - implicit) * brake * v)) / (1.0 + 0.5 * implicit * brake)
            r = p[2] if half_v > 0.0 else p[3]
            s[3] = x + h * r * math.tanh(half_v / r)
            pull = h * w * w * (now - half_x) - (1.0 - implicit) * brake * half_v
            s[4] = (v + pull) / (1.0 + implicit * brake)
        s[1], s[2] = t[i], u[i]
        y[i] = s[3]


@njit(cache=True, error_model="numpy")
def rate_limit(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """Slew limit. ``p`` = (fastest rise, fastest fall), both positive, in the signal's unit per second."""
    if s[0] == 0.0 and t.size:
        s[0], s[1] = 1.0, t[0]
    for i in range(t.size):
        dt = t[i] - s[1]
        s[3] = min(max(u[i], s[3] - p[1] * dt), s[3] + p[0] * dt)
        s[1] = t[i]
        y[i] = s[3]


PLANNED, ARRIVED = 5e-4, 1e-12
"""s of a planner's step, as of a card's cycle; and how near to its aim, in the signal's unit, it is there."""


@njit(cache=True, error_model="numpy")
def planned(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """A motion planner: y' = v, |v'| <= a, v towards the largest speed from which it still stops where it is to go,
    sign(e) min(fastest, (2 a |e|)^(1/2)) with e = u - y (time-optimal; Kirk, Optimal Control Theory, 1970, 5.4).
    ``p`` = (fastest, a), in the signal's unit per second and per second squared.
    """
    fastest, a = p[0], p[1]
    if s[0] == 0.0 and t.size:
        s[0], s[1], s[2], s[3] = 1.0, t[0], u[0], u[0]
    for i in range(t.size):
        dt, begin = t[i] - s[1], s[2]
        parts = max(math.ceil(dt / PLANNED), 1) if dt > 0.0 else 0
        h, rise = dt / max(parts, 1), (u[i] - begin) / max(parts, 1)
        for j in range(parts):
            e = begin + (j + 1) * rise - s[3]
            if rise == 0.0 and abs(e) < ARRIVED and abs(s[4]) * h < ARRIVED:
                s[4] = 0.0
                break
            speed = math.copysign(min(fastest, math.sqrt(2.0 * a * abs(e)), abs(e) / h), e)
            s[4] = speed if abs(speed - s[4]) < a * h else s[4] + math.copysign(a * h, speed - s[4])
            s[3] += h * s[4]
        s[1], s[2], y[i] = t[i], u[i], s[3]


@njit(cache=True, error_model="numpy")
def lead(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """Movement is exaggerated: y = u + a (u - lag of u). ``p`` = (a, tau s)."""
    low_pass(s, t, u, p[1:2], y)
    for i in range(t.size):
        y[i] = u[i] + p[0] * (u[i] - y[i])


@njit(cache=True, error_model="numpy")
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
