"""Which controller drives the robot's axes, by quick fits also of effects that look like another one."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from gap.inference.evidence import Fit
from gap.inference.hypothesis import Candidate, to_unit
from gap.inference.least_squares import fit
from gap.inference.linear import Projector
from gap.inference.problem import Problem
from gap.null.robot_loop import Controller
from sim_devices.chain import Effect, FloatArray

STRENGTHS = np.linspace(0.1, 0.9, 17)
"""Quantiles of a strength that are tried: near enough to each other for a search between two to find the best."""

A_LITTLE = 0.04
"""Quantile of the length over which friction builds up, from which a fit leads on, as it does not from none."""


MISTAKEN = ("viscous_drag", 0), ("viscous_drag", 2), ("coulomb_friction", 0), ("latency", 0)
"""Effects and forms that the quick fits look for where no controller explains the axes: each looks like another one."""
LIKELIEST = 2
"""Controllers beside which each of them is fitted: those beside which it explains most."""
STRAINED, EXPLAINED = 15.0, 2.0
"""Penalty of the loop's tolerances above which they are strained: something else is likely; and χ² a row up to which a
controller within its tolerances explains the axes: nothing else need be looked for."""
WORTH = 20.0
"""χ² by which a controller that holds sampled rows must be better than one that goes straight in between."""
Way = tuple[Controller, bool]
"""A controller, and whether it holds sampled rows of a command until the next."""


def explains(f: Fit) -> bool:
    """Whether a sound instrument within its tolerances leaves no more than the noise."""
    return f.penalty <= STRAINED and f.chi2 <= EXPLAINED * len(f.residual)


def quickly(problem: Problem) -> Fit:
    """A quick fit of a sound instrument."""
    return fit(problem, nuisance=problem.prior_mean, iterations=3)


def likeliest(
    problem: Problem, take: Callable[[Controller, bool], None], ways: Sequence[Way], library: Mapping[str, Effect]
) -> tuple[Fit, dict[str, Fit]]:
    """Have ``problem`` ``take`` the likeliest of the ways; its fit by itself and, where none explains the axes so,
    those with each of `MISTAKEN` of the ``library``, by its key."""

    alone: dict[Way, Fit] = {}
    for way in ways:
        take(*way)
        alone[way] = quickly(problem)
    guesses: dict[Way, list[Guess]] = {way: [] for way in ways}
    for way in () if any(map(explains, alone.values())) else ways:
        take(*way)
        guesses[way] = [guessed(problem, key, effect) for key, effect in _mistaken(library)]
    deviance = np.array([[guess.left for guess in own] for own in guesses.values()])
    likely = deviance <= np.sort(deviance, axis=0)[:LIKELIEST][-1]
    fitted: dict[Way, dict[str, Fit]] = {}
    for (way, own), explain_most in zip(guesses.items(), likely, strict=True):
        take(*way)  # which forgets all that was made for another
        fitted[way] = {g.candidate.key: rubbed(problem, g) for g, most in zip(own, explain_most, strict=True) if most}
    # Rows are straight unless it is worth it that they are held.
    best = min(ways, key=lambda w: min(f.objective for f in (alone[w], *fitted[w].values())) + WORTH * w[1])
    take(*best)
    others = [g for g in guesses[best] if g.candidate.key not in fitted[best]]
    return alone[best], fitted[best] | {g.candidate.key: rubbed(problem, g) for g in others}


def _mistaken(library: Mapping[str, Effect]) -> list[tuple[str, Effect]]:
    """The effects that look like another controller, with their keys: of all axes before a single one."""
    forms: dict[tuple[str, int], tuple[str, Effect]] = {}
    for key, effect in library.items():
        forms.setdefault((effect.name, effect.form), (key, effect))
    return [forms[form] for form in MISTAKEN if form in forms]


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
