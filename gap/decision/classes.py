"""Classes of explanations that the data cannot split: they predict alike, one is a limit of another, or both leave the
same mark or say that something happened at the same time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gap.data.signatures import Signature
from gap.decision.gaps import Shrink, gap_of
from gap.decision.marks import made_by
from gap.decision.thresholds import Thresholds
from gap.decision.tolerance import of_skin
from gap.inference.evidence import Hypothesis
from gap.inference.hypothesis import Candidate
from gap.inference.problem import Problem
from gap.search.compare import Comparison, Weight
from sim_devices.chain import FloatArray


@dataclass(frozen=True)
class Cause:
    """A class of explanations that the data cannot split: its leading hypothesis, the names of all (a pair is "a + b"),
    the leader's first, and the probability that one of them acts. ``detectability`` is in tempered σ;
    ``marked``, whether a channel's own marks speak for it, ``at_marks`` the gap there without and with it, and
    ``noise`` how many times wider it makes the channel's noise, by them; ``certain``, whether nothing else leaves them;
    ``tolerated``, whether it is within a stated tolerance, which the simulation has taken on: no finding; then ``size``
    is how many of these it is.
    """

    hypothesis: Hypothesis
    names: tuple[str, ...]
    probability: float
    detectability: float
    members: tuple[Hypothesis, ...] = ()
    marked: bool = False
    at_marks: Shrink | None = None
    noise: float = 1.0
    certain: bool = False
    tolerated: bool = False
    size: float = np.inf

    @property
    def effects(self) -> tuple[Candidate, ...]:
        return self.hypothesis.effects

    @property
    def happens_once(self) -> bool:
        """Whether an event is part of it: that is in one recording, and nothing in the others foretells it."""
        return any(e.event for e in self.effects)

    @property
    def of_skin(self) -> bool:
        """Whether any of its members acts in the tissue."""
        return any(e.stage == "tissue" for h in self.members for e in h.effects)

    def joined(self, others: Sequence[Cause]) -> Cause:
        """One class with others behind it."""
        return replace(
            self,
            names=tuple(dict.fromkeys(name for c in (self, *others) for name in c.names)),
            probability=sum(c.probability for c in (self, *others)),
            members=tuple(h for c in (self, *others) for h in c.members),
        )

    def led_by(self, leader: Hypothesis) -> Cause:
        """The same class with another of its members first; the marks were its leader's."""
        if leader is self.hypothesis:
            return self
        name = concept(leader)
        names = (name, *(n for n in self.names if n != name))
        return replace(self, hypothesis=leader, names=names, marked=False, at_marks=None, noise=1.0)


def concept(h: Hypothesis) -> str:
    """The name of a hypothesis at the level of concepts."""
    return " + ".join(sorted(e.name for e in h.effects))


@dataclass(frozen=True)
class Scored:
    """Explanations, the first of which is none, with their log probability ``score`` (n,) but for a constant, and
    their ``share`` (n,) of the probability that one of them acts. ``skin`` are the blocks of tissue of no known law."""

    hypotheses: Sequence[Hypothesis]
    score: FloatArray
    share: FloatArray
    weighed: Mapping[int, Weight]
    temper: Mapping[str, float]
    thresholds: Thresholds
    signatures: Sequence[Signature] = ()
    skin: frozenset[str] = frozenset()

    def classes(self) -> list[Cause]:
        """All but none in classes, the most probable first."""
        order = [int(k) for k in np.argsort(-self.score) if k]
        causes = []
        while order:
            members = self._members(order)
            leader = self._leader(order[0], members)
            own = concept(self.hypotheses[leader])
            same = [k for k in order if k not in members and concept(self.hypotheses[k]) == own]
            order = [k for k in order if k not in members and k not in same]
            causes.append(self._cause(leader, members, same))
        return self._not_to_be_told_apart(sorted(causes, key=lambda c: -c.probability))

    def _not_to_be_told_apart(self, causes: Sequence[Cause]) -> list[Cause]:
        """The same with the first cause, where it stands out, and single effects that are not much less probable in one
        class: naming one of them would be wrong too often."""
        t, first = self.thresholds, next(iter(causes), None)
        if first is None or len(first.effects) > 1 or first.detectability < t.seen:
            return list(causes)

        def near(c: Cause) -> bool:
            return len(c.effects) == 1 and c.probability > first.probability / t.odds

        return [first.joined([c for c in causes[1:] if near(c)]), *(c for c in causes[1:] if not near(c))]

    def _leader(self, best: int, members: Sequence[int]) -> int:
        """The one with fewest parameters, unless it is worse than the best by more than `Thresholds.lead`."""
        near = [k for k in members if self.score[best] - self.score[k] <= self.thresholds.lead]
        return min(near, key=lambda k: (sum(len(e.parameters) for e in self.hypotheses[k].effects), -self.score[k]))

    def _cause(self, leader: int, members: Sequence[int], same: Sequence[int]) -> Cause:
        """The class of ``members``, whose probability has that of others of the ``same`` name."""
        evidence = [self.weighed[id(self.hypotheses[k])].evidence for k in (leader, 0)]
        return Cause(
            self.hypotheses[leader],
            tuple(dict.fromkeys(concept(self.hypotheses[k]) for k in (leader, *members))),
            float(sum(self.share[k] for k in (*members, *same))),
            float(np.sqrt(max(2 * (evidence[0] - evidence[1]), 0.0))),
            tuple(self.hypotheses[k] for k in members),
        )

    def _members(self, order: Sequence[int]) -> list[int]:
        """Which of ``order``, best first, these data cannot split from the first of them."""
        t, lead, first = self.thresholds, order[0], self.hypotheses[order[0]]
        behind = {k: float(self.score[lead] - self.score[k]) for k in order}
        members = [k for k in order if k == lead or (behind[k] < t.evidence_tie and self._alike(first, k))]
        members += [k for k in order if k not in members and behind[k] < t.skin_tie and self._but_for_skin(first, k)]
        members += [k for k in order if k not in members and self._but_for_edges(first, k)]
        return members + [k for k in order if k not in members and behind[k] < t.mark and self._told_alike(first, k)]

    def _alike(self, one: Hypothesis, k: int) -> bool:
        """Whether data tell another explanation from ``one`` by next to nothing."""
        t, other = self.thresholds, self.hypotheses[k]
        if len(one.effects) != len(other.effects):
            return False
        if _extends(one, other) or _extends(other, one) or _same_event(one, other, t.same_edges):
            return True
        left = sum(max(f.chi2 - len(f.residual), 0.0) / self.temper[b] for b, f in one.fits.items())
        return self._distance(one, other) < max(t.separable, t.blunt * float(np.sqrt(left)))

    def _but_for_skin(self, one: Hypothesis, k: int) -> bool:
        """Whether only skin, whose law is not exact, tells another explanation from ``one``, which shows elsewhere as
        well: a gauge that reads too little from a leak."""
        other, none = self.hypotheses[k], self.hypotheses[0]
        if len(one.effects) != len(other.effects) or not self.skin:
            return False
        shows = self._distance(one, none, self.skin) > self.thresholds.seen
        return shows and self._distance(one, other, self.skin) < self.thresholds.separable

    def _but_for_edges(self, one: Hypothesis, k: int) -> bool:
        """Whether another event at the time of ``one`` explains nearly as much: its edges are of another form."""
        other, none = self.hypotheses[k], self.hypotheses[0]
        if not _same_event(one, other, self.thresholds.same_edges):
            return False
        explained = [sum(none.fits[b].chi2 - f.chi2 for b, f in h.fits.items()) for h in (one, other)]
        return explained[1] > (1.0 - self.thresholds.edges_share) * explained[0]

    def _told_alike(self, one: Hypothesis, k: int) -> bool:
        """Whether another explanation leaves the same mark, or happens at the same time."""
        other = self.hypotheses[k]
        return _same_mark(one, other, self.signatures) or _same_event(one, other, self.thresholds.same_edges)

    def _distance(self, one: Hypothesis, other: Hypothesis, without: frozenset[str] = frozenset()) -> float:
        """How far apart two fitted explanations predict, in tempered σ, each block as far as the first trusts it, but
        for blocks ``without`` which to compare them."""
        square = 0.0
        for b, trust in self.weighed[id(one)].trust.items():
            if b in without:
                continue
            change = one.fits[b].residual - other.fits[b].residual
            square += trust / self.temper[b] * float(np.sum(np.square(change)))
        return float(np.sqrt(square))


def _extends(one: Hypothesis, other: Hypothesis) -> bool:
    """Whether a single effect becomes another one in a limit of its parameters."""
    names = [e.name for e in other.effects]
    return len(one.effects) == len(names) == 1 and names[0] in one.effects[0].extends


def _same_mark(one: Hypothesis, other: Hypothesis, signatures: Sequence[Signature]) -> bool:
    """Whether two single effects leave a mark that was found: an old value under a new stamp is a late sample or a
    repeated one, and how often they come tells by the form of chance only."""
    both = [h.effects[0] for h in (one, other) if len(h.effects) == 1]
    return len(both) == 2 and any(all(made_by(s, e) for e in both) for s in signatures)


def _same_event(one: Hypothesis, other: Hypothesis, near: float) -> bool:
    """Whether two single effects that share a block are events that begin and end at the same times, to ``near`` s."""
    spells = []
    for h in (one, other):
        if len(h.effects) != 1 or not h.effects[0].event:
            return False
        values = h.values(h.effects[0])
        begin = values.get("moment", np.nan)
        spells.append((set(h.effects[0].blocks), begin, begin + values.get("duration", 0.0)))
    (blocks, begin, end), (others, from_then, until) = spells
    return bool(blocks & others) and abs(begin - from_then) < near and abs(end - until) < near


def unmet_skin(problems: Mapping[str, Problem], h: Hypothesis, unusual_gap: float) -> list[str]:
    """The blocks of skin that neither a law, nor a discrepancy, nor the effects of a hypothesis meet."""
    return [b for b, problem in problems.items() if of_skin(problem) and gap_of(h, [b]) > unusual_gap]


def nats_without_skin(
    cause: Cause, comparison: Comparison, temper: Mapping[str, float], unusual_gap: float
) -> dict[str, float]:
    """Nats that each block which leaves no room for skin of another law gives a cause."""
    nats = {}
    unmet = unmet_skin(comparison.problems, cause.hypothesis, unusual_gap)
    for block, problem in comparison.problems.items():
        if not problem.open_law and block not in unmet:
            fits = cause.hypothesis.fits[block], comparison.null.fits[block]
            one, other = (f.log_evidence(temper[block], problem.prior_scales) for f in fits)
            nats[block] = problem.likelihood_powers[0] * (one - other)
    return nats


def begins_with_skin(problems: Mapping[str, Problem], h: Hypothesis, within: float) -> bool:
    """Whether an event of the tissue begins ``within`` s of the first sample on skin: nothing tells how the skin was
    until then, and a law of another toe or memory bends just there."""
    first = min((float(np.min(p.rows.time)) for p in problems.values() if p.open_law), default=-np.inf)
    events = [values for f in h.fits.values() for e, values in f.active.items() if e.event and e.stage == "tissue"]
    return any(values.get("moment", np.inf) < first + within for values in events)
