"""Where an event begins and ends, and thresholds: moved by themselves, for a fit finds them from close by only."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from gap.inference.evidence import Fit, split
from gap.inference.hypothesis import Candidate, to_unit
from gap.inference.least_squares import fit
from gap.inference.problem import Problem
from gap.search.starts import bursts, by_steps
from sim_devices.chain import FloatArray

SHIFTS = (-0.4, -0.2, -0.1, -0.05, -0.02, 0.02, 0.05, 0.1, 0.2, 0.4)
"""s by which edges are moved."""
MOVES: tuple[Mapping[str, float], ...] = (
    {"moment": 1.0},
    {"duration": 1.0},
    {"moment": 1.0, "duration": -1.0},
    {"later": 1.0},
)
"""Which of an event's parameters take a shift, and which way: all of it, its end, its beginning."""
BAND, FACTORS = "band", (0.7, 0.8, 0.9, 0.95, 0.98, 1.02, 1.05, 1.1, 1.25, 1.4)
"""A strength that is a threshold, and factors by which it is moved: between thresholds that let another step through
nothing changes, and no derivative leads from one to the next."""
ROUNDS = 3
"""Refits at most, each from the best of these."""
FEW = 8
"""Steps of a fit from each moment at which an event may begin instead."""
LEAST = 2.0
"""χ² that moved edges must take away for another refit."""


def shifted(candidate: Candidate, unit: FloatArray) -> list[FloatArray]:
    """Points (k,) in prior quantiles like ``unit`` whose event begins or ends a little earlier or later, or both, or
    whose threshold is a little lower or higher."""
    values = candidate.values(unit)
    moves = [m for m in MOVES if set(m) <= set(values)]
    places = [{name: values[name] + way * by for name, way in m.items()} for m in moves for by in SHIFTS]
    places += [{BAND: values[BAND] * by} for by in FACTORS if by_steps(candidate)]
    points = []
    for place in places:
        point = unit.copy()
        for k, p in enumerate(candidate.parameters):
            if p.name in place:
                point[k] = to_unit(p, place[p.name])
        points.append(point)
    return points


def moved(problem: Problem, fitted: Fit) -> Fit:
    """A fit whose last effect, if it is an event that lasts to its recording's end, begins where what it leaves says:
    far from there no derivative leads on, and tissue that was fitted without it shows another moment at first."""
    event = fitted.hypothesis[-1]
    names = [p.name for p in event.parameters]
    if "moment" not in names or "duration" in names:
        return fitted
    rest = len(fitted.unit) - len(names)
    for _ in range(ROUNDS):
        without = fit(problem, fitted.hypothesis[:-1], fitted.unit[:rest], fitted.nuisance, 0)
        tries = []
        for moment in bursts(event, problem, without, fitted.active[event]):
            begin = fitted.unit.copy()
            begin[rest + names.index("moment")] = to_unit(event.parameters[names.index("moment")], moment)
            tries.append(fit(problem, fitted.hypothesis, begin, fitted.nuisance, FEW, belief=fitted.belief))
        best = min(tries, key=lambda f: f.objective, default=fitted)
        tried = fitted.simulations + without.simulations + sum(f.simulations for f in tries)
        if best.objective >= fitted.objective - LEAST:
            return replace(fitted, simulations=tried)
        there = fit(problem, fitted.hypothesis, best.unit, best.nuisance, belief=fitted.belief)
        fitted = replace(there, simulations=tried + there.simulations)
    return fitted


def sharpened(problem: Problem, fitted: Fit) -> Fit:
    """A fit, begun again from other edges of its last effect, if that has any, as long as that takes χ² away."""
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
