"""Shared by the nominal models: prior ranges of parameters, and linear systems integrated exactly between samples."""

from __future__ import annotations

import numpy as np
from numba import njit
from scipy.linalg import expm
from scipy.signal import butter, filtfilt, lfilter

from sim_devices.chain import Parameter


def log(name: str, unit: str, low: float, high: float) -> Parameter:
    """A positive parameter known within a range; its default is the middle of the logarithms."""
    return Parameter(name, unit, low, high, None, float(np.sqrt(low * high)), "log")


def lin(name: str, unit: str, half: float, centre: float = 0.0) -> Parameter:
    """A parameter known to ``centre`` ± ``half``."""
    return Parameter(name, unit, centre - half, centre + half, None, centre)


def first_order(values, dt, tau, start):
    """A lag of time constant ``tau`` s, exact for values that run linearly between samples."""
    a = np.exp(-dt / tau)
    late = 1 - (1 - a) * tau / dt
    early = 1 - a - late
    driven = late * values
    driven[1:] += early * values[:-1]
    driven[0] = start
    return lfilter([1], [1, -a], driven)


def transition(matrix, inputs, dt):
    """Exact step of ``x' = A x + B u`` with ``u`` linear between samples: x+ = F x + G0 u + G1 u+."""
    n, m = inputs.shape
    whole = np.zeros((n + 2 * m, n + 2 * m))
    whole[:n, :n], whole[:n, n : n + m] = matrix * dt, inputs * dt
    whole[n : n + m, n + m :] = np.eye(m)
    e = expm(whole)
    late = e[:n, n + m :]
    return e[:n, :n], e[:n, n : n + m] - late, late


@njit
def _run(f, g0, g1, u, x, v):
    out = np.empty(u.size)
    out[0] = x
    for i in range(1, u.size):
        x, v = (
            f[0, 0] * x + f[0, 1] * v + g0[0] * u[i - 1] + g1[0] * u[i],
            f[1, 0] * x + f[1, 1] * v + g0[1] * u[i - 1] + g1[1] * u[i],
        )
        out[i] = x
    return out


def second_order(values, dt, natural, damping, start=0.0, speed=0.0):
    """An oscillator of unit gain, ``natural`` rad/s, driven by ``values``."""
    a = np.array([[0.0, 1.0], [-(natural**2), -2 * damping * natural]])
    f, g0, g1 = transition(a, np.array([[0.0], [natural**2]]), dt)
    return _run(f, g0[:, 0], g1[:, 0], np.ascontiguousarray(values), start, speed)


def smooth(time, values, cut_off):
    """Zero-phase low-pass at ``cut_off`` Hz."""
    return filtfilt(*butter(4, cut_off * 2 * (time[1] - time[0])), values)
