"""The sheet with every point's stress history: second Piola-Kirchhoff stress relaxing, sample by sample.

The fit convolves the elastic force instead (response.py), exact where the nominal stress relaxes; this is its check.
"""

from __future__ import annotations

import numpy as np

from ..api import Array
from .prestress import stretch
from .response import Response

_RAMP_STEPS = 50


class _History:
    """Relaxing stresses of many points: S(t_{k+1}) = scale S_e + extra with what the points remember in ``extra``."""

    def __init__(self, response: Response, elastic: Array) -> None:
        self.amplitudes = np.array(response.prony.amplitudes)
        self.times = np.array(response.prony.times)
        self.elastic = elastic
        self.memory = np.stack([elastic.copy() for _ in self.times])

    def step(self, duration: float) -> tuple[float, Array]:
        """Scale and extra stress of a step of ``duration`` [s]."""
        x = duration / self.times
        self.decay, self.share = np.exp(-x), -np.expm1(-x) / x
        scale = 1.0 - self.amplitudes.sum() + self.amplitudes @ self.share
        kept = [
            g * (d * m - s * self.elastic)
            for g, d, s, m in zip(self.amplitudes, self.decay, self.share, self.memory, strict=True)
        ]
        return float(scale), np.sum(kept, axis=0)

    def accept(self, elastic: Array) -> None:
        """Take over the elastic stress at the step's end."""
        for k in range(len(self.times)):
            self.memory[k] = self.decay[k] * self.memory[k] + self.share[k] * (elastic - self.elastic)
        self.elastic = elastic.copy()


def history_force(response: Response, time: Array, positions: Array) -> Array:
    """Force (n, 3) [N] on positions (n, 3); raises SolverError with the time of a step that failed."""
    loaded = response.options.prestress_mode == "load"
    start = _History(response, np.zeros(6))
    if loaded:
        state = stretch(response.law, response.p, np.zeros(2))
        steps = _RAMP_STEPS if response.options.prestress_ramp else 1
        for k in range(steps):
            scale, extra = start.step(max(response.options.prestress_ramp, 1e-9) / steps)
            state = stretch(response.law, response.p, response.loads * (k + 1) / steps, scale, extra, state)
            start.accept(state.elastic)
        response.state = state
    sheet = response.sheet()
    history = _History(response, sheet.elastic)
    if loaded:
        history.memory = np.stack([np.broadcast_to(m, sheet.elastic.shape).copy() for m in start.memory])
    force = np.empty_like(positions)
    initial = sheet.extra.copy()
    before = time[0] - (time[1] - time[0])
    for k, moment in enumerate(time):
        sheet.scale, extra = history.step(moment - before)
        sheet.extra = initial + extra
        sheet.move(positions[k], float(moment))
        history.accept(sheet.elastic)
        force[k] = sheet.force
        before = moment
    response.work = sheet.work
    response.field = sheet.picture(float(time[-1]))
    return force
