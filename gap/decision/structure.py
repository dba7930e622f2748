"""The kind of controller and sampling that a session shows: rows that are held, samples that are means, or, as the last
resort, a regulator of unknown structure, which can imitate most effects."""

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


def conventions(problems: Sequence[Problem]) -> list[str]:
    """Remarks where the actuator's channels show that commands are held, or samples taken, otherwise than usual."""
    sessions = [p.session for p in problems if isinstance(p, Block)]
    told = {
        "sampled set-points are taken as held from each row to the next": any(s.held for s in sessions),
        "samples are taken as means over a sampling period": any(s.averaged for s in sessions),
    }
    return [f"{words}: the actuator's channels show it" for words, shown in told.items() if shown]


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
