"""An effect anywhere in its prior, beside a nuisance that is refitted along straight lines: cheap looks, one simulation
each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gap.inference.hypothesis import Candidate
from gap.inference.linear import Projector
from gap.inference.problem import Problem
from sim_devices.chain import FloatArray

HALVINGS = (0.2, 0.1, 0.05, 0.025)
"""Quantiles of its prior by which a strength is moved there, to see where it explains most."""


@dataclass
class Beside:
    """An effect in a block, beside a ``nuisance`` (p,) that is refitted along straight lines, the same for all
    ``refits``; ``tried`` counts."""

    problem: Problem
    nuisance: FloatArray
    refits: Sequence[Projector]
    candidate: Candidate
    tried: int = 0

    def left(self, unit: FloatArray) -> float:
        """The deviance that it leaves where it is at ``unit`` (k,) of its prior; infinite where its simulation
        diverges."""
        self.tried += 1
        active = {self.candidate: self.candidate.values(unit)}
        residual = self.problem.evaluate(self.nuisance, active, want_jacobian=False).residual
        if not np.all(np.isfinite(residual)):
            return float(np.inf)
        times = self.problem.noise_scale(active)
        wider = 0.0 if times is None else 2.0 * float(np.sum(np.log(times)))
        column = residual[:, None]
        seen = self.refits[0].jacobian.T @ column
        return wider + min(float(refit.squares(column, seen)[0]) for refit in self.refits)

    def nearest(self, units: Sequence[FloatArray]) -> tuple[float, FloatArray]:
        """The least that it leaves at one of ``units``, and that one."""
        return min(((self.left(unit), unit) for unit in units), key=lambda one: one[0])

    def closer(self, left: float, unit: FloatArray) -> tuple[float, FloatArray]:
        """The same at other strengths beside it: a threshold or a lag is no straight line."""
        strengths = [k for k, p in enumerate(self.candidate.parameters) if p.null is not None]
        for step in HALVINGS if len(strengths) == 1 else ():
            beside = []
            for by in (-step, step):
                moved = unit.copy()
                moved[strengths[0]] = np.clip(moved[strengths[0]] + by, 0.0, 1.0)
                beside.append(moved)
            left, unit = min((left, unit), self.nearest(beside), key=lambda one: one[0])
        return left, unit
