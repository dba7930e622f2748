"""Discrepancy of the sheet under the robot's tip: a basis of causal responses, with weights.

Linear combinations of it join the nominal force with small prior standard deviations, so that only a change no passive
tissue could do is left for the device. Elastic forces are gradients of potentials of the displacement; memory comes
behind them (any fading memory of any elastic sheet, different in every direction), before them (the sheet yields to
the tip's past), or as a factor (stiffness that depends on what was done before); slow set is a play in the plane.
"""

from __future__ import annotations

from itertools import combinations_with_replacement

import numpy as np
from numba import njit

from sim_devices.chain import FloatArray
from sim_devices.stages.kernels import hold_weights

MEMORY = (0.0, 0.05, 0.25, 1.0, 4.0, 16.0, 80.0)
"""Time constants of the fading memory, s (0: instantaneous)."""
PAST = (0.1, 0.6, 3.0, 15.0, 80.0)
"""Time constants of the sheet's memory of the displacement itself, s."""
SETS = (0.06, 0.12, 0.2, 0.3, 0.45, 0.65, 0.85)
"""Half widths of plays, of the largest displacement: the part of the past that stays."""
FLOWS = ((1.0, 10.0), (10.0, 100.0), (100.0, 1e4), (1.0, 1e4), (0.3, 0.03), (10.0, 1.0))
"""Time constants of flow away from rest and of its return, s."""
GRID_STEP = 0.04
"""s; the robot's displacement is slow."""


def sheet_discrepancy(time: FloatArray, displacement: FloatArray, stamps: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Forces (3, n, q) at ``stamps`` (n,) s that other sheets could make, each of about unit size, and weights (q,).

    ``displacement`` (3, m) m at ``time`` (m,) s.
    """
    step = max(1, round(GRID_STEP / float(np.median(np.diff(time)))))
    grid = np.unique(np.concatenate([stamps, time[::step], time[-1:]]))
    u = np.stack([np.interp(grid, time, d) for d in displacement])
    u = u / (float(np.max(np.abs(u))) or 1.0)
    families: list[tuple[FloatArray, float]] = []  # forces (k, 3, m), weight

    elastic = np.concatenate([gradients(u, degree) for degree in (2, 3, 4, 6)])
    for tau in MEMORY:
        families.append((lagged(grid, elastic, tau), 3.0 if tau == 0 else 1.0))
    amount, linear = np.linalg.norm(u, axis=0), gradients(u, 2)
    for tau in PAST:
        past = lagged(grid, u, tau)
        families.append((gradients(past, 3), 0.5))
        families.append((gradients(past, 4), 0.5))
        before = lagged(grid, amount, tau)
        families.append((linear * before, 1.0))
        families.append((linear * before**2, 0.5))
        families.append((np.stack([past * amount**2, past * amount]), 1.0))
    worst = np.maximum.accumulate(amount)
    families.append((linear * worst, 1.0))
    for width in SETS:
        stay = np.empty_like(u)
        played(u, width, stay)
        families.append((gradients(stay, 2), 1.0))
        families.append((gradients(u - stay, 6), 1.0))
        families.append((gradients(lagged(grid, stay, 3.0), 2), 0.5))
    for away, back in FLOWS:
        flown = np.empty_like(u)
        flowing(grid, u, away, back, flown)
        families.append((gradients(flown, 2), 1.0))
        families.append((gradients(flown, 4), 0.5))
        families.append((linear * np.linalg.norm(flown, axis=0), 0.5))
    columns = np.concatenate([np.stack([[np.interp(stamps, grid, a) for a in f] for f in fs]) for fs, _ in families])
    weights = np.concatenate([np.full(len(fs), w) for fs, w in families])
    return np.moveaxis(columns, 0, -1), weights


def gradients(u: FloatArray, degree: int) -> FloatArray:
    """Gradients (k, 3, m) of the monomials of ``degree`` in u (3, m); above degree 4 of powers of quadratic forms."""
    if degree > 4:
        radius = np.sum(u**2, axis=0) ** (degree // 2 - 1)
        columns: FloatArray = gradients(u, 2)[[0, 3, 5]] * radius
        return columns
    out = []
    for chosen in combinations_with_replacement(range(3), degree):
        gradient = np.zeros_like(u)
        for axis in set(chosen):
            rest = list(chosen)
            rest.remove(axis)
            gradient[axis] = chosen.count(axis) * np.prod(u[rest], axis=0)
        out.append(gradient / degree)
    return np.stack(out)


def lagged(time: FloatArray, values: FloatArray, tau: float) -> FloatArray:
    """``values`` (..., m) after a first-order lag of ``tau`` s, from rest; unchanged for tau = 0."""
    if tau == 0:
        return values
    out = np.empty_like(values)
    flat = np.ascontiguousarray(values.reshape(-1, len(time)))
    _lag(time, flat, tau, out.reshape(flat.shape))
    return out


@njit(cache=True, error_model="numpy")
def _lag(time: FloatArray, values: FloatArray, tau: float, out: FloatArray) -> None:
    state = np.zeros(len(values))
    out[:, 0] = 0.0
    for i in range(1, time.size):
        e, a, b = hold_weights(time[i] - time[i - 1], tau)
        for k in range(len(values)):
            state[k] = e * state[k] + a * values[k, i - 1] + b * values[k, i]
            out[k, i] = state[k]


@njit(cache=True, error_model="numpy")
def flowing(time: FloatArray, u: FloatArray, away: float, back: float, out: FloatArray) -> None:
    """A point drawn towards u (3, m) within ``away`` s while that is farther from rest than it, else ``back`` s."""
    s = np.zeros(3)
    out[:, 0] = 0.0
    for i in range(1, time.size):
        far = np.sum(u[:, i] * u[:, i]) > np.sum(s * s)
        s = u[:, i] + (s - u[:, i]) * np.exp(-(time[i] - time[i - 1]) / (away if far else back))
        out[:, i] = s


@njit(cache=True, error_model="numpy")
def played(u: FloatArray, width: float, out: FloatArray) -> None:
    """A point carried along by u (3, m) at a distance ``width``: play in space."""
    s = np.zeros(3)
    for i in range(u.shape[1]):
        d = u[:, i] - s
        far = np.sqrt(np.sum(d * d))
        if far > width:
            s += (far - width) / far * d
        out[:, i] = s
