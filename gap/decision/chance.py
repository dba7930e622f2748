"""Whether scatter is scatter: an effect by chance that widens all noise leaves residuals of the size that it says, and
no two neighbours alike."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.stats import norm

from gap.inference.evidence import Hypothesis
from gap.inference.problem import Problem

WIDER = 2.0
"""Times the noise from which on a residual is mostly laid to chance."""
FEWEST = 20
"""Such residuals, or pairs of neighbours, from which they are asked."""


def size_of_chance(problems: Mapping[str, Problem], h: Hypothesis) -> float:
    """Median size of the residuals that a hypothesis lays to chance, over that of normal ones.

    Wide enough noise explains any misfit: a few large residuals then make it far too wide for the others, whose median
    (not their rms) is small. 1 where no noise is widened, or chance is said to hit few samples of many.
    """
    if any(e.sparse for e in h.effects):
        return 1.0
    laid = []
    for block, problem in problems.items():
        fitted = h.fits[block]
        times = problem.noise_scale(fitted.active)
        if times is not None:
            laid.append(np.abs(fitted.residual[times > WIDER]))
    sizes = np.concatenate(laid) if laid else np.empty(0)
    return float(np.median(sizes) / norm.ppf(0.75)) if len(sizes) >= FEWEST else 1.0


def memory_of_chance(problems: Mapping[str, Problem], h: Hypothesis) -> float:
    """Correlation of neighbours among the residuals that a hypothesis lays to chance.

    Where the answer to a step is late as a whole, all its samples are off alike; instants that scatter know nothing of
    each other. 0 where few residuals are laid to chance.
    """
    products, squares, n = 0.0, 0.0, 0
    for block, problem in problems.items():
        fitted = h.fits[block]
        times = problem.noise_scale(fitted.active)
        if times is None:
            continue
        rows, wide = problem.rows, times > WIDER
        next_to = (np.diff(rows.labels["channel"][0]) == 0) & (np.diff(rows.recording) == 0)
        pair = wide[1:] & wide[:-1] & next_to
        first, second = fitted.residual[:-1][pair], fitted.residual[1:][pair]
        products += float(first @ second)
        squares += float(np.linalg.norm(first) * np.linalg.norm(second))
        n += int(np.count_nonzero(pair))
    return products / squares if n >= FEWEST and squares > 0.0 else 0.0


def walk_of_chance(problems: Mapping[str, Problem], h: Hypothesis) -> float:
    """Nats by which readings of a hypothesis walk at random, and not as slow noise or an answer to motion, in the block
    that shows it most; infinite where none walks."""
    found = [n for block, problem in problems.items() if np.isfinite(n := problem.walk_log_bayes(h.fits[block]))]
    return max(found, default=np.inf)
