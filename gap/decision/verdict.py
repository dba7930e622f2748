"""From compared hypotheses to a verdict: classes that the data cannot split, probabilities, and when to say nothing.

Probabilities are tempered Laplace evidences with a prior over *numbers of effects*, raised to each block's
`trusts`. Both were set on development seeds of the blind generator, not on those that score them
(docs/decisions/gap-method.md).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import softmax

from gap.data.signatures import HUM, Signature
from gap.decision.transfer import Shrink
from gap.inference.evidence import Hypothesis
from gap.inference.hypothesis import Candidate
from gap.search.compare import Comparison, Weight

VERDICTS = ("effect", "several", "none", "unknown", "undetectable")


@dataclass(frozen=True)
class Judgement:
    """The thresholds of the verdict, in one place."""

    prior_effect: float = 0.45  # that one effect acts
    prior_pair: float = 0.05  # that two act
    outside: float = 0.07  # that what is named is imitated by an effect that the library lacks
    sure_none: float = 0.99  # probability of no effect above which, at a gap below `quiet_gap`, the verdict is `none`
    quiet_gap: float = 1.1
    unusual_gap: float = 1.3  # gap above which finding nothing means that the cause is unknown, not that there is none
    separable: float = 3.0  # distance (in tempered σ) below which two fitted explanations are one class,
    blunt: float = 0.0  # or times what both leave above the noise: finer than that nothing is known
    evidence_tie: float = 5.0  # nats within which indistinguishable explanations count as equally good,
    lead: float = 1.0  # and those by which the simplest of them may be worse and still leads them
    detect: float = 0.5  # probability of "some effect" above which one is claimed,
    seen: float = 5.0  # if it stands out by so many tempered σ: among sixty effects some always do by three or four
    second_share: float = 0.3  # of what the best single effect leaves above the noise, that a second must explain
    second_excess: float = 0.01  # and of what the null leaves: form errors grow with the effect
    second_least: float = 30.0  # χ² (tempered) that it must explain at least: of so many pairs some always do by less
    unearned: float = 5.0  # nats by which a pair that does not is less probable than the best single effect at least
    borne_out: float = 0.2  # share of the plain gap on another waveform that a device effect must take away,
    helps: float = 0.01  # less of it is nothing, of an effect that is as weak as its prior allows
    worse: float = 1.15  # times larger that it may make the gap on repeats,
    elsewhere: float = 1.5  # and on another waveform; of thirteen right development claims none did by 1.03
    plain: float = 1.1  # where that gap is larger than this,
    sure: float = 5.0  # unless blocks without skin give so many nats
    overwhelming: float = 8.0  # or it stands out by so many σ
    surrogate: float = 10.0  # σ (rms) by which finite elements' surrogate may be off before what is left is its own
    unknown: float = 0.5  # probability that the cause is none of the library's above which that is the verdict
    unnamed: float = 0.45  # probability that no cause exceeds where the verdict names none


RIG = Judgement(sure_none=0.93, seen=4.0, evidence_tie=8.0, blunt=1.0, second_share=0.6, worse=1.3, elsewhere=2.0)
"""How a rig's model is judged, whose own error nobody knows. It tempers all evidence, so that classes are wide; and of
what a first effect leaves, some second one always explains half."""


@dataclass(frozen=True)
class Cause:
    """A class of explanations: the leading hypothesis, the names it cannot be told from, its probability if anything
    acts at all."""

    hypothesis: Hypothesis
    names: tuple[str, ...]  # concepts of the class, the leader first (a pair is "a + b")
    probability: float
    detectability: float
    members: tuple[Hypothesis, ...] = ()
    marked: bool = False  # whether a channel's own marks speak for it

    @property
    def effects(self) -> tuple[Candidate, ...]:
        return self.hypothesis.effects


@dataclass(frozen=True)
class Verdict:
    """What the comparison says. ``stages`` are probable as far as anything acts; ``probability_none``, that nothing
    does."""

    verdict: str
    causes: tuple[Cause, ...]
    stages: Mapping[str, float]
    probability_none: float
    unexplained: float
    gap_before: float
    gap_after: float
    temper: Mapping[str, float]
    confusable: tuple[tuple[str, ...], ...] = field(default=())


def concept(h: Hypothesis) -> str:
    """The name of a hypothesis at the level of concepts."""
    return " + ".join(sorted(e.name for e in h.effects))


def _distance(a: Hypothesis, b: Hypothesis, trust: Mapping[str, float], temper: Mapping[str, float]) -> float:
    """How far apart two fitted explanations predict, in tempered σ, each block as far as it is trusted."""
    square = 0.0
    for k, share in trust.items():
        square += share / temper[k] * float(np.sum(np.square(a.fits[k].residual - b.fits[k].residual)))
    return float(np.sqrt(square))


def made_by(signature: Signature, effect: Candidate) -> bool:
    """Whether ``effect`` is the one that leaves ``signature``."""
    names = {name.removeprefix("sensor_") for name in (signature.effect, *signature.also)}
    where = effect.key.partition("@")[2]
    return effect.name.removeprefix("sensor_") in names and where in ("", signature.channel)


def _earned(h: Hypothesis, comparison: Comparison, rules: Judgement, temper: Mapping[str, float]) -> bool:
    """Whether each further effect of a hypothesis explains enough of what fewer leave; form errors are always worth
    some χ²."""
    if len(h.effects) < 2:
        return True
    singles = [s for s in comparison.hypotheses if len(s.effects) == 1 and s.effects[0] in h.effects]
    n = sum(len(f.residual) for f in h.fits.values())
    left = min(s.deviance for s in singles)
    least = rules.second_least * min(temper.values())
    needed = max(rules.second_share * (left - n), rules.second_excess * (comparison.null.chi2 - n), least)
    return left - h.deviance > needed


def gap_of(h: Hypothesis) -> float:
    """rms of the whitened residual over all blocks: 1 at the noise floor."""
    n = sum(len(f.residual) for f in h.fits.values())
    return float(np.sqrt(sum(f.chi2 for f in h.fits.values()) / n))


def unknown(unexplained: float, gap: float) -> float:
    """How surely the cause is none of the library's: from the share of the excess χ² that the best explanation leaves,
    and from how far above the noise the ``gap`` is that it leaves."""
    excess = max(gap - 1.0, 0.0)
    return float(1.0 - np.exp(-2.2 * unexplained * excess / (excess + 0.3)))


def judge(
    comparison: Comparison,
    candidates: Sequence[Candidate],
    rules: Judgement = Judgement(),
    signatures: Sequence[Signature] = (),
) -> Verdict:
    """The verdict on a comparison, with what the channels' own marks add."""
    temper = comparison.temper()
    n_concepts = len({c.name for c in candidates}) or 1
    prior_none = 1.0 - rules.prior_effect - rules.prior_pair
    forms = {name: sum(c.name == name for c in candidates) for name in {c.name for c in candidates}}

    def log_prior(h: Hypothesis) -> float:
        if not h.effects:
            return float(np.log(prior_none))
        share = sum(-np.log(forms.get(e.name, 1)) for e in h.effects)
        if len(h.effects) == 1:
            return float(np.log(rules.prior_effect / n_concepts) + share)
        pairs = n_concepts * (n_concepts - 1) / 2
        return float(np.log(rules.prior_pair / max(pairs, 1)) + share)

    def marks(h: Hypothesis) -> float:
        return sum(s.nats for s in signatures if any(made_by(s, e) for e in h.effects))

    everything = [comparison.null, *comparison.hypotheses]
    weighed = comparison.weighed(temper)
    score = np.array([log_prior(h) + weighed[id(h)].evidence + marks(h) for h in everything])
    # A second effect that is not worth it yet is what should be looked for next, and no more.
    single = max((s for s, h in zip(score, everything, strict=True) if len(h.effects) == 1), default=score[0])
    second = np.array([not _earned(h, comparison, rules, temper) for h in everything])
    score[second] = np.minimum(score[second], single - rules.unearned)
    none = float(softmax(score)[0])
    # Whether anything acts is one question, what it would be another: of what is weak the second often has an answer.
    weight = np.r_[0.0, (1.0 - rules.outside) * softmax(score[1:])] if len(score) > 1 else np.zeros(1)
    causes = _classes(everything, score, weight, weighed, temper, rules)
    causes = [replace(c, marked=marks(c.hypothesis) > 0) for c in causes]
    stages: dict[str, float] = {}
    for h, w in zip(everything[1:], weight[1:], strict=True):
        for e in h.effects:
            stages[e.stage] = stages.get(e.stage, 0.0) + float(w) / len(h.effects)
    stages = dict(sorted(stages.items(), key=lambda kv: -kv[1]))
    before = gap_of(comparison.null)
    after = gap_of(causes[0].hypothesis) if causes else before
    left = max(after**2 - 1, 0.0) / max(before**2 - 1, 1e-9)
    seen = bool(causes) and (causes[0].marked or causes[0].detectability >= rules.seen)
    if not seen or 1 - none < rules.detect:
        foreign = before > rules.unusual_gap or any(s.effect == HUM for s in signatures)
        quiet = before <= rules.quiet_gap and none >= rules.sure_none
        verdict = "unknown" if foreign else "none" if quiet else "undetectable"
    elif unknown(min(left, 1.0), after) > rules.unknown and not causes[0].marked:
        verdict = "unknown"
    else:
        verdict = "several" if len(causes[0].effects) > 1 else "effect"
    found = Verdict(verdict, tuple(causes), stages, none, min(left, 1.0), before, after, temper)
    return found if verdict in ("effect", "several") else _unnamed(found, verdict, rules)


def _unnamed(verdict: Verdict, said: str, rules: Judgement) -> Verdict:
    """The verdict ``said``, which names no cause: none has even odds then, as the first class was right in 7 of 15 such
    development cases where an effect of δ > 5 did act."""
    first = max((c.probability for c in verdict.causes), default=0.0)
    share = rules.unnamed / max(first, rules.unnamed)
    causes = tuple(replace(c, probability=share * c.probability) for c in verdict.causes)
    return replace(verdict, verdict=said, causes=causes)


def weakest(h: Hypothesis, within: float = 0.02) -> bool:
    """Whether a single effect is as weak as its prior allows: ``within`` that share of its range in logarithms."""
    if len(h.effects) != 1:
        return False
    parameters = h.effects[0].parameters
    strength = [k for k, p in enumerate(parameters) if p.null is not None and p.scale == "log" and p.null < p.low]
    fitted = [f for f in h.fits.values() if f.hypothesis]
    return bool(strength) and all(f.unit[strength[0]] < within for f in fitted)


def borne_out(
    verdict: Verdict, comparison: Comparison, shrinks: Mapping[str, Shrink], rules: Judgement = Judgement()
) -> Verdict:
    """The verdict once its first cause was tried as a simulation by itself, also on what it was not fitted to.

    What takes nothing away there explains nothing, be its evidence what it may, nor does what is as weak as its prior
    allows and helps nowhere else; what makes repeats of its own data worse, or another waveform much worse, is wrong;
    and a device effect that only repairs what skin of another law leaves does not carry over to another waveform.
    ``shrinks`` are the first cause's by split: ``fitted``, and whatever was withheld (``waveform``, ``repeat`` …).
    """
    if verdict.verdict not in ("effect", "several"):
        return verdict
    first = verdict.causes[0]
    if first.marked:  # what the samples themselves show needs no fit
        return verdict
    fitted, carried, repeat = shrinks["fitted"], shrinks.get("waveform"), shrinks.get("repeat")
    withheld = [carried] if carried else [s for split, s in shrinks.items() if split != "fitted"]
    helps = any(s.value > rules.helps for s in withheld)
    if fitted.after >= fitted.before or (weakest(first.hypothesis) and not helps):
        return _unnamed(verdict, "unknown" if fitted.before > rules.unusual_gap else "undetectable", rules)
    # A jump is in one recording, and nothing in its repeats foretells it.
    once = any(p.name == "moment" for e in first.effects for p in e.parameters)
    limits = ((None if once else repeat, rules.worse), (carried, rules.elsewhere))
    if any(s and s.after > limit * max(s.before, 1.0) for s, limit in limits):
        return _unnamed(verdict, "unknown", rules)
    if carried is None or fitted.before < rules.plain:
        return verdict
    if first.detectability > rules.overwhelming or any(e.stage == "tissue" for h in first.members for e in h.effects):
        return verdict
    cause, bare = first.hypothesis, 0.0
    for block, problem in comparison.problems.items():
        if np.array_equal(problem.plain_sd, problem.prior_sd):
            fits = cause.fits[block], comparison.null.fits[block]
            one, other = (f.log_evidence(verdict.temper[block], problem.alternatives) for f in fits)
            bare += problem.trusts[0] * (one - other)
    if bare > rules.sure or carried.value > rules.borne_out:
        return verdict
    return _unnamed(verdict, "unknown", rules)


def _classes(
    hypotheses: Sequence[Hypothesis],
    score: np.ndarray,
    weight: np.ndarray,
    weighed: Mapping[int, Weight],
    temper: Mapping[str, float],
    rules: Judgement,
) -> list[Cause]:
    """Group explanations that these data cannot split, all but the first of ``hypotheses``, which is none; within a
    class the one with fewest parameters leads, unless it is worse by more than `Judgement.lead`."""
    order = [k for k in np.argsort(-score) if k]
    causes = []
    while order:
        lead = order[0]
        left = sum(max(f.chi2 - len(f.residual), 0.0) / temper[b] for b, f in hypotheses[lead].fits.items())
        separable = max(rules.separable, rules.blunt * float(np.sqrt(left)))
        members = [
            k
            for k in order
            if k == lead
            or (
                score[lead] - score[k] < rules.evidence_tie
                and len(hypotheses[k].effects) == len(hypotheses[lead].effects)
                and _distance(hypotheses[lead], hypotheses[k], weighed[id(hypotheses[lead])].trust, temper) < separable
            )
        ]
        leaders = [k for k in members if score[lead] - score[k] <= rules.lead]
        simplest = min(leaders, key=lambda k: (sum(len(e.parameters) for e in hypotheses[k].effects), -score[k]))
        order = [k for k in order if k not in members]
        same = [k for k in order if concept(hypotheses[k]) == concept(hypotheses[simplest])]
        order = [k for k in order if k not in same]
        names = list(dict.fromkeys([concept(hypotheses[simplest]), *(concept(hypotheses[k]) for k in members)]))
        gain = 2 * (weighed[id(hypotheses[simplest])].evidence - weighed[id(hypotheses[0])].evidence)
        probability = float(sum(weight[k] for k in (*members, *same)))
        causes.append(
            Cause(
                hypotheses[simplest],
                tuple(names),
                probability,
                float(np.sqrt(max(gain, 0.0))),
                tuple(hypotheses[k] for k in members),
            )
        )
    return sorted(causes, key=lambda c: -c.probability)
