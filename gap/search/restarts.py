"""The best effects begun again from all over their priors, where even the best explanation leaves much.

A store, a limit or a rhythm has several places from which a fit goes downhill, and the few points of the screening lie
in some of them only.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.optimize import differential_evolution
from scipy.stats import qmc

from gap.inference.evidence import Fit, Hypothesis
from gap.inference.linear import Projector
from gap.inference.problem import Problem
from gap.search.beside import Beside
from gap.search.screening import Screened
from sim_devices.chain import FloatArray

LEFT = 1.3
"""χ² for each row of a block from which on its explanation leaves much."""
NOTHING, ALL = 1.0, 100.0
"""σ by which an effect hardly stands out, and by which it does so clearly."""
POPULATION, GENERATIONS = 40, 15
"""Of a differential evolution over an effect's prior: points, half of them the screening's, and how often these are
bred, from any (rand1bin): from the best alone they all end where the fit was."""
ROWS, FEWEST = 3000, 5
"""Rows of a block up to which there are so many generations; of more there are fewer, as each simulation takes longer,
but as many as these."""
BEGINNINGS, APART = 8, 0.1
"""From how many of the points fits begin, and quantiles by which two of these differ at least: with the nuisance as it
was fitted, the best of them may lie where the fit was, too."""


def leaves_much_of(hypothesis: Hypothesis, problems: Mapping[str, Problem]) -> set[str]:
    """The blocks of which a hypothesis leaves much, among those that its first effect touches."""
    return {b for b in hypothesis.effects[0].blocks if b in problems and _left(hypothesis.fits[b]) > LEFT}


def all_or_nothing(screened: Screened) -> bool:
    """Whether an effect of several parameters does nothing at half of its screening points and much at others: from
    where a limit is met nowhere no fit leads to where it is."""
    seen = np.array([d for _, d in screened.detectability])
    several = len(screened.candidate.parameters) > 1
    return several and bool(np.mean(seen < NOTHING) >= 0.5 and np.max(seen) > ALL)


def begun_anew(hypothesis: Hypothesis, screened: Screened, problems: Mapping[str, Problem]) -> tuple[Screened, int]:
    """A ``screened`` effect with the points of its prior that explain most of the block of which ``hypothesis``, the
    effect as it was fitted, leaves most, as starts; and the number of simulations."""
    block = max(screened.starts, key=lambda b: _left(hypothesis.fits[b]))
    fitted, problem = hypothesis.fits[block], problems[block]
    refits = [Projector(fitted.jacobian, sd) for sd in problem.prior_scales]
    beside = Beside(problem, fitted.nuisance, refits, screened.candidate)
    found: list[tuple[float, FloatArray]] = []

    def left(unit: FloatArray) -> float:
        deviance = beside.left(unit)
        found.append((deviance, np.array(unit)))
        return deviance

    size = len(screened.candidate.parameters)
    known = screened.units[: POPULATION // 2]
    first = np.vstack([*known, qmc.LatinHypercube(size, seed=0).random(POPULATION - len(known))])
    generations = max(FEWEST, min(GENERATIONS, GENERATIONS * ROWS // len(fitted.residual)))
    differential_evolution(
        left, [(0.0, 1.0)] * size, init=first, maxiter=generations, strategy="rand1bin", polish=False, tol=0.0, seed=0
    )
    starts: list[FloatArray] = []
    for _, unit in sorted(found, key=lambda one: one[0]):
        if len(starts) < BEGINNINGS and all(np.max(np.abs(unit - other)) > APART for other in starts):
            starts.append(unit)
    # In the other blocks the effect is as in this one; they begin with the best where its fit hardly knows the effect.
    others = {b: tuple(starts[:1]) for b in screened.starts if b != block}
    return replace(screened, starts={block: tuple(starts)} | others), len(found)


def _left(fitted: Fit) -> float:
    return fitted.chi2 / max(len(fitted.residual), 1)
