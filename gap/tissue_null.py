"""What tissues other than the reduced law could do: a basis of causal responses to suction, with prior weights.

Linear combinations of it are added to the nominal prediction with small prior standard deviations (the principal
shapes B of the covariance Σ = σ²I + B Bᵀ): curve -> memory (any elastic curve, any fading memory, not separable),
memory -> curve, and slow dependence on the past. What acts between loading and unloading at equal history, or only at
the instrument's end, is not in it.
"""

from __future__ import annotations

import numpy as np

from gap.hypothesis import FloatArray
from sim_devices.stages.kernels import evaluate, low_pass, prony

MEMORY = (0.0, 0.06, 0.3, 1.5, 8.0, 40.0, 200.0)
"""Time constants of the fading memory, s (0: instantaneous)."""
USUAL_MEMORY = (0.15, 0.12, 0.15, 1.0, 0.2, 6.0, 0.2, 40.0)
"""Prony terms (share, time constant in s) of the reduced tissue."""
KNEES = (0.01, 0.03, 0.07, 0.15, 0.3, 0.6)
"""Fractions of the largest suction at which elastic curves may bend."""


def suction_discrepancy(
    time: FloatArray, pressure: FloatArray, height: FloatArray, stamps: FloatArray, marks: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Basis (n, q), each column of unit size, at ``stamps`` (n,) s, and prior weights (q,).

    ``time``, ``pressure`` (m,) s, Pa is the suction on the skin, ``height`` (n,) m a first guess of what it does
    (memory -> curve); columns are zero at ``marks`` (s), as the instrument zeroes.
    """
    grid = np.unique(np.concatenate([stamps, time[:: max(1, len(time) // 20000)], time[:1], time[-1:]]))
    u = np.maximum(-np.interp(grid, time, pressure), 0.0)
    top = float(u.max()) or 1.0
    u = u / top
    columns: list[FloatArray] = []
    weights: list[float] = []

    def lag(x: FloatArray, tau: float) -> FloatArray:
        return evaluate(low_pass, grid, x, tau) if tau else x

    def add(x: FloatArray, weight: float) -> None:
        columns.append(x)
        weights.append(weight)

    curves = [u, u**2, u**3, *[np.minimum(u, k) / k for k in KNEES]]
    for tau in MEMORY:
        for curve in curves:
            add(lag(curve, tau), 1.5)
    for curve in curves:  # nobody knows a person's elastic curve: another one, under the usual memory
        add(evaluate(prony, grid, curve, 1.0, *USUAL_MEMORY), 15.0)
    for tau in (0.3, 3.0, 30.0):
        m = lag(u, tau)
        add(m * u, 0.7)
        add(m**2, 0.7)
        add(np.sqrt(np.maximum(m, 0.0)), 0.7)
    worst = np.maximum.accumulate(u)
    add(worst * u, 0.5)
    add(lag(worst, 20.0), 0.5)
    add(lag(worst, 1.0) - lag(u, 1.0), 0.3)
    h = np.interp(grid, stamps, np.maximum(height, 0.0)) / (float(np.max(height, initial=0.0)) or 1.0)
    for curve in (h**2, h**3, *(np.minimum(h, k) / k for k in KNEES[2:])):
        add(curve, 2.0)
        add(lag(curve, 3.0), 0.7)
    basis = np.column_stack([np.interp(stamps, grid, c) for c in columns])
    for begin, end in zip(marks, np.r_[marks[1:], np.inf], strict=True):
        inside = (stamps >= begin) & (stamps < end)
        if inside.any():
            at_mark = np.array([np.interp(begin, grid, c) for c in columns])
            basis[inside] -= at_mark
    size = np.maximum(np.max(np.abs(basis), axis=0), 1e-9)
    return basis / size, np.asarray(weights)
