"""How late a recorded pressure, or the axes, answer each kink of their command."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gap.inference.evidence import Fit
from gap.inference.hypothesis import Active, Lateness
from gap.inference.problem import Problem
from sim_devices.chain import FloatArray

TOGETHER, RESPONSE = 5e-3, 0.8
"""s: kinks nearer to each other are one; how long after one its response is looked at."""
LATE = 5.0
"""σ by which some kink must be late for lateness to be looked into."""
MOVES = 1e-3 * np.array([0.5, 1, 2, 3, 5, 8, 12, 18, 26, 36, 50, 70, 95, 130, 180, 250, 350])
"""s by which the response to a kink is moved to see where it fits."""
QUIET = 1e-6
"""Share of the most telling kink's information on lateness below which a kink says nothing."""


def lateness(
    problem: Problem,
    fitted: Fit,
    kinks: FloatArray,
    steps: FloatArray,
    begins: Sequence[float],
    shift: int,
    others: Sequence[FloatArray],
    intervals: Sequence[float] = (),
) -> Lateness | None:
    """Each kink's response, until the next, moved to and fro as a whole by the nuisance ``shift``, s. ``kinks`` (k,) s
    and those of them that are ``steps`` (m,) s are the command's, ``intervals`` s those between looks at it that a
    ripple may tell, and recordings begin at ``begins`` s. Of several ``others`` than the fitted nuisance (p,) the one
    beside which the responses fit best counts: what is fitted may have taken on much of the effect."""
    kinks = kinks[np.diff(kinks, prepend=-np.inf) > TOGETHER]
    number = np.searchsorted(kinks, problem.rows.time, side="right") - 1
    number[(number < 0) | (problem.rows.time - kinks[number] > RESPONSE)] = len(kinks)
    slope = fitted.jacobian[:, shift]

    def over(values: FloatArray) -> FloatArray:
        return np.bincount(number, values, len(kinks) + 1)[:-1].astype(float)

    known = over(slope**2)
    telling = known > QUIET * np.max(known)
    if not np.any(telling & (over(slope * fitted.residual) ** 2 > LATE**2 * known)):
        none = np.zeros(0)
        return Lateness(none, none, none, none.astype(bool), tuple(intervals)) if intervals else None
    seen = [_late(problem, n, shift, fitted.active, number, telling) for n in others]
    late, sd = min(seen, key=lambda found: float(np.median(found[1][telling])))
    good = np.isfinite(sd)
    own = kinks[good] - np.array(begins)[np.maximum(np.searchsorted(begins, kinks[good], side="right") - 1, 0)]
    return Lateness(kinks[good], late[good], sd[good], np.isin(kinks[good], steps), tuple(intervals), own)


def _late(
    problem: Problem,
    nuisance: FloatArray,
    shift: int,
    active: Active,
    number: NDArray[np.int64],
    telling: NDArray[np.bool_],
) -> tuple[FloatArray, FloatArray]:
    """How late, s, the responses (k,) are that are ``telling``, and the standard deviations of that. ``number`` (n,)
    says to which kink a row responds."""
    moved = np.concatenate([-MOVES[::-1], [0.0], MOVES])
    rows, chi2 = [], []
    for move in moved:
        there = nuisance.copy()
        there[shift] -= move
        rows.append(problem.evaluate(there, active, want_jacobian=False).residual)
        chi2.append(np.bincount(number, rows[-1] ** 2, len(telling) + 1)[:-1])
    best = np.clip(np.argmin(chi2, axis=0), 1, len(moved) - 2)
    late, sd = np.zeros(len(telling)), np.full(len(telling), np.inf)
    for k in np.flatnonzero(telling):
        at, j = number == k, best[k]
        change = (rows[j + 1][at] - rows[j - 1][at]) / (moved[j + 1] - moved[j - 1])
        square = float(change @ change)
        if square > 0:
            step = -float(change @ rows[j][at]) / square
            late[k] = moved[j] + np.clip(step, moved[j - 1] - moved[j], moved[j + 1] - moved[j])
            sd[k] = np.sqrt(1.0 / square) * max(1.0, np.sqrt(chi2[j][k] / at.sum()))
    return late, sd
