"""Sample-level signatures of channels beside the fits: a mark is evidence for the effect that leaves it, if that
explains something where the mark is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from gap.data.signatures import Signature
from gap.decision.gaps import Shrink
from gap.decision.thresholds import Thresholds
from gap.inference.evidence import Hypothesis
from gap.inference.hypothesis import Candidate
from gap.inference.problem import Problem

ENDS = {"saturation": 1.0, "lower_saturation": -1.0}
"""Marks of values that stand at an end of a channel, and which end that is."""


def made_by(signature: Signature, effect: Candidate) -> bool:
    """Whether ``effect`` is the one that leaves ``signature``."""
    names = {name.removeprefix("sensor_") for name in (signature.effect, *signature.also)}
    where = effect.key.partition("@")[2]
    return effect.name.removeprefix("sensor_") in names and where in ("", signature.channel)


def marked_rows(problem: Problem, signature: Signature) -> NDArray[np.bool_]:
    """Rows (n,) of a problem that a mark is about: those at the channel's end, or all of the channel."""
    codes, names = problem.rows.labels["channel"]
    if signature.channel not in names:
        return np.zeros(len(codes), dtype=bool)
    here = np.asarray(codes == names.index(signature.channel))
    if (sign := ENDS.get(signature.effect)) is None:
        return here
    value = sign * problem.measured
    near: NDArray[np.bool_] = here & (value >= np.max(value[here]) - problem.sigma)
    return near


def at_marks(
    problems: Mapping[str, Problem], null: Hypothesis, h: Hypothesis, signatures: Sequence[Signature]
) -> Shrink | None:
    """The gap where the marks of a hypothesis' effects are, without and with it; None without such rows.

    A defect that makes the noise itself wider, in units of which a gap is told, leaves as much of one as it does.
    """
    if (wider := wider_noise(h, signatures)) > 1.0:
        return Shrink(wider, 1.0)
    before, after, n = 0.0, 0.0, 0
    for name, problem in problems.items():
        for s in signatures:
            if any(made_by(s, e) and name in e.blocks for e in h.effects):
                at = marked_rows(problem, s)
                before += float(np.sum(np.square(null.fits[name].residual[at])))
                after += float(np.sum(np.square(h.fits[name].residual[at])))
                n += int(np.count_nonzero(at))
    return Shrink(float(np.sqrt(before / n)), float(np.sqrt(after / n))) if n else None


def wider_noise(h: Hypothesis, signatures: Sequence[Signature]) -> float:
    """How many times wider a hypothesis' effects make the noise, by their marks."""
    return max((s.noise for s in signatures if any(made_by(s, e) for e in h.effects)), default=1.0)


def certain(h: Hypothesis, signatures: Sequence[Signature]) -> bool:
    """Whether a hypothesis' effects leave a mark that nothing else does."""
    return any(s.certain and made_by(s, e) for s in signatures for e in h.effects)


def explains_marks(at_mark: Shrink | None, t: Thresholds) -> bool:
    """Whether an effect takes away what stands above the noise where its marks are."""
    if at_mark is None or at_mark.before <= t.quiet_gap:
        return False
    return at_mark.before**2 - at_mark.after**2 >= t.mark_share * (at_mark.before**2 - 1.0)
