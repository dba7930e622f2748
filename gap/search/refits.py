"""Fits of one effect more: everything refitted jointly, block after block, with one strength in all of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from gap.inference.evidence import DISCOUNT, Fit, Hypothesis
from gap.inference.hypothesis import Candidate
from gap.inference.least_squares import fit, under
from gap.inference.problem import Problem
from gap.search.edges import moved, sharpened
from gap.search.screening import Screened, as_open, strains

APART = 3.0
"""Standard deviations, as one block's fit is believed in the next, between strengths that are not the same."""
UNSURE = 0.15
"""Standard deviation of all of its parameters, in quantiles of their priors (of a uniform one .29), from which on an
effect is as good as unknown."""


def refit(problems: dict[str, Problem], base: Hypothesis, screened: Screened) -> tuple[dict[str, Fit], int]:
    """Fits of ``base`` and one effect more in the blocks that the effect touches, and the number of simulations.

    An effect is the same in every block, and what one says of it the next one believes, but not wholly. Where a later
    block then tells another strength, and more surely, it goes first.
    """
    order, candidate = tuple(screened.starts), screened.candidate
    fits, simulations = _in_turn(problems, base, screened, order)
    surest = Hypothesis((candidate,), fits).surest(candidate)
    if surest != order[0] and _apart(fits, surest, candidate):
        there = (*screened.starts[surest], fits[surest].told(candidate)[0])
        begun = replace(screened, starts=screened.starts | {surest: there})
        fits, more = _in_turn(problems, base, begun, (surest, *(b for b in order if b != surest)))
        simulations += more
    return {b: fits[b] for b in order}, simulations


def belied(problems: Mapping[str, Problem], fits: Mapping[str, Fit]) -> bool:
    """Whether fits, a block each, do not do what their effects are called for."""
    return any(problems[b].belies(f) for b, f in fits.items())


def _apart(fits: dict[str, Fit], surest: str, candidate: Candidate) -> bool:
    """Whether another block's fit has another strength than the ``surest`` one's."""
    own, sd = fits[surest].told(candidate)
    strengths = np.array([p.null is not None for p in candidate.parameters])
    others = np.array([f.told(candidate)[0] for f in fits.values()])
    return bool(np.any(strengths & (np.abs(others - own) > APART * DISCOUNT * sd)))


def _tells(found: Fit, candidate: Candidate) -> bool:
    """Whether a block's fit knows any parameter of an effect better than its prior does: one that hardly sees the
    effect is no place for others to begin from."""
    return bool(np.any(found.told(candidate)[1] < UNSURE))


def _in_turn(
    problems: dict[str, Problem], base: Hypothesis, screened: Screened, order: Sequence[str]
) -> tuple[dict[str, Fit], int]:
    """The same, block after block in ``order``."""
    fits: dict[str, Fit] = {}
    simulations = 0
    known: Fit | None = None
    for block in order:
        fits[block], n = _refitted(problems[block], base.fits[block], screened, block, known)
        simulations += n
        if known is not None or _tells(fits[block], screened.candidate):
            known = fits[block]
    return fits, simulations


def _refitted(problem: Problem, before: Fit, screened: Screened, block: str, known: Fit | None) -> tuple[Fit, int]:
    """The fit of one block, which believes the one that is ``known`` of another; and the number of simulations.

    A few steps from each of the best screening points, and from where the tissue alone would go with the effect, also
    as if its law were known; then the best to convergence, under the most probable width of the prior.
    """
    candidate = screened.candidate
    hypothesis = (*before.hypothesis, candidate)
    belief = before.belief.joined(len(candidate.parameters), known)
    starts = screened.starts[block] if known is None else (belief.mean[len(before.unit) :],)
    from_base = partial(fit, jacobian=before.jacobian, gram=before.gram, belief=belief)
    tries = []
    for unit in starts:
        start = np.concatenate([before.unit, unit])
        width = as_open(screened.widths[block], before)
        here = under(problem, before.prior_mean, width)
        tries.append(from_base(here, hypothesis, start, before.nuisance, 5))
        if problem.sound is not None and strains(problem, before):  # tolerances that took the effect on
            tries.append(fit(here, hypothesis, start, problem.sound, 5, belief=belief))
        if len(tries) == 1 and (warm := problem.warm_start(hypothesis, start)) is not None:
            for sd in (warm.sd,) if width is warm.sd else (width, warm.sd):
                there, near = under(problem, warm.mean, sd), warm.jacobian if sd is warm.sd else None
                tries.append(fit(there, hypothesis, warm.unit, warm.nuisance, 5, jacobian=near, belief=belief))
    best = max(tries, key=lambda f: promise(f, problem))
    if screened.sure:  # where the data show it to be, once more: on the way to the right skin it may have left
        there = under(problem, best.prior_mean, best.prior_sd)
        unit = np.concatenate([before.unit, starts[0]])
        tries.append(fit(there, hypothesis, unit, best.nuisance, 10, belief=belief))
        best = max(tries, key=lambda f: promise(f, problem))
    simulations = sum(f.simulations for f in tries)
    final = under(problem, best.prior_mean, best.best_prior(problem.prior_scales))
    found = fit(final, hypothesis, best.unit, best.nuisance, belief=belief)
    if promise(found, problem) < promise(best, problem):  # begun where another law had put the skin, and lost
        simulations += found.simulations
        final = under(problem, best.prior_mean, best.prior_sd)
        found = fit(final, hypothesis, best.unit, best.nuisance, belief=belief)
    found = sharpened(final, moved(final, found))
    return found, simulations + found.simulations


def promise(fitted: Fit, problem: Problem) -> float:
    """log evidence of a fit as far as the noise is believed wholly, over all widths of the prior."""
    return fitted.log_evidence(1.0, problem.prior_scales)
