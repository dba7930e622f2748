"""Effects within tolerance are part of the simulation: others are looked for beside them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from gap.decision.classes import Cause, concept
from gap.decision.tolerance import Stated, in_stated
from gap.inference.evidence import Hypothesis
from gap.search.compare import Comparison


def tolerated(
    comparison: Comparison, stated: Stated, within: float, known: Callable[[Hypothesis], bool] = lambda h: False
) -> list[Cause]:
    """Single effects of ``within`` stated tolerances at most that explain the blocks that they touch better than
    nothing and than any other single effect does; but for those ``known`` to be more.

    Such an effect is no finding, but a simulation without it leaves a rest that other effects would be told for."""
    weighed = comparison.weighed(comparison.temper())
    earned = {id(h): weighed[id(h)].evidence - weighed[id(comparison.null)].evidence for h in comparison.hypotheses}
    singles = sorted((h for h in comparison.hypotheses if len(h.effects) == 1), key=lambda h: -earned[id(h)])
    found, judged = [], set[str]()
    for h in singles:
        if earned[id(h)] <= 0.0:
            break
        blocks = set(h.effects[0].blocks)
        if not judged & blocks and in_stated(h.effects[0], h, stated) <= within and not known(h):
            found.append(Cause(h, (concept(h),), 0.0, float(np.sqrt(2.0 * earned[id(h)])), (h,)))
        judged |= blocks
    return found


def beside(comparison: Comparison, taken: Sequence[Cause], least: float = 0.0) -> Comparison:
    """The comparison with the effects ``taken`` on by the simulation: its fits are theirs in the blocks that they
    touch, and a pair with one of them is the other effect alone, where that takes away at least a share of what the
    first one does: less may be the first one's form. Effects that touch none of these blocks have the simulation's
    fits there."""
    if not taken:
        return comparison
    fits = {b: c.hypothesis.fits[b] for c in taken for b in c.effects[0].blocks}
    part = {c.effects[0]: c.hypothesis for c in taken}
    before = comparison.null.deviance
    hypotheses = []
    for h in comparison.hypotheses:
        alone = len(h.effects) == 1
        others = h.effects if alone else tuple(e for e in h.effects if e not in part)
        first = next((part[e] for e in h.effects if e in part), None)
        if first is not None and (alone or first.deviance - h.deviance < least * (before - first.deviance)):
            continue
        untouched = fits.keys() - {b for e in others for b in e.blocks}
        if others == h.effects or (others and len(untouched) < len(fits)):
            hypotheses.append(Hypothesis(others, h.fits | {b: fits[b] for b in untouched}))
    return replace(comparison, null=Hypothesis((), comparison.null.fits | fits), hypotheses=hypotheses)


def told(taken: Sequence[Cause], stated: Stated) -> list[str]:
    """Remarks on effects that the simulation has taken on."""
    sizes = [(c.effects[0].name, in_stated(c.effects[0], c.hypothesis, stated)) for c in taken]
    return [
        f"the simulation takes on {name} of {size:.1f} stated tolerances, which is no finding" for name, size in sizes
    ]
