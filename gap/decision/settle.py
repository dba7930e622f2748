"""From compared explanations to a verdict: posterior, held-out tests of the leading ones, decision."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import takewhile

import numpy as np

from gap.data.signatures import Signature
from gap.decision.chance import memory_of_chance, size_of_chance, walk_of_chance
from gap.decision.classes import Cause, begins_with_skin, concept, nats_without_skin, unmet_skin
from gap.decision.findings import Findings
from gap.decision.gaps import (
    Shrink,
    gap_but_for_skin,
    gap_without_discrepancy,
    in_changed_blocks,
    in_each_block,
    in_session,
    noisy,
)
from gap.decision.marks import explains_marks
from gap.decision.posterior import Posterior, posterior
from gap.decision.qualified import Qualified
from gap.decision.thresholds import Thresholds
from gap.decision.tolerance import NOT_STATED, Size, Stated, in_tolerances, strained
from gap.decision.tolerated import beside, told, tolerated
from gap.decision.transfer import Carried, best_elsewhere, plain, transferred
from gap.decision.verdict import UNFINISHED, WITHIN, Verdict, decide
from gap.inference.evidence import Hypothesis
from gap.inference.hypothesis import Candidate, touched
from gap.inference.workers import each
from gap.search.compare import Comparison

SHRUNK, TRANSFERRED, MEMBERS = 3, 2, 3
"""How many causes are tried as a simulation by themselves, how many on recordings that they were not fitted to, and how
many members of the first one's class."""


@dataclass(frozen=True)
class Trial:
    """A hypothesis as a simulation by itself, and how far the gap shrinks with it, by split: of the whole session, and
    on withheld recordings also in the blocks that it changes."""

    answer: Hypothesis
    shrinks: Mapping[str, Shrink]
    changed: Mapping[str, Shrink]


@dataclass(frozen=True)
class Case:
    """All that a verdict rests on: ``null`` is the simulation by itself, ``withheld`` the recordings (by number) that
    each split leaves out, ``stated`` the instrument's tolerances, ``taken`` the effects within them that the simulation
    has taken on. Trials are made once."""

    comparison: Comparison
    candidates: Sequence[Candidate]
    marks: Sequence[Signature]
    null: Hypothesis
    withheld: Mapping[str, set[int]]
    stated: Stated
    qualified: Qualified | None = None
    taken: Sequence[Cause] = ()
    _answers: dict[int, Hypothesis] = field(default_factory=dict, repr=False)
    _carried: dict[int, Carried] = field(default_factory=dict, repr=False)

    def tried(self, hypotheses: Sequence[Hypothesis], transfers: int, jobs: int) -> list[Trial]:
        """Trials of some hypotheses, the first ``transfers`` of them also on withheld recordings."""
        problems = self.comparison.problems
        new = [h for h in hypotheses if id(h) not in self._answers]
        made = each(lambda h: plain(problems, h, self.null), new, jobs)
        self._answers.update((id(h), answer) for h, answer in zip(new, made, strict=True))
        new = [h for h in hypotheses[:transfers] if id(h) not in self._carried]
        by_split = transferred(problems, self.null, [self._answers[id(h)] for h in new], self.withheld, jobs)
        self._carried.update((id(h), by) for h, by in zip(new, by_split, strict=True))
        trials = []
        for k, h in enumerate(hypotheses):
            answer, carried = self._answers[id(h)], self._carried[id(h)] if k < transfers else Carried({}, {})
            trials.append(Trial(answer, {"fitted": in_session(self.null, answer), **carried.session}, carried.changed))
        return trials

    def posterior(self, t: Thresholds, *, qualified: bool = True) -> Posterior:
        """The posterior, with or without the instrument's qualification as prior."""
        known = self.qualified if qualified else None
        prior = t.prior_effect / max(len({c.name for c in self.candidates}), 1)
        beforehand = partial(known.nats, prior=prior) if known is not None else lambda h: 0.0
        skin = {name for name, p in self.comparison.problems.items() if p.open_law}
        allowed = gap_but_for_skin(self.null, self.comparison.null, skin)
        found = posterior(self.comparison, self.candidates, t, self.marks, allowed, beforehand, self.stated)
        # The part of the gap that skin of another law takes on may be something else as well.
        by_itself = gap_without_discrepancy(self.null, noisy(self.null))
        return found.doubted(t.prior_outside) if by_itself > max(allowed, t.quiet_gap) else found


@dataclass(frozen=True)
class Settled:
    """A verdict, the posterior it was read from, and the trials of the first causes."""

    verdict: Verdict
    found: Posterior
    trials: tuple[Trial, ...]


def believed(case: Case, t: Thresholds) -> tuple[Case, list[str]]:
    """The case without explanations by chance whose residuals are not of the size that they say or remember, or whose
    readings do not walk at random, and by events of skin that begin with it; its simulation has taken on effects within
    tolerance, which are told in remarks."""
    comparison, known = case.comparison, case.qualified
    problems = comparison.problems
    kept = [h for h in comparison.hypotheses if size_of_chance(problems, h) >= t.chance]
    kept = [h for h in kept if memory_of_chance(problems, h) <= t.chance_memory]
    kept = [h for h in kept if walk_of_chance(problems, h) >= t.chance_walk]
    kept = [h for h in kept if not begins_with_skin(problems, h, t.skin_before)]
    comparison = replace(comparison, hypotheses=kept)
    taken = tolerated(
        comparison,
        case.stated,
        t.tolerances,
        t.separable,
        lambda h: known is not None and bool(known.expected(h)),  # references have shown that it is more
    )
    comparison = beside(comparison, taken, t.second_excess)
    null = plain(comparison.problems, comparison.null) if taken else case.null
    there = replace(case, comparison=comparison, null=null, taken=taken, _answers={}, _carried={})
    return there, told(taken)


def settle(case: Case, t: Thresholds, jobs: int = 1) -> Settled:
    """The verdict on a case under some thresholds. Where nothing is named, effects within tolerance that the data show
    are listed."""
    settled = _settled(case, t, jobs)
    if settled.verdict.settled_by == UNFINISHED:
        settled = _one_of_two(settled, case, t, jobs)
    return settled if settled.verdict.claims or not case.taken else _with_tolerated(settled, case, t)


def _one_of_two(pair: Settled, case: Case, t: Thresholds, jobs: int) -> Settled:
    """The claim of one of two effects that are not all, where it holds alone: the other may have repaired its form."""
    singles = [h for h in case.comparison.hypotheses if len(h.effects) == 1]
    alone = _settled(replace(case, comparison=replace(case.comparison, hypotheses=singles)), t, jobs)
    both = set(pair.verdict.causes[0].effects)
    return alone if alone.verdict.claims and set(alone.verdict.causes[0].effects) <= both else pair


def _settled(case: Case, t: Thresholds, jobs: int) -> Settled:
    found = case.posterior(t)
    if not found.causes:
        return Settled(decide(Findings(found, t)), found, ())
    found, trials = _with_best_leader(case, found, t, jobs)
    first, comparison = found.causes[0], case.comparison
    size = in_tolerances(comparison.problems, comparison.null, first.members, case.stated, found.temper, t.seen)
    expected = case.qualified is not None and bool(case.qualified.expected(first.hypothesis))
    if expected:
        size = NOT_STATED  # references, on which no skin could do as much, have shown that it is more than that
    nats = nats_without_skin(first, comparison, found.temper, t.unusual_gap)
    has_skin = len(nats) < len(comparison.problems)
    # No other recording tells an event from skin of another law, and where no law meets the skin its rest hides all.
    asked = first.happens_once or unmet_skin(comparison.problems, first.hypothesis, t.unusual_gap)
    telling = [b for b, n in nats.items() if n > t.without_skin] if has_skin and asked else []
    findings = Findings(
        posterior=found,
        t=t,
        fitted=in_changed_blocks(case.null, trials[0].answer, telling),
        each=in_each_block(case.null, trials[0].answer),
        held_out=trials[0].changed,
        rival=_rival(case, found, t, jobs),
        input_gap=_input_gap(case, trials[0].answer),
        without_skin=sum(nats.values()) if has_skin else np.inf,
        size=size,
        strained=strained(comparison.problems, comparison.null, first.hypothesis),
        judged_apart=bool(telling),
        expected=expected,
    )
    return Settled(decide(findings), found, trials)


def _with_tolerated(settled: Settled, case: Case, t: Thresholds) -> Settled:
    """Effects within tolerance among the causes, where nothing is named: then none is not sure."""
    verdict = settled.verdict
    found = verdict.posterior.with_tolerated(case.taken, t.unnamed)
    tried = {id(c.hypothesis): trial for c, trial in zip(verdict.causes, settled.trials, strict=False)}
    tried |= {id(c.hypothesis): Trial(case.null, {"fitted": in_session(case.null, case.null)}, {}) for c in case.taken}
    known = takewhile(lambda c: id(c.hypothesis) in tried, found.causes)
    trials = tuple(tried[id(c.hypothesis)] for c in known)
    rules = verdict.rules
    if verdict.verdict in ("none", "undetectable") and found.causes[0].names in {c.names for c in case.taken}:
        rules = (f"{WITHIN}: {Size(found.causes[0].size)} <= {t.tolerances:g}", *rules)
    said = "undetectable" if verdict.verdict == "none" else verdict.verdict
    return Settled(Verdict(said, found, rules), settled.found, trials)


def _withheld(trial: Trial) -> Mapping[str, Shrink]:
    return {split: s for split, s in trial.shrinks.items() if split != "fitted"}


def _input_gap(case: Case, answer: Hypothesis) -> float:
    """The gap of the simulation by itself in the blocks that all those which an answer changes have as input; 0 where
    one has none."""
    inputs = [case.comparison.problems[b].input_block for b in noisy(case.null, touched(answer.effects))]
    known = [b for b in inputs if b in case.null.fits]
    return max(gap_without_discrepancy(case.null, [b]) for b in known) if inputs and len(known) == len(inputs) else 0.0


def _rival(case: Case, found: Posterior, t: Thresholds, jobs: int) -> Mapping[str, Shrink]:
    """Held-out tests of the next cause that shares no effect with the first one's class, and has no more of them, so
    that it is not better for being more flexible; none where nobody asks."""
    first = {name for h in (found.causes[0].hypothesis, *found.causes[0].members) for name in _concepts(h)}
    size = len(found.causes[0].effects)
    others = [
        h for h in (c.hypothesis for c in found.causes[1:]) if not first & _concepts(h) and len(h.effects) <= size
    ]
    if not others or t.rival_lead >= 1.0:
        return {}
    return _withheld(case.tried(others[:1], 1, jobs)[0])


def _concepts(h: Hypothesis) -> set[str]:
    return {e.name for e in h.effects}


def _with_best_leader(case: Case, found: Posterior, t: Thresholds, jobs: int) -> tuple[Posterior, tuple[Trial, ...]]:
    """The posterior led by the member of the first class that meets withheld data best, unless a mark shows which it
    is; and the trials of the first causes."""
    first, *others = found.causes
    rivals: dict[str, Hypothesis] = {}
    for member in (first.hypothesis, *first.members):
        rivals.setdefault(concept(member), member)
    members = list(rivals.values())[:MEMBERS]
    trials = case.tried([*members, *(c.hypothesis for c in others[: SHRUNK - 1])], len(members) + TRANSFERRED - 1, jobs)
    held_out = [_withheld(trial) for trial in trials[: len(members)]]
    best = 0 if explains_marks(first.at_marks, t) else best_elsewhere(held_out, t.transfer_lead)
    return found.led_by(members[best]), (trials[best], *trials[len(members) :])
