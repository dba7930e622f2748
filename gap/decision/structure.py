"""The kind of controller that a session shows: one that holds sampled rows, or, as the last resort, a regulator of
unknown structure, which can imitate most effects."""

from __future__ import annotations

from collections.abc import Sequence

from gap.inference.least_squares import fit
from gap.inference.problem import Problem
from gap.null.blocks import Block
from gap.null.suction_pressure import PressureBlock
from gap.search.compare import Comparison

LEAVES = 1.5
"""Times the χ² that a regulator of unknown structure leaves, which the best effect about a known one must leave for it
to be believed: effects of other forms than the library's leave less, as a rule. Pairs are not asked: two of them can be
many a structure."""


def held_rows(problems: Sequence[Problem]) -> list[str]:
    """A remark where the actuator's channels show that sampled commands are held at each row until the next."""
    if not any(p.session.held for p in problems if isinstance(p, Block)):
        return []
    return ["sampled set-points are taken as held from each row to the next: the actuator's channels show it"]


def regulator_unknown(comparison: Comparison) -> bool:
    """Whether a regulator of unknown structure explains a recorded pressure far better than any single effect about one
    that is known."""
    pressures = [(name, p) for name, p in comparison.problems.items() if isinstance(p, PressureBlock)]
    return any(_far_better(comparison, name, p) for name, p in pressures if not p.explained)


def _far_better(comparison: Comparison, name: str, known: PressureBlock) -> bool:
    free = type(known)(known.session, known.library, unknown=True)
    if not free.unknown:
        return False
    # A block's noise is read from the rest of its best simulation: the two are compared by that of the better one.
    fits = [h.fits[name] for h in (comparison.null, *comparison.hypotheses) if len(h.effects) < 2]
    left = [free.whitened(known.unwhitened(f.residual, f.active), {}) for f in fits]
    return min(float(rest @ rest) for rest in left) > LEAVES * fit(free).chi2
