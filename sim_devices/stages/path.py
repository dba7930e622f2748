"""The way of the robot's tip, before it is that of the axes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit

from sim_devices.chain import FloatArray, Signals
from sim_devices.stages.operators import Wired


@dataclass(frozen=True)
class PathSpeed(Wired):
    """Three set-points followed on the straight way to them at ``rate`` m/s at most: a trajectory generator's limit."""

    rate: float

    def fresh(self) -> Any:
        return np.zeros(5)

    def advance(self, state: Any, time: FloatArray, signals: Signals) -> None:
        wanted = np.stack([signals[s] for s in self.source])
        out = np.empty_like(wanted)
        _followed(state, time, wanted, self.rate, out)
        signals.update(zip(self.target, out, strict=True))


@njit(cache=True, error_model="numpy")
def _followed(s: FloatArray, t: FloatArray, u: FloatArray, rate: float, out: FloatArray) -> None:
    """State s (5,): [0] started [1] last time [2:5] where it is."""
    if s[0] == 0.0 and t.size:
        s[0], s[1] = 1.0, t[0]
        s[2:5] = u[:, 0]
    for i in range(t.size):
        far = math.sqrt((u[0, i] - s[2]) ** 2 + (u[1, i] - s[3]) ** 2 + (u[2, i] - s[4]) ** 2)
        reach = rate * (t[i] - s[1])
        share = 1.0 if far <= reach else reach / far
        for k in range(3):
            s[2 + k] += share * (u[k, i] - s[2 + k])
            out[k, i] = s[2 + k]
        s[1] = t[i]
