"""Quasi-linear viscoelasticity (Fung; paper M with one term): relaxation g(t) = 1 - sum_i g_i (1 - exp(-t / tau_i)).

A stress or a force follows from its instantaneous elastic value as T(t) = int g(t - s) dT_e(s). Between samples T_e is
taken linear in time, for which the recursions here are exact at any step.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import float64, njit, types

from ..api import Array

_CREEP_STEPS = 1000  # of the load ramp: error of the creep factor below 1e-5 for relaxation times above ramp / 50


@njit(types.UniTuple(float64[:, ::1], 2)(float64[::1], float64[:, ::1], float64), cache=True)  # type: ignore[no-untyped-call]
def _memory(time, elastic, tau):  # type: ignore[no-untyped-def]
    """int exp(-(t - s)/tau) dT_e(s) of every column, and its derivative with respect to tau."""
    memory, rate = np.empty_like(elastic), np.zeros_like(elastic)
    memory[0] = elastic[0]
    for k in range(time.size - 1):
        x = (time[k + 1] - time[k]) / tau
        decay = np.exp(-x)
        share = 1.0 - 0.5 * x if x < 1e-8 else -np.expm1(-x) / x
        for j in range(elastic.shape[1]):
            jump = elastic[k + 1, j] - elastic[k, j]
            memory[k + 1, j] = decay * memory[k, j] + share * jump
            rate[k + 1, j] = decay * rate[k, j] + (decay * x * memory[k, j] + (share - decay) * jump) / tau
    return memory, rate


@dataclass(frozen=True)
class Prony:
    """Amplitudes g_i >= 0 (sum below 1) and relaxation times tau_i > 0 [s]; raises ValueError otherwise."""

    amplitudes: tuple[float, ...]
    times: tuple[float, ...]

    def __post_init__(self) -> None:
        valid = len(self.amplitudes) == len(self.times) and min(self.times, default=1.0) > 0.0
        if not valid or min(self.amplitudes, default=0.0) < 0.0 or sum(self.amplitudes) >= 1.0:
            raise ValueError(
                f"relaxation: amplitudes {self.amplitudes} must be >= 0 with a sum below 1, times {self.times} > 0"
            )

    @property
    def elastic(self) -> bool:
        """Whether nothing relaxes."""
        return not any(self.amplitudes)

    def relax(self, time: Array, elastic: Array) -> Array:
        """T (n, k) from T_e (n, k) sampled at ``time`` (n,) [s]; T_e is zero before the first sample."""
        total = elastic.copy()
        for amplitude, tau in zip(self.amplitudes, self.times, strict=True):
            if amplitude:
                total -= amplitude * (elastic - _memory(time, np.ascontiguousarray(elastic), tau)[0])
        return total

    def relax_derivatives(self, time: Array, elastic: Array) -> Array:
        """d relax / d(g_1, tau_1, g_2, tau_2, …) at fixed T_e: (2 terms, n, k)."""
        rows = []
        for amplitude, tau in zip(self.amplitudes, self.times, strict=True):
            memory, rate = _memory(time, np.ascontiguousarray(elastic), tau)
            rows += [memory - elastic, amplitude * rate]
        return np.stack(rows)

    def creep_factor(self, ramp: float) -> tuple[float, Array]:
        """T_e / T at the end of a load ramped up over ``ramp`` [s]: creep makes the elastic stress exceed the load.

        Returns it and its derivatives (2 terms,) by (g_1, tau_1, …). Solves int g(t - s) dT_e(s) = t / ramp.
        """
        values = np.array([x for pair in zip(self.amplitudes, self.times, strict=True) for x in pair], dtype=complex)
        if ramp <= 0.0:
            return 1.0, np.zeros(values.size)
        gradient = np.empty(values.size)
        for k in range(values.size):
            step = values.copy()
            step[k] += 1e-30j  # complex step: exact to rounding
            gradient[k] = _creep(step[::2], step[1::2], ramp).imag / 1e-30
        return _creep(values[::2], values[1::2], ramp).real, gradient


def _creep(amplitudes: Array, times: Array, ramp: float) -> complex:
    x = ramp / _CREEP_STEPS / times
    decay, share = np.exp(-x), (1.0 - np.exp(-x)) / x
    elastic, memory = 0.0 + 0.0j, np.zeros(times.size, dtype=complex)
    stiffness = 1.0 - amplitudes.sum() + (amplitudes * share).sum()
    for k in range(1, _CREEP_STEPS + 1):
        before = (amplitudes * (decay * memory - share * elastic)).sum()
        new = (k / _CREEP_STEPS - before) / stiffness
        memory = decay * memory + share * (new - elastic)
        elastic = new
    return complex(elastic)
