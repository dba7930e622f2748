"""Effects within tolerance are part of the simulation: others are looked for beside them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from gap.decision.classes import Cause, concept
from gap.decision.tolerance import Stated, in_stated
from gap.inference.evidence import Fit, Hypothesis
from gap.inference.hypothesis import Candidate, touched
from gap.search.compare import Comparison


def tolerated(
    comparison: Comparison,
    stated: Stated,
    within: float,
    seen: float,
    known: Callable[[Hypothesis], bool] = lambda h: False,
) -> list[Cause]:
    """Single effects of ``within`` stated tolerances at most that stand out by ``seen`` σ and explain the blocks that
    they touch better than any other single effect does; but for those ``known`` to be more.

    Such an effect is no finding, but a simulation without it leaves a rest that other effects would be told for."""
    weighed = comparison.weighed(comparison.temper())
    earned = {id(h): weighed[id(h)].evidence - weighed[id(comparison.null)].evidence for h in comparison.hypotheses}
    singles = sorted((h for h in comparison.hypotheses if len(h.effects) == 1), key=lambda h: -earned[id(h)])
    found, judged = [], set[str]()
    for h in singles:
        if 2.0 * earned[id(h)] < seen**2:
            break
        blocks = set(h.effects[0].blocks)
        size = np.inf if judged & blocks else in_stated(h.effects[0], h, comparison.null, stated)
        if size <= within and not known(h):
            found.append(Cause(h, (concept(h),), 0.0, float(np.sqrt(2.0 * earned[id(h)])), (h,), size=size))
        judged |= blocks
    return found


def beside(comparison: Comparison, taken: Sequence[Cause], least: float) -> Comparison:
    """The comparison with the effects ``taken`` on by the simulation: its fits are theirs in the blocks that they
    touch, and a pair with one of them is the other effect alone, where that takes away at least a share of ``least`` of
    the first one's: less may be the first one's form. Effects that touch none of these blocks have the simulation's
    fits there."""
    if not taken:
        return comparison
    fits = {b: c.hypothesis.fits[b] for c in taken for b in c.effects[0].blocks}
    part = {c.effects[0]: c.hypothesis for c in taken}
    alone = {h.effects for h in comparison.hypotheses}
    kept = [h for h in comparison.hypotheses if _adds(h, part, comparison.null, least)]
    without = [(tuple(e for e in h.effects if e not in part), h) for h in kept]
    new = [
        (others, h) for others, h in without if others == h.effects or others not in alone or not _apart(others, fits)
    ]
    hypotheses = [_with(fits, others, h) for others, h in new if others]
    return replace(comparison, null=Hypothesis((), comparison.null.fits | fits), hypotheses=hypotheses)


def _apart(effects: Sequence[Candidate], fits: Mapping[str, Fit]) -> bool:
    """Whether effects touch none of the blocks of ``fits``: then a pair without its part within tolerance is what its
    other effect is by itself."""
    return touched(effects).isdisjoint(fits)


def _with(fits: Mapping[str, Fit], effects: tuple[Candidate, ...], h: Hypothesis) -> Hypothesis:
    """A hypothesis of ``effects`` with ``fits`` where they touch nothing, and those of ``h`` elsewhere."""
    return Hypothesis(effects, {**h.fits, **{b: f for b, f in fits.items() if b not in touched(effects)}})


def _adds(h: Hypothesis, part: Mapping[Candidate, Hypothesis], null: Hypothesis, least: float) -> bool:
    """Whether a hypothesis takes away a share of ``least`` beside the effect within tolerance that is part of it."""
    first = next((part[e] for e in h.effects if e in part), None)
    return first is None or first.deviance - h.deviance >= least * (null.deviance - first.deviance)


def told(taken: Sequence[Cause]) -> list[str]:
    """Remarks on effects that the simulation has taken on."""
    return [
        f"the simulation takes on {c.effects[0].name} of {c.size:.1f} stated tolerances, which is no finding"
        for c in taken
    ]
