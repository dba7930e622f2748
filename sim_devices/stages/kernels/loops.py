"""Closed loops of pressure that are not linear: a controller with an integral about a proportional valve."""

from __future__ import annotations

import math

from numba import njit

from sim_devices.stages.kernels.base import FloatArray

PARTS = 4.0
"""Steps for the quicker of valve and chamber."""
QUICKEST = 3e-3
"""s: a valve that is quicker than this counts as so quick; it saves steps and moves no pressure that is sampled."""
AT_REST = 1e-9
"""Share of the command's largest value by which pressure may be off it, or move within a step, and be at rest."""
LEAST = 0.05
"""Of the nominal flow, at the ends of what a supply can give."""


@njit(cache=True)
def _flow(p: float, x: float, law: FloatArray) -> float:
    """Flow into the chamber, Pa/s, of a valve that asks for ``x`` at the pressure ``p``."""
    up, down, build, vent, lean, span, soft = law[2], law[3], law[6], law[7], law[8], law[9], law[10]
    level = min(max(-p / span, 0.0), 1.0)
    gain = 1.0 + lean - build * level if x < 0.0 else 1.0 - lean + vent * level
    flow = max(gain, LEAST) * x
    if soft > 0.0:
        limit = up if flow > 0.0 else down
        return float(limit * math.tanh(flow / limit)) if limit < math.inf else flow
    return float(min(max(flow, -down), up))


@njit(cache=True)
def valve_loop(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """Pressure of a chamber by a PI controller and a proportional valve: y' = g(y, x) x, T x' = v - x,
    v = k (b u - y) + I, I' = k r (u - y), with 1/k = 2 zeta tau and T = tau / (2 zeta); it is a second-order lag where
    b = 1, r = 0 and g = 1.

    The flow that a valve lets through follows the pressure across it (ISO 6358): g = 1 + lean - build q while suction
    builds up, 1 - lean + vent q while it is vented, q = -y / span. ``p`` = (tau s, zeta, fastest rise and fall, r 1/s,
    b, build, vent, lean, span, 1 if the limits are approached softly). Classical Runge-Kutta.
    """
    k = 1.0 / (2.0 * p[1] * max(p[0], 1e-9))
    late = max(p[0] / (2.0 * p[1]), QUICKEST)
    reset, weight = p[4], p[5]
    if s[0] == 0.0 and t.size:
        s[0], s[1], s[2] = 1.0, t[0], u[0]
    for i in range(t.size):
        dt, change = t[i] - s[1], u[i] - s[2]
        parts = max(math.ceil(PARTS * dt * max(k, 1.0 / late)), 1) if dt > 1e-7 else 0
        h = dt / max(parts, 1)
        s[6] = max(s[6], abs(u[i]))
        for j in range(parts):
            if change == 0.0 and abs(u[i] - s[3]) + abs(s[4]) * late < AT_REST * s[6]:
                break
            at, slope = s[2] + j / parts * change, change / dt
            y0, x0, i0 = s[3], s[4], s[5]
            dy, dx, di = 0.0, 0.0, 0.0
            sy, sx, si = 0.0, 0.0, 0.0
            for stage in range(4):
                part = 0.0 if stage == 0 else (h if stage == 3 else 0.5 * h)
                w = 1.0 if stage == 0 or stage == 3 else 2.0
                yy, xx, ii, now = y0 + part * dy, x0 + part * dx, i0 + part * di, at + part * slope
                dy, dx, di = (
                    _flow(yy, xx, p),
                    (k * (weight * now - yy) + ii - xx) / late,
                    k * reset * (now - yy),
                )
                sy, sx, si = sy + w * dy, sx + w * dx, si + w * di
            s[3], s[4], s[5] = y0 + h / 6.0 * sy, x0 + h / 6.0 * sx, i0 + h / 6.0 * si
        s[1], s[2], y[i] = t[i], u[i], s[3]
