"""Quick fits of effects that look like another controller of the robot's axes."""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize_scalar

from gap.inference.evidence import Fit
from gap.inference.hypothesis import Candidate, to_unit
from gap.inference.least_squares import fit
from gap.inference.linear import Projector
from gap.inference.problem import Problem
from sim_devices.chain import Effect, FloatArray

STRENGTHS = np.linspace(0.1, 0.9, 17)
"""Quantiles of a strength that are tried: near enough to each other for a search between two to find the best."""

A_LITTLE = 0.04
"""Quantile of the length over which friction builds up, from which a fit leads on, as it does not from none."""


def rubbed(problem: Problem, key: str, effect: Effect) -> Fit:
    """A quick fit with an effect on a sound instrument, from the strength that by itself explains most: a step in the
    force leaves no slope to follow from elsewhere. Friction also begins with some presliding."""
    candidate = Candidate(key, effect.name, effect.stage, effect.parameters, (problem.name,))
    sound = problem.prior_mean
    refit = Projector(problem.evaluate(sound, {}).jacobian, problem.prior_sd)
    shape = np.array([to_unit(p, p.default) for p in effect.parameters])

    def at(strength: float) -> FloatArray:
        return np.where([p.null is None for p in effect.parameters], shape, strength)

    def left(strength: float) -> float:
        active = {candidate: candidate.values(at(strength))}
        return refit.chi2(problem.evaluate(sound, active, want_jacobian=False).residual)

    near = min(STRENGTHS.tolist(), key=left)
    apart = float(STRENGTHS[1] - STRENGTHS[0])
    best = minimize_scalar(left, bounds=(near - apart, near + apart), options={"xatol": 0.02 * apart})
    begin = at(float(best.x))
    builds_up = np.array([p.name == "presliding" for p in effect.parameters])
    tries = [begin, np.where(builds_up, A_LITTLE, begin)] if builds_up.any() else [begin]
    return min((fit(problem, (candidate,), unit, sound, iterations=6) for unit in tries), key=lambda f: f.objective)
