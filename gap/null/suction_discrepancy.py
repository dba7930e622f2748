"""Discrepancy of the tissue: a basis of causal responses to suction, with prior weights.

Linear combinations of it are added to the nominal prediction with small prior standard deviations (the principal
shapes B of the covariance Σ = σ²I + B Bᵀ): any elastic curve under any fading memory (not separable), memory before
the curve, a curve behind a memory, flow that comes and goes at different rates, dependence on the past. What acts
between loading and unloading at equal history, or only at the instrument's end, is not in it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sim_devices.chain import FloatArray
from sim_devices.stages.kernels import evaluate, low_pass, prony, uneven_low_pass

MEMORY = (0.0, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0)
"""Time constants of the fading memory, s (0: instantaneous)."""
BEFORE = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0)
"""Those of a memory in front of the elastic curve, s."""
USUAL_MEMORY = (0.15, 0.12, 0.15, 1.0, 0.2, 6.0, 0.2, 40.0)
"""Prony terms (share, time constant in s) of the reduced tissue."""
SLOW = (100.0, 1000.0)
"""Time constants of a memory that is as good as constant during a recording, s."""
KNEES = (0.002, 0.005, 0.01, 0.03, 0.07, 0.15, 0.3, 0.6)
"""Fractions of the largest suction at which elastic curves may bend."""
HIGH_KNEES = KNEES[4:]
FLOWS = ((1.0, 10.0), (10.0, 100.0), (100.0, 1e4), (0.1, 1.0), (1.0, 0.1), (10.0, 1.0), (100.0, 10.0), (1.0, 1e4))
"""Time constants of flow under load and of its recovery, s."""


@dataclass(frozen=True)
class Suction:
    """The history of the skin: ``time``, ``pressure`` (m,) s, Pa, and ``height`` (n,) m, a first guess of its response,
    at ``stamps`` (n,) s. In each recording, from its mark (s) to the next, columns of a basis are zero at its onset
    (s), when suction begins and the instrument zeroes."""

    time: FloatArray
    pressure: FloatArray
    height: FloatArray
    stamps: FloatArray
    marks: FloatArray
    onsets: FloatArray

    @cached_property
    def grid(self) -> FloatArray:
        """Times (k,) s on which columns are made."""
        sparse = self.time[:: max(1, len(self.time) // 20000)]
        return np.unique(np.concatenate([self.stamps, sparse, self.time[[0, -1]]]))

    @cached_property
    def load(self) -> FloatArray:
        """Suction on the grid (k,), 1 at its largest."""
        u = np.maximum(-np.interp(self.grid, self.time, self.pressure), 0.0)
        return u / (float(u.max()) or 1.0)

    def basis(self, columns: Sequence[FloatArray]) -> FloatArray:
        """Columns on the grid, each (k,), at the stamps: (n, q), zeroed, of unit size."""
        basis = np.column_stack([np.interp(self.stamps, self.grid, c) for c in columns])
        zeros = np.column_stack([np.interp(self.onsets, self.grid, c) for c in columns])
        for begin, end, zero in zip(self.marks, np.r_[self.marks[1:], np.inf], zeros, strict=True):
            basis[(self.stamps >= begin) & (self.stamps < end)] -= zero
        return _of_unit_size(basis)

    @property
    def left_over(self) -> FloatArray:
        """Deformation that earlier recordings left at the onset of each, by a memory of each time in `SLOW`: (n, 2), of
        unit size. Where the instrument zeroes, the zeros of the recordings take it back."""
        number = np.clip(np.searchsorted(self.marks, self.stamps, side="right") - 1, 0, None)
        slow = [np.interp(self.onsets, self.grid, evaluate(low_pass, self.grid, self.load, tau)) for tau in SLOW]
        return _of_unit_size(np.column_stack([(kept - kept[0])[number] for kept in slow]))


def _of_unit_size(basis: FloatArray) -> FloatArray:
    """Columns (n, q) with a greatest value of 1."""
    scaled: FloatArray = basis / np.maximum(np.max(np.abs(basis), axis=0), 1e-9)
    return scaled


def _curves(u: FloatArray) -> list[FloatArray]:
    """Elastic curves of suction ``u`` (k,); the roots are those of a slack membrane, which rises with the cube root."""
    return [u, u**2, u**3, np.cbrt(u), np.sqrt(u), *[np.minimum(u, k) / k for k in KNEES]]


def elastic_freedom(
    suction: Suction, memory: Sequence[float], of_stress: bool = False
) -> tuple[FloatArray, FloatArray]:
    """Other elastic curves under a given ``memory`` (Prony shares and times in turn), or behind it if it is
    ``of_stress``, and deformation that earlier recordings left: basis (n, q), weights (q,).

    Nobody knows a person's elastic curve, nor how long the skin remembers.
    """
    if of_stress:
        felt = np.maximum(evaluate(prony, suction.grid, suction.load, 1.0, *memory), 0.0)
        columns = _curves(felt / (float(felt.max()) or 1.0))
    else:
        columns = [evaluate(prony, suction.grid, curve, 1.0, *memory) for curve in _curves(suction.load)]
    basis = np.hstack([suction.basis(columns), suction.left_over])
    return basis, np.ones(basis.shape[1])


def suction_discrepancy(suction: Suction) -> tuple[FloatArray, FloatArray]:
    """Responses of other laws: basis (n, q) and prior weights (q,)."""
    grid, u = suction.grid, suction.load
    h = np.interp(grid, suction.stamps, np.maximum(suction.height, 0.0))
    h = h / (float(h.max()) or 1.0)
    columns: list[FloatArray] = []
    weights: list[float] = []

    def lag(x: FloatArray, tau: float) -> FloatArray:
        return evaluate(low_pass, grid, x, tau) if tau else x

    def add(x: FloatArray, weight: float) -> None:
        columns.append(x)
        weights.append(weight)

    for curve in _curves(u):
        for tau in MEMORY:
            add(lag(curve, tau), 1.5)
    for tau in BEFORE:
        m = lag(u, tau)
        for curve in (m * u, u * u * m, m**2, m**3, np.sqrt(m), *(np.minimum(m, k) / k for k in HIGH_KNEES)):
            add(curve, 0.7)
    for curve in (h, h**2, h**3, np.sqrt(h), *(np.minimum(h, k) / k for k in HIGH_KNEES)):
        add(curve, 2.0)
        for tau in (0.03, 0.1, 0.3, 3.0, 30.0):
            add(lag(curve, tau), 0.7)
    for flow in FLOWS:
        for curve in (u, u**2, np.maximum(u - 0.4, 0.0), h):
            add(evaluate(uneven_low_pass, grid, curve, *flow), 0.5)
    worst = np.maximum.accumulate(u)
    kept = [evaluate(uneven_low_pass, grid, u, *flow) for flow in FLOWS[:3]]
    for past in (worst, lag(worst, 20.0), lag(worst, 1.0), *kept):
        add(past * u, 0.5)
        add(past * h, 0.5)
    return suction.basis(columns), np.asarray(weights)
