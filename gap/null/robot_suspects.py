"""Quick fits of effects that look like another controller of the robot's axes."""

from __future__ import annotations

from dataclasses import dataclass

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


@dataclass(frozen=True)
class Guess:
    """An effect on a sound instrument at the point (k,) of its prior, its usual shape, at which it explains most; and
    the deviance that it leaves there, the nuisance refitted along straight lines."""

    candidate: Candidate
    unit: FloatArray
    left: float


def guessed(problem: Problem, key: str, effect: Effect) -> Guess:
    """The strength by which an effect explains most by itself: a step in the force leaves no slope to follow from
    elsewhere."""
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
    return Guess(candidate, at(float(best.x)), float(best.fun))


def rubbed(problem: Problem, guess: Guess) -> Fit:
    """A quick fit from a guess. Friction also begins with some presliding."""
    builds_up = np.array([p.name == "presliding" for p in guess.candidate.parameters])
    tries = [guess.unit, np.where(builds_up, A_LITTLE, guess.unit)] if builds_up.any() else [guess.unit]
    fits = (fit(problem, (guess.candidate,), unit, problem.prior_mean, iterations=6) for unit in tries)
    return min(fits, key=lambda f: f.objective)
