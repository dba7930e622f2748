"""Errors where parameters trade with each other: how far the other parameters move as one walks along the ridge.

The covariance is that of a straight ridge. Where several parameters cannot be told apart the data allow a long walk,
and over a long walk a ridge bends: parameters across it, which look well known, come out wrong by more than their
errors (Bates and Watts, J. R. Statist. Soc. B 42, 1980: the parameter-effects curvature).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..api import Array
from .problem import Evaluation, Problem
from .statistics import ALIKE, Uncertainty

FOURTH = 3.0  # mean fourth power of a normal deviate: the bend grows with the square of the walk


def widened(problem: Problem, optimum: Evaluation, known: Uncertainty) -> Uncertainty:
    """``known`` with the bend of the longest ridge added to the variances.

    Two further runs with sensitivities, one standard deviation along the ridge to either side, each followed by one
    Gauss–Newton step across it. Only where two parameters are correlated; a side that cannot be run is left out.
    """
    finite = np.flatnonzero(np.isfinite(np.diag(known.covariance)))
    correlation = known.correlation[np.ix_(finite, finite)]
    if finite.size < 2 or np.abs(correlation - np.eye(finite.size)).max() < ALIKE:
        return known
    values, vectors = np.linalg.eigh(correlation)
    along = vectors[:, -1]
    size = np.sqrt(np.diag(known.covariance)[finite])
    lower, upper = problem.variables.bounds
    shifts = []
    for sign in (1.0, -1.0):
        z = optimum.z.copy()
        z[finite] += sign * np.sqrt(values[-1]) * along * size
        inside = np.clip(z, lower, upper)
        if not np.array_equal(inside, z):
            continue
        there = problem.evaluate(z)
        if not there.trouble:
            shifts.append(_across(there, finite, size, along))
    if not shifts:
        return known
    bend = np.mean(shifts, axis=0)
    covariance = known.covariance.copy()
    covariance[finite, finite] += FOURTH * bend**2
    return replace(known, covariance=covariance)


def _across(there: Evaluation, finite: NDArray[np.intp], size: Array, along: Array) -> Array:
    """The Gauss–Newton step across the ridge, in the optimiser's coordinates."""
    assert there.jacobian is not None
    _, _, others = np.linalg.svd(along[None, :])
    scaled = there.jacobian[:, finite] * size @ others[1:].T
    step = np.linalg.lstsq(scaled, -there.residual, rcond=None)[0]
    shift: Array = (others[1:].T @ step) * size
    return shift
