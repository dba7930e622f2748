"""Errors that noise of the measured drive makes in the parameters.

The model is driven by the measured pressure, noise included. A first-order look finds the scatter that this makes,
which is in the residual; but noise in a model's drive also pulls its parameters to one side, as in every regression
with errors in its variables (Fuller 1987), however many samples there are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..api import Array
from . import units
from .cases import Case
from .problem import Evaluation, Problem
from .statistics import Uncertainty

NEGLIGIBLE = 1e-3  # of the drive's root mean square: noise that pulls nothing
PAIRS = 2  # of runs with as much noise again, added and taken off
TOLD = 0.5  # of a standard error: a pull that is told
SEED = 20230


def pulled(problem: Problem, optimum: Evaluation, known: Uncertainty) -> Uncertainty:
    """``known`` with the pull of the drives' noise added to the variances, and told where it is much.

    Noise as large again is added to the drives and taken off: the pull is the mean product of the changes of
    derivatives and residual, over the curvature. Two runs with sensitivities a pair; none where the noise is small.
    """
    if not any(_matters(case) for case in problem.cases):
        return known
    assert optimum.jacobian is not None
    random = np.random.default_rng(SEED)
    together = np.zeros(optimum.z.size)
    count = 0
    for _ in range(PAIRS):
        noise = [
            {n: random.standard_normal(c.experiment.time.size) * s for n, s in c.drive_noise.items()}
            for c in problem.cases
        ]
        for sign in (1.0, -1.0):
            there = _shaken(problem, noise, sign).evaluate(optimum.z)
            if there.trouble:
                return known
            assert there.jacobian is not None
            together += (there.jacobian - optimum.jacobian).T @ (there.residual - optimum.residual)
            count += 1
    inner = np.flatnonzero(np.isfinite(np.diag(known.covariance)))
    own = optimum.jacobian[:, inner]
    size = np.linalg.norm(own, axis=0).clip(1e-300)
    shift = np.linalg.pinv((own / size).T @ (own / size), rcond=1e-10) @ (together[inner] / count / size) / size
    covariance = known.covariance.copy()
    before = np.sqrt(np.diag(covariance)[inner])
    covariance[np.ix_(inner, inner)] += np.outer(shift, shift)
    return replace(
        known, covariance=covariance, warnings=(*known.warnings, *_told(problem, optimum, inner, shift, before))
    )


def _matters(case: Case) -> bool:
    return any(
        sd > NEGLIGIBLE * float(np.sqrt(np.mean(case.experiment.drive[name] ** 2)))
        for name, sd in case.drive_noise.items()
    )


def _shaken(problem: Problem, noise: Sequence[dict[str, Array]], sign: float) -> Problem:
    """The problem with noise added to its drives."""
    cases = []
    for case, own in zip(problem.cases, noise, strict=True):
        drive = {name: values + sign * own.get(name, 0.0) for name, values in case.experiment.drive.items()}
        cases.append(replace(case, experiment=replace(case.experiment, drive=drive)))
    return Problem(problem.model, cases, problem.variables, problem.executor, problem.tally, problem.observe)


def _told(problem: Problem, optimum: Evaluation, inner: NDArray[np.intp], shift: Array, before: Array) -> list[str]:
    """A sentence about the parameters that are pulled by much of their error."""
    values, words = problem.variables.values(optimum.z), []
    for k, way, error in zip(inner, shift, before, strict=True):
        free = problem.variables.free[int(k)]
        if abs(way) > TOLD * error:
            size = abs(way * free.slope(values[free.symbol]))
            words.append(f"{free.symbol} (by {units.show(size, problem.variables.info[free.symbol].unit, 2)})")
    if not words:
        return []
    return [
        f"noise of the measured drive may have pulled {', '.join(words)} to one side: the errors include it; "
        "`drive: commanded` fits to the set-points instead"
    ]
