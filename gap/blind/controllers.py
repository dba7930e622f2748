"""Closed loops of pressure, of three structures: second order (README.md's), first order, PI with anti-windup.

Effects of the actuator act inside the loop, whatever its structure.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from .instants import Knobs
from .signals import Array

OMEGA = 1 / 0.040  # rad/s, double pole of the second-order regulator
_PARTS, _WEIGHTS = (0.0, 0.5, 0.5, 1.0), (1.0, 2.0, 2.0, 1.0)  # of a step, in classical RK4


@njit(cache=True)
def _flow(u, p, state, w, zeta, pi):  # type: ignore[no-untyped-def]
    """Flow into the chamber [Pa/s] and how fast the regulator's state changes; ``pi`` is (gain, reset, weight)."""
    if pi[0] > 0.0:
        return pi[0] * (pi[2] * u - p) + state, pi[0] / pi[1] * (u - p)
    if w < 0.0:
        return -w * (u - p), 0.0
    return state, w * w * (u - p) - 2 * zeta * w * state


@njit(cache=True)
def _felt(u, x, band):  # type: ignore[no-untyped-def]
    """The pressure that a regulator acts on: within the dead band of the command it sees no difference."""
    if band <= 0.0:
        return x
    err = u - x
    err = 0.0 if abs(err) < band else err - band * np.sign(err)
    return u - err


@njit(cache=True)
def _bounded(flow, change, rate, soft, integrates):  # type: ignore[no-untyped-def]
    """Flow and change of the regulator's state where the flow is at most ``rate`` (0: any), softly or hard; a hard
    bound stops the integral of a regulator that has one."""
    if rate <= 0.0:
        return flow, change
    if soft > 0.0:
        return rate * np.tanh(flow / rate), change
    bound = min(max(flow, -rate), rate)
    return bound, 0.0 if integrates and bound != flow else change


@njit(cache=True)
def _loop(c, dt, w, zeta, hindered, lead, pi, late):  # type: ignore[no-untyped-def]
    """RK4 of p' = flow - leaks(p) and of the regulator's state; returns p + lead flow. ``w`` < 0 is a first order;
    ``late`` s pass before the regulator sees its own pressure."""
    rate, soft, leak, root_leak, late_leak, late_at, band = hindered
    integrates = pi[0] > 0.0
    limited = rate > 0.0 and soft == 0.0 and not integrates and w > 0.0
    y, seen = np.zeros_like(c), np.zeros_like(c)
    p, v = 0.0, 0.0
    ago, passed = 0, 0.0  # the node that the regulator sees, and how long it was before the last one
    for i in range(1, c.size):
        h = dt[i]
        passed += dt[i - 1] if i > 1 else 0.0
        while ago < i - 1 and abs(passed - dt[ago + 1] - late) <= abs(passed - late):
            ago += 1
            passed -= dt[ago]
        sp, sv = 0.0, 0.0
        kp, kv = 0.0, 0.0
        old = seen[ago] - seen[i - 1]
        for k in range(4):
            part = _PARTS[k]
            x, vi = p + part * h * kp, v + part * h * kv
            u = c[i - 1] + (c[i] - c[i - 1]) * part
            flow, change = _flow(u, _felt(u, x + old, band), vi, w, zeta, pi)
            flow, change = _bounded(flow, change, rate, soft, integrates)
            out = leak * x + root_leak * np.sqrt(max(x, 0.0)) + late_leak * max(x - late_at, 0.0)
            kp, kv = flow - out, change
            sp += _WEIGHTS[k] * kp
            sv += _WEIGHTS[k] * kv
        p += h / 6 * sp
        v += h / 6 * sv
        if limited:
            v = min(max(v, -rate), rate)
        y[i] = p + lead * sp / 6
        seen[i] = p
    return y


def controlled(
    c: Array, dt: Array, quick: float, zeta: float, hindered: tuple[float, ...], lead: float, fx: Knobs
) -> Array:
    """True suction (N,) [Pa] for a command c (N,): ``hindered`` is (slew rate, soft, leak, orifice, lifting valve, its
    pressure, dead band), ``quick`` the speed against the nominal one, ``zeta`` the damping of a second order.

    Knobs: ``one_lag`` [s] of a first order; ``pi_gain``, ``pi_reset``, ``pi_weight``, ``pi_flow`` of a PI;
    ``late_steps`` dead time inside the loop, in the finest steps of the grid.
    """
    rate, *others = hindered
    late = round(fx.get("late_steps", 0.0)) * float(np.min(dt[1:]))
    none = np.zeros(3)
    if tau := fx.get("one_lag", 0.0):
        lead = lead + 0.03 * (1.0 - zeta) * (zeta < 1.0)  # a first order that overshoots has a zero
        return np.asarray(_loop(c, dt, -quick / tau, 1.0, hindered, lead, none, late))
    if gain := fx.get("pi_gain", 0.0):
        pi = np.array([gain * quick * max(zeta, 0.05), fx["pi_reset"] / quick * max(zeta, 0.05), fx["pi_weight"]])
        most = fx["pi_flow"] if not rate else min(rate, fx["pi_flow"])
        return np.asarray(_loop(c, dt, 1.0, 1.0, (most, *others), lead, pi, late))
    return np.asarray(_loop(c, dt, OMEGA * quick, zeta, hindered, lead, none, late))
