"""Where an event begins and ends: its edges moved by themselves, for a fit finds them from close by only."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from gap.inference.evidence import Fit, split
from gap.inference.hypothesis import Candidate, to_unit
from gap.inference.least_squares import fit
from gap.inference.problem import Problem
from sim_devices.chain import FloatArray

SHIFTS = (-0.4, -0.2, -0.1, -0.05, -0.02, 0.02, 0.05, 0.1, 0.2, 0.4)
"""s by which edges are moved."""
MOVES: tuple[Mapping[str, float], ...] = ({"moment": 1.0}, {"duration": 1.0}, {"moment": 1.0, "duration": -1.0})
"""Which of an event's parameters take a shift, and which way: all of it, its end, its beginning."""
ROUNDS = 3
"""Refits at most, each from the best of these."""
LEAST = 2.0
"""χ² that moved edges must take away for another refit."""


def shifted(candidate: Candidate, unit: FloatArray) -> list[FloatArray]:
    """Points (k,) in prior quantiles like ``unit`` whose event begins or ends a little earlier or later, or both."""
    values = candidate.values(unit)
    moves = [m for m in MOVES if set(m) <= set(values)]
    places = [{name: values[name] + way * by for name, way in m.items()} for m in moves for by in SHIFTS]
    points = []
    for place in places:
        point = unit.copy()
        for k, p in enumerate(candidate.parameters):
            if p.name in place:
                point[k] = to_unit(p, place[p.name])
        points.append(point)
    return points


def sharpened(problem: Problem, fitted: Fit) -> Fit:
    """A fit whose last effect is an event, begun again from other edges as long as that takes χ² away."""
    candidate = fitted.hypothesis[-1]
    own = len(candidate.parameters)
    for _ in range(ROUNDS):
        rest, unit = fitted.unit[:-own], fitted.unit[-own:]
        points = [np.concatenate([rest, point]) for point in shifted(candidate, unit)]
        if not points:
            return fitted
        misfits = [_misfit(problem, fitted, point) for point in points]
        tried = fitted.simulations + len(points)
        best = int(np.argmin(misfits))
        if misfits[best] >= fitted.chi2 - LEAST:
            return replace(fitted, simulations=tried)
        there = fit(
            problem, fitted.hypothesis, points[best], fitted.nuisance,
            jacobian=fitted.jacobian, gram=fitted.gram, belief=fitted.belief,
        )  # fmt: skip
        tried += there.simulations
        if there.objective >= fitted.objective:
            return replace(fitted, simulations=tried)
        fitted = replace(there, simulations=tried)
    return fitted


def _misfit(problem: Problem, fitted: Fit, unit: FloatArray) -> float:
    """χ² with the effects at ``unit`` (k,); where they cannot be simulated, infinite."""
    residual = problem.evaluate(fitted.nuisance, split(fitted.hypothesis, unit), want_jacobian=False).residual
    chi2 = float(np.sum(np.square(residual)))
    return chi2 if np.isfinite(chi2) else np.inf
