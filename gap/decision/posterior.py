"""How probable each explanation is: one simplex of no effect, classes of effects, and causes the library lacks.

Probabilities are tempered Laplace evidences with a prior over *numbers of effects*, raised to each block's
`Problem.likelihood_powers`. A channel's own marks are evidence beside it, for effects that explain something. How much
of what is left no explanation reaches says how probable it is that the cause is outside the library."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.special import softmax

from gap.data.signatures import HUM, Signature
from gap.decision.classes import Cause, Scored, nats_without_skin
from gap.decision.gaps import exact, excess_left, gap_of, noisy, worst_gap
from gap.decision.marks import at_marks, certain, explains_marks, made_by, wider_noise
from gap.decision.priors import log_priors
from gap.decision.thresholds import Thresholds
from gap.decision.tolerance import Stated, in_stated, weakest
from gap.inference.evidence import Hypothesis
from gap.inference.hypothesis import Candidate, touched
from gap.search.compare import Comparison, Weight
from sim_devices.chain import FloatArray


@dataclass(frozen=True)
class Posterior:
    """``none`` + the causes' probabilities + ``outside`` = 1.

    ``stages`` adds up the causes by stage. ``unexplained`` is the share of the excess χ² that the best explanation
    leaves, ``lacking`` how surely that is of something in no library (of an effect of the instrument that blocks
    without skin show, by these); ``gap_before`` and ``gap_after`` are the gaps (rms in σ) without and with it, skin of
    another law allowed for, ``gap_worst`` that of one block without it. ``foreign`` is how probable it is that
    something else acts where none of the library's effects does, ``acts`` that one of them does rather than nothing.
    ``temper`` divides each block's χ²; ``hum`` is a line in a channel's noise.
    """

    causes: tuple[Cause, ...]
    none: float
    outside: float
    stages: Mapping[str, float]
    unexplained: float
    lacking: float
    gap_before: float
    gap_after: float
    gap_worst: float
    foreign: float
    temper: Mapping[str, float]
    acts: float = 0.0
    hum: bool = False

    @property
    def named(self) -> float:
        """Probability that a known effect acts."""
        return sum(c.probability for c in self.causes)

    def scaled(self, share: float, to_outside: float) -> Posterior:
        """The causes' probabilities times ``share``; of their loss, ``to_outside`` goes there and the rest to none."""
        freed = (1.0 - share) * self.named
        return replace(
            self,
            causes=tuple(replace(c, probability=share * c.probability) for c in self.causes),
            stages={s: share * p for s, p in self.stages.items()},
            none=self.none + (1.0 - to_outside) * freed,
            outside=self.outside + to_outside * freed,
        )

    def doubted(self, least: float) -> Posterior:
        """The same with a probability of ``least`` that the cause is outside the library, the rest in proportion."""
        if self.outside >= least:
            return self
        share = (1.0 - least) / (1.0 - self.outside)
        return replace(self.scaled(share, 1.0), none=share * self.none, outside=least)

    def with_tolerated(self, taken: Sequence[Cause], share: float) -> Posterior:
        """With effects within tolerance among the causes, which the data show though they are no finding: each has an
        equal part of ``share`` of the probability of none, or the one that stands out the most, if it does so more than
        the first cause, what that one had."""
        if not taken:
            return self
        each = share * self.none / len(taken)
        added = sorted((replace(c, probability=each, tolerated=True) for c in taken), key=lambda c: -c.detectability)
        causes, stages = list(self.causes), dict(self.stages)
        for c in added:
            _add(stages, c, each)
        if causes and causes[0].detectability < added[0].detectability and causes[0].probability > each:
            first, best = causes[0], added[0]
            _add(stages, first, each - first.probability)
            _add(stages, best, first.probability - each)
            causes[0], added[0] = replace(first, probability=each), replace(best, probability=first.probability)
        causes = sorted([*added, *causes], key=lambda c: -c.probability)
        return replace(self, causes=tuple(causes), none=(1.0 - share) * self.none, stages=_ranked(stages))

    def led_by(self, leader: Hypothesis) -> Posterior:
        """The same with another leader of the first class."""
        return replace(self, causes=(self.causes[0].led_by(leader), *self.causes[1:]))


def misfit(unexplained: float, gap: float) -> float:
    """How surely the cause is none of the library's: from the share of the excess χ² that the best explanation leaves,
    and from how far above the noise the ``gap`` is that it leaves."""
    excess = max(gap - 1.0, 0.0)
    return float(1.0 - np.exp(-2.2 * unexplained * excess / (excess + 0.3)))


def foreign(gap: float, t: Thresholds) -> float:
    """How surely something acts that is in no library, where the simulation by itself leaves ``gap`` and no effect
    helps: even odds at the unusual gap, none within the noise."""
    above = max(gap - t.quiet_gap, 0.0) / (t.unusual_gap - t.quiet_gap)
    return float(1.0 - 2.0**-above)


def posterior(
    comparison: Comparison,
    candidates: Sequence[Candidate],
    t: Thresholds,
    signatures: Sequence[Signature] = (),
    gap: float | None = None,
    beforehand: Callable[[Hypothesis], float] = lambda h: 0.0,
    stated: Stated | None = None,
) -> Posterior:
    """The posterior of a comparison. ``gap`` is the simulation's own (default: as compared), ``signatures`` are the
    channels' own marks, ``beforehand`` the nats of a hypothesis by the instrument's qualification, ``stated`` its
    tolerances."""
    temper = comparison.temper()
    weighed = comparison.weighed(temper)
    every = [comparison.null, *comparison.hypotheses]
    prior = log_priors(every, candidates, t) + np.array([beforehand(h) for h in every])
    score = prior + _earned_alone(every, comparison, weighed, signatures, t)
    by_chance = {c.candidate for c in comparison.screened if c.by_chance}
    unmarked = {e for e in by_chance if not any(made_by(s, e) for s in signatures)}
    score = _with_earned_pairs(score, every, comparison, weighed, t, temper, stated or {}, unmarked)
    # Whether anything acts is one question, its name another: a weak effect often answers the second.
    acts = 1.0 - float(softmax(score)[0])
    share = np.r_[0.0, softmax(score[1:])] if len(score) > 1 else np.zeros(1)
    skin = frozenset(name for name, p in comparison.problems.items() if p.sound is None)
    causes = Scored(every, score, share, weighed, temper, t, signatures, skin).classes()
    causes = [_marked(c, comparison, signatures, t) for c in causes]
    gaps = _gaps(comparison, causes, temper, t)
    hum = any(s.effect == HUM for s in signatures)
    strange = 1.0 if hum else foreign(max(gaps.before if gap is None else gap, gaps.worst), t)
    lacking = _lacking(causes[0], gaps.lacking, t) if causes else 1.0
    known = acts * (1.0 - lacking)
    return Posterior(
        causes=tuple(replace(c, probability=known * c.probability) for c in causes),
        none=(1.0 - acts) * (1.0 - strange),
        outside=(1.0 - acts) * strange + acts * lacking,
        stages=_by_stage(every[1:], known * share[1:]),
        unexplained=gaps.left,
        lacking=gaps.lacking,
        gap_before=gaps.before,
        gap_after=gaps.after,
        gap_worst=gaps.worst,
        foreign=strange,
        temper=temper,
        acts=acts,
        hum=hum,
    )


class _Gaps(NamedTuple):
    """The gaps without and with the first cause, that of the worst block without it, the share of the excess χ² that it
    leaves, and how surely that lacks something."""

    before: float
    after: float
    worst: float
    left: float
    lacking: float


def _gaps(comparison: Comparison, causes: Sequence[Cause], temper: Mapping[str, float], t: Thresholds) -> _Gaps:
    """Of the blocks that hold noise; of an effect in mere arithmetic, of that as well: it is there that it explains."""
    null = comparison.null
    changed = touched(causes[0].effects) if causes else set()
    alone = sorted(changed) if all(exact(null.fits[b]) for b in changed) else []
    where = list(dict.fromkeys([*noisy(null), *alone]))
    before, worst = gap_of(null, where), worst_gap(null)
    if not causes:
        return _Gaps(before, before, worst, 1.0, misfit(1.0, before))
    first = causes[0].hypothesis
    after, left = gap_of(first, where), excess_left(null, first, where)
    judges = _judges(causes[0], comparison, temper, t, where)
    lacking = misfit(excess_left(null, first, judges), gap_of(first, judges))
    return _Gaps(before, after, worst, left, lacking)


def _judges(
    first: Cause, comparison: Comparison, temper: Mapping[str, float], t: Thresholds, where: Sequence[str]
) -> Sequence[str]:
    """The blocks, of those ``where`` gaps are told, that say whether the first cause lacks something: of an effect of
    the instrument that blocks without skin tell surely these alone, as the rest of skin of another law is not its
    doing."""
    nats = nats_without_skin(first, comparison, temper, t.unusual_gap)
    without = [b for b in where if b in nats]
    sure = sum(nats[b] for b in without) > t.without_skin
    return without if sure and not first.of_skin else where


def _lacking(first: Cause, found: float, t: Thresholds) -> float:
    """The probability that the library lacks the cause, where its best explanation leaves a gap; one that explains its
    marks acts, whatever else does."""
    return t.prior_outside if explains_marks(first.at_marks, t) else max(t.prior_outside, found)


def _earned_alone(
    every: Sequence[Hypothesis],
    comparison: Comparison,
    weighed: Mapping[int, Weight],
    signatures: Sequence[Signature],
    t: Thresholds,
) -> FloatArray:
    """Nats of each hypothesis by its fits and the channels' marks, less for strengths at the end of their range."""
    marks = np.array([_mark_nats(h, comparison, weighed, signatures, t) for h in every])
    at_bound = t.at_bound * np.array([weakest(h, t.weakest) for h in every])
    return np.asarray(np.array([weighed[id(h)].evidence for h in every]) + marks - at_bound)


def _by_stage(hypotheses: Sequence[Hypothesis], probability: FloatArray) -> dict[str, float]:
    """The probability of every stage that an effect acts in, the most probable first."""
    stages: dict[str, float] = {}
    for h, p in zip(hypotheses, probability, strict=True):
        for e in h.effects:
            stages[e.stage] = stages.get(e.stage, 0.0) + float(p) / len(h.effects)
    return _ranked(stages)


def _add(stages: dict[str, float], cause: Cause, probability: float) -> None:
    """Give the ``stages`` of a cause's effects so much more ``probability``, in equal parts."""
    for e in cause.effects:
        stages[e.stage] = max(stages.get(e.stage, 0.0) + probability / len(cause.effects), 0.0)


def _ranked(stages: Mapping[str, float]) -> dict[str, float]:
    return dict(sorted(stages.items(), key=lambda one: -one[1]))


def _mark_nats(
    h: Hypothesis,
    comparison: Comparison,
    weighed: Mapping[int, Weight],
    signatures: Sequence[Signature],
    t: Thresholds,
) -> float:
    """Nats that the channels' marks add to a hypothesis: of an effect that explains nothing they say nothing. A defect
    that makes the noise is told by its marks, as its simulation foretells no sample of it; whatever else acts, this
    does, unless the mark says that something else may lead."""
    nats = sum(s.nats for s in signatures if any(made_by(s, e) for e in h.effects))
    null = weighed[id(comparison.null)].evidence
    gain = weighed[id(h)].evidence - null
    if len(h.effects) == 1 and (wider_noise(h, signatures) > t.quiet_gap or certain(h, signatures)):
        if not any(s.alone for s in signatures if made_by(s, h.effects[0])):
            return nats + max(gain, 0.0) - gain
        # Its best form is as good as any hypothesis, also where it foretells the samples worse than none at all does;
        # its others are as far behind as they fit worse.
        best = max(w.evidence for w in weighed.values())
        forms = [o for o in comparison.hypotheses if len(o.effects) == 1 and o.effects[0].name == h.effects[0].name]
        return nats + best - max(weighed[id(o)].evidence for o in forms)
    if nats and (gain > 0 or explains_marks(at_marks(comparison.problems, comparison.null, h, signatures), t)):
        return min(nats, t.mark)
    return 0.0


def _marked(cause: Cause, comparison: Comparison, signatures: Sequence[Signature], t: Thresholds) -> Cause:
    """A cause with the evidence of the channels' marks."""
    h = cause.hypothesis
    if not any(made_by(s, e) for s in signatures for e in h.effects):
        return cause
    at = at_marks(comparison.problems, comparison.null, h, signatures)
    sure = certain(h, signatures)
    return replace(cause, marked=True, at_marks=at, noise=wider_noise(h, signatures), certain=sure)


def _with_earned_pairs(
    score: FloatArray,
    every: Sequence[Hypothesis],
    comparison: Comparison,
    weighed: Mapping[int, Weight],
    t: Thresholds,
    temper: Mapping[str, float],
    stated: Stated,
    unmarked: Set[Candidate],
) -> FloatArray:
    """Scores in which a pair that does not earn its second effect stays below the best single effect: the second is
    to be looked for next, and no more. Nor does a pair earn anything that explains less than one other effect whose
    form a second one repairs a little."""
    single = max((s for s, h in zip(score, every, strict=True) if len(h.effects) == 1), default=score[0])
    unearned = np.array([not _earned(h, comparison, weighed, t, temper, stated, unmarked) for h in every])
    repaired = [(s, h) for s, h, un in zip(score, every, unearned, strict=True) if un and not unmarked & {*h.effects}]
    for k, h in enumerate(every):
        if len(h.effects) > 1 and not unearned[k]:
            unearned[k] = any(s > score[k] and not {*h.effects} & {*other.effects[:1]} for s, other in repaired)
    return np.where(unearned, np.minimum(score, single - t.unearned), score)


def _earned(
    h: Hypothesis,
    comparison: Comparison,
    weighed: Mapping[int, Weight],
    t: Thresholds,
    temper: Mapping[str, float],
    stated: Stated,
    unmarked: Set[Candidate],
) -> bool:
    """Whether each further effect of a hypothesis is seen itself, above the noise, is no tolerance, and explains enough
    of the rest that fewer leave; form errors are always worth some χ². One by chance that left no mark is none: noise
    that is wider where signals are steep repairs every form error there."""
    if len(h.effects) < 2:
        return True
    if _one_event(h, t.at_once) or any(in_stated(e, h, comparison.null, stated) <= t.tolerances for e in h.effects):
        return False
    singles = [s for s in comparison.hypotheses if len(s.effects) == 1 and s.effects[0] in h.effects]
    best = max(singles, key=lambda s: weighed[id(s)].evidence)
    second = [e for e in h.effects if e not in best.effects]
    if unmarked & set(second):
        return False
    if all(_at_noise(best, b, comparison, t) for e in second for b in e.blocks):
        return False
    if 2 * (weighed[id(h)].evidence - weighed[id(best)].evidence) < t.seen_of(second) ** 2:
        return False
    n = sum(len(f.residual) for f in h.fits.values())
    left = min(s.deviance for s in singles)
    least = t.second_least * min(temper.values())
    needed = max(t.second_share * (left - n), t.second_excess * (comparison.null.chi2 - n), least)
    return left - h.deviance > needed


def _at_noise(h: Hypothesis, block: str, comparison: Comparison, t: Thresholds) -> bool:
    """Whether a hypothesis leaves nothing of a block above the noise; of skin, no more than skin of another law may."""
    least = t.second_above**2 if comparison.problems[block].sound is None else 1.0
    return h.fits[block].chi2 < least * len(h.fits[block].residual)


def _one_event(h: Hypothesis, at_once: float) -> bool:
    """Whether two of a hypothesis' effects happen at the same time, to ``at_once`` s: one of another form would."""
    known = {e: values for f in h.fits.values() for e, values in f.active.items() if e.event}
    moments = sorted(values["moment"] for values in known.values() if "moment" in values)
    return any(later - earlier < at_once for earlier, later in pairwise(moments))
