"""How far the gap shrinks on data that were not used: other repeats, levels, directions and, above all, other
waveforms.

A wrong effect can shrink the gap on the fitted data and their repeats almost as well as the right one; on another
waveform it cannot.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gap.decision.gaps import Shrink, exact
from gap.decision.partial import Masked, with_own_phases
from gap.inference.evidence import Fit, GaussianPrior, Hypothesis
from gap.inference.hypothesis import to_unit, touched
from gap.inference.least_squares import fit, under
from gap.inference.problem import Problem
from gap.inference.workers import each
from sim_devices.chain import FloatArray

Part = tuple[str, str]
"""A split and a block."""
KNOWN = 1e10
"""Precision of an effect's parameters, in prior quantiles, that are as good as given."""


def plain(problems: Mapping[str, Problem], h: Hypothesis, null: Hypothesis | None = None) -> Hypothesis:
    """A hypothesis as a simulation by itself: refitted without the discrepancy that skin of another law may have.

    That is the simulation people have, and its gap the one they see. ``null`` is the plain null, whose fits serve for
    blocks that the effects do not touch; a model that holds it does not end above it.
    """
    changed = touched(h.effects)
    fits = {}
    for block, f in h.fits.items():
        problem = problems[block]
        here = under(problem, f.prior_mean, problem.sd_without_discrepancy)
        if null is not None and block not in changed:
            fits[block] = null.fits[block]
            continue
        if np.array_equal(problem.sd_without_discrepancy, f.prior_sd):
            fits[block] = f
        else:
            nuisance = np.where(problem.sd_without_discrepancy < f.prior_sd, f.prior_mean, f.nuisance)
            fits[block] = fit(here, f.hypothesis, f.unit, nuisance, iterations=15, belief=f.belief)
        if null is not None and fits[block].objective > null.fits[block].objective:
            starts = (f.unit, _switched_off(f))
            tries = [fit(here, f.hypothesis, u, null.fits[block].nuisance, 15, belief=f.belief) for u in starts]
            fits[block] = min([fits[block], *tries], key=lambda other: other.objective)
    return Hypothesis(h.effects, fits)


def _switched_off(f: Fit) -> FloatArray:
    """A fit's effect parameters (k,), with strengths as near to nought as their priors allow."""
    parameters = [p for e in f.hypothesis for p in e.parameters]
    off = [u if p.null is None else to_unit(p, p.null) for p, u in zip(parameters, f.unit.tolist(), strict=True)]
    return np.asarray(off)


def best_elsewhere(held_out: Sequence[Mapping[str, Shrink]], margin: float) -> int:
    """Which of the members of a class meets withheld data best, the first unless another is better by ``margin``, a
    share of the gap: another waveform counts alone, where there is one."""

    def left(by: Mapping[str, Shrink]) -> float:
        judges = [by["waveform"]] if "waveform" in by else list(by.values())
        return float(np.sqrt(np.mean([s.after**2 for s in judges]))) if judges else 0.0

    best = min(range(len(held_out)), key=lambda k: left(held_out[k]))
    return best if left(held_out[best]) < (1.0 - margin) * left(held_out[0]) else 0


TOLD = 0.01
"""Share of what a session tells of an effect's parameter, as the information of a straight line, that recordings must
have to be asked for it."""


class Carried(NamedTuple):
    """How far the gap shrinks on withheld recordings, by split: of the whole session, and in the blocks that an answer
    changes, which nothing else in the session dilutes."""

    session: Mapping[str, Shrink]
    changed: Mapping[str, Shrink]


def transferred(
    problems: Mapping[str, Problem],
    null: Hypothesis,
    answers: Sequence[Hypothesis],
    withheld: Mapping[str, set[int]],
    jobs: int = 1,
) -> list[Carried]:
    """For each of the ``answers`` and each split: fit it without the ``withheld`` recordings, hold what that says of
    the effect, and see how well these can be met with it; before, how well they can be met without. Splits that leave
    nothing to say of it are no test, and are left out.

    Only the effect has to carry over: tissue and calibration are fitted to the withheld recordings, too, as whether a
    person's skin follows our law to another waveform is not the effect's doing.
    """
    outs = _withheld_rows(problems, null, withheld)
    before = {(s, b): _left(null.fits[b], out) for (s, b), out in outs.items()}
    tests = {id(h): [s for s in withheld if _told_without(h, s, outs)] for h in answers}
    parts = [(h, s, b) for h in answers for s, b in outs if b in touched(h.effects) and s in tests[id(h)]]
    left = each(lambda part: _carried(problems[part[2]], part[0].fits[part[2]], outs[part[1:]]), parts, jobs)
    found = {(id(h), s, b): x for (h, s, b), x in zip(parts, left, strict=True)}

    def shrunk(answer: Hypothesis, blocks: Collection[str]) -> dict[str, Shrink]:
        after = {key: found.get((id(answer), *key), was) for key, was in before.items()}
        parts = {s: {p: out for p, out in outs.items() if p[0] == s and p[1] in blocks} for s in tests[id(answer)]}
        return {s: _shrunk(own, before, after) for s, own in parts.items()}

    return [Carried(shrunk(h, problems), shrunk(h, touched(h.effects))) for h in answers]


def _told_without(h: Hypothesis, split: str, outs: Mapping[Part, NDArray[np.bool_]]) -> bool:
    """Whether the recordings that a split leaves tell anything of an answer's effects: an event that only withheld ones
    show is not tested by it."""
    blocks = touched(h.effects)
    rows = [(h.fits[b].effect_jacobian, out) for (s, b), out in outs.items() if s == split and b in blocks]
    told = [(np.sum(np.square(j), axis=0), np.sum(np.square(j[~out]), axis=0)) for j, out in rows]
    return not told or any(bool(np.any((whole > 0.0) & (kept >= TOLD * whole))) for whole, kept in told)


def _withheld_rows(
    problems: Mapping[str, Problem], null: Hypothesis, withheld: Mapping[str, set[int]]
) -> dict[Part, NDArray[np.bool_]]:
    """The rows (n,) of each split and block that are ``withheld``, where some are and others not; no arithmetic."""
    blocks = [(b, p.rows.recording) for b, p in problems.items() if not exact(null.fits[b])]
    outs = {(s, b): np.isin(recording, list(out)) for s, out in withheld.items() for b, recording in blocks}
    return {part: out for part, out in outs.items() if out.any() and not out.all()}


def _shrunk(
    outs: Mapping[Part, NDArray[np.bool_]], before: Mapping[Part, float], after: Mapping[Part, float]
) -> Shrink:
    """The gap on the rows ``outs`` (n,) of some parts, by the χ² that is left there ``before`` and ``after``."""
    n = sum(np.count_nonzero(out) for out in outs.values())
    if not n:
        return Shrink(1.0, 1.0)
    gaps = [float(np.sqrt(sum(left[part] for part in outs) / n)) for left in (before, after)]
    return Shrink(gaps[0], gaps[1], int(n))


def _left(f: Fit, out: NDArray[np.bool_]) -> float:
    """χ² of a fit on the rows ``out`` (n,), with their share of what tolerances are strained by."""
    return float(f.residual[out] @ f.residual[out]) + (f.penalty - f.belief.cost(f.unit)) * float(np.mean(out))


def _carried(problem: Problem, full: Fit, out: NDArray[np.bool_]) -> float:
    """`_left` with an effect whose parameters are fitted without the rows ``out`` (n,), and all else with them, and so
    is when a rhythm begins in each withheld recording."""
    problem = under(problem, full.prior_mean, full.prior_sd)
    masked = Masked(problem, ~out)
    trained = fit(
        masked, full.hypothesis, full.unit, full.nuisance, iterations=5, jacobian=full.jacobian * ~out[:, None],
        belief=full.belief,
    )  # fmt: skip
    known = GaussianPrior(trained.unit, KNOWN * np.eye(len(trained.unit)))
    there = with_own_phases(problem, trained, out)
    held = fit(
        there, full.hypothesis, trained.unit, full.nuisance, iterations=8, jacobian=full.jacobian, gram=full.gram,
        belief=known,
    )  # fmt: skip
    return _left(held, out)
