"""From recordings to a diagnosis, step by step."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from threadpoolctl import threadpool_limits

from acquire.recording.model import Recording
from gap.data import signatures
from gap.data.checks import DiagnosisError, in_order, remarks
from gap.data.pauses import without_pauses
from gap.data.splits import splits, splits_of_a_rig
from gap.data.tolerances import sampled, tolerances
from gap.decision.earlier import Earlier, Skin, gains, known_skin, moved, skin_of, unlike
from gap.decision.limits import bounds, confusable
from gap.decision.marks import made_by
from gap.decision.posterior import Posterior
from gap.decision.qualified import Qualified, inform
from gap.decision.qualified import read as read_qualification
from gap.decision.settle import Case, settle
from gap.decision.thresholds import INSTRUMENT, RIG, Thresholds
from gap.decision.transfer import Shrink, gap_without_discrepancy, plain
from gap.decision.verdict import Verdict, undetectable
from gap.effects.load import generic, library
from gap.inference.evidence import Hypothesis
from gap.inference.hypothesis import Candidate
from gap.inference.problem import Problem
from gap.null.blocks import Block
from gap.null.known_skin import KnownSkin
from gap.null.suction_height import HeightBlock
from gap.rig.model import ForwardModel
from gap.rig.problem import RigProblem, against_the_model
from gap.search.compare import Comparison, Effort, compare
from gap.terms.propose import Proposal, best_term

if TYPE_CHECKING:
    from gap.null.doubts import Doubt

EFFORTS = {
    "microrobot": Effort(
        quick_fits=5,
        least_score=8.0,
        far_fits=8,
        refit_singles=7,
        known_law=0,
        imitators=1,
        pair_bases=1,
        refit_pairs=2,
    )
}
"""How wide to search where simulations are slow."""
Tell = Callable[[str, float], None]
"""Hears the name of a stage, and which share of a diagnosis is usually over when it begins."""


@dataclass(frozen=True)
class Diagnosis:
    """Everything a report needs. ``shrinks`` maps the first causes to their shrinkage by split; ``remarks`` are plain
    words."""

    recordings: tuple[Recording, ...]
    problems: Mapping[str, Problem]
    comparison: Comparison
    verdict: Verdict
    signatures: tuple[signatures.Signature, ...]
    shrinks: tuple[Mapping[str, Shrink], ...]
    bounds: Mapping[str, float]  # effect -> strength (SI) that would have been seen
    confusable: tuple[tuple[str, ...], ...]
    remarks: tuple[str, ...]
    seconds: float
    null: Hypothesis  # the simulation by itself, without an effect and
    best: Hypothesis  # with the first cause, if there is one
    thresholds: Thresholds
    fe_solves: int = 0
    doubts: tuple[str, ...] = ()  # reference specimens that contradict their statement, left out
    qualified: Qualified | None = None
    unqualified: Posterior | None = None  # as it would be without the qualification
    term: Proposal | None = None  # for a gap that no known effect explains
    earlier: Earlier | None = None  # the prior of the skin by earlier sessions

    @property
    def gap_before(self) -> float:
        """rms of the simulation's residual, in σ, skin of another law not allowed for."""
        return gap_without_discrepancy(self.null)

    @property
    def gap_after(self) -> float:
        """The same with the first cause."""
        return gap_without_discrepancy(self.best)


# Systems this small take many times as long on several threads when the cores are busy.
@threadpool_limits.wrap(limits=1)
def diagnose(
    recordings: Sequence[Recording],
    model: ForwardModel | None = None,
    effort: Effort | None = None,
    thresholds: Thresholds | None = None,
    user_effects: Sequence[Path] = (),
    solver: str = "",
    quick: bool = False,
    jobs: int = 1,
    tell: Tell = lambda stage, share: None,
    qualification: Path | None = None,
    propose_term: bool = True,
    earlier: Sequence[Sequence[Recording]] = (),
) -> Diagnosis:
    """Diagnose recordings of one session together; ``model`` is needed for an instrument that is not ours.

    ``user_effects`` are files with further effects, ``solver`` a finite-element model to take the tissue from;
    ``quick`` fits few effects and no pairs. ``jobs`` processes share the fits, but for a solver's, which is a process
    by itself; the diagnosis is the same. ``tell`` hears of each stage when it begins. ``qualification`` is the file of
    one of this instrument; where it is another's or has expired, it is told and not believed. With ``propose_term`` a
    term is looked for where no known effect explains the gap. ``earlier`` are sessions of the same person and site,
    each diagnosed by itself: those that were sound are the prior of the skin's law.

    Raises DiagnosisError, gap.ModelError.
    """
    begin = clock.perf_counter()
    jobs = 1 if solver else jobs
    t = thresholds or (INSTRUMENT if model is None else RIG)
    recordings = without_pauses(in_order(recordings))
    effort = effort or EFFORTS.get(recordings[0].info.instrument, Effort())
    qualified = read_qualification(qualification, recordings) if qualification is not None else None
    effort = effort.quicker() if quick else effort
    skins, unsound = _skins(earlier, recordings, model, solver, jobs)
    case, told = gathered(recordings, model, effort, user_effects, solver, jobs, tell, qualified, skins)
    doubted = wrong_references(case.comparison)
    kept = [r for k, r in enumerate(recordings) if not any(k in d.runs for d in doubted)]
    if doubted and kept:  # a specimen that contradicts its statement must not be believed
        recordings = kept
        case, told = gathered(recordings, model, effort, user_effects, solver, jobs, tell, qualified, skins)
        told += [f"left out, {d}" for d in doubted]
    settled = settle(case, t, jobs)
    verdict, comparison, solves = settled.verdict, case.comparison, 0
    if solver:
        verdict, solves, words = _checked(comparison, verdict, t)
        told += words
    proposal = None
    if propose_term and not solver and verdict.verdict == "unknown":
        tell("looking for a term", 0.95)
        proposal = best_term(case, t, jobs)
    return Diagnosis(
        recordings=tuple(recordings),
        problems=comparison.problems,
        comparison=comparison,
        verdict=verdict,
        signatures=tuple(case.marks),
        shrinks=tuple(trial.shrinks for trial in settled.trials),
        bounds=bounds(comparison, settled.found.temper),
        confusable=confusable(comparison, settled.found.temper),
        remarks=tuple(told),
        seconds=clock.perf_counter() - begin,
        null=case.null,
        best=settled.trials[0].answer if settled.trials else case.null,
        thresholds=t,
        fe_solves=solves,
        doubts=tuple(map(str, doubted)),
        qualified=qualified,
        unqualified=case.posterior(t, qualified=False) if qualified is not None else None,
        term=proposal,
        earlier=_learnt(comparison, skins, unsound) if earlier else None,
    )


def gathered(
    recordings: Sequence[Recording],
    model: ForwardModel | None = None,
    effort: Effort = Effort(),
    user_effects: Sequence[Path] = (),
    solver: str = "",
    jobs: int = 1,
    tell: Tell = lambda stage, share: None,
    qualified: Qualified | None = None,
    skins: Sequence[Skin] = (),
) -> tuple[Case, list[str]]:
    """All that the verdict on recordings rests on, every fit done; and remarks on the data."""
    tell("reading the recordings", 0.0)
    told = remarks(recordings, one_clock=model is None)
    problems, candidates = _problems(recordings, model, user_effects, solver, jobs)
    if qualified is not None and qualified.believed:
        inform(problems, qualified)
    if qualified is not None and qualified.remark:
        told.append(qualified.remark)
    marks = signatures.find(recordings, model.channels if model else None)
    asked = {key for p in problems if isinstance(p, Block) for key in p.suspected}
    problems = [known_skin(p, skins)[0] or p if skins and isinstance(p, HeightBlock) else p for p in problems]
    suspects = [c for c in candidates if c.key in asked or any(made_by(s, c) for s in marks)]
    comparison = compare(problems, candidates, effort, suspects, jobs, tell)
    stated = tolerances(recordings[0].info.instrument) if model is None else {}
    for rig in (p for p in problems if isinstance(p, RigProblem)):
        stated = sampled(tolerances("rig"), rig.interval)
        alone = comparison.null.fits[rig.name]
        marks = [m for m in marks if against_the_model(m, rig, alone)]
        told += rig.at_the_end(alone.nuisance)
    tell("testing on recordings withheld", 0.88)
    case = Case(
        comparison=comparison,
        candidates=candidates,
        marks=marks,
        null=plain(comparison.problems, comparison.null),
        withheld=splits(recordings) if model is None else splits_of_a_rig(recordings),
        stated=stated,
        qualified=qualified,
    )
    return case, told


def _skins(
    earlier: Sequence[Sequence[Recording]],
    recordings: Sequence[Recording],
    model: ForwardModel | None,
    solver: str,
    jobs: int,
) -> tuple[list[Skin], dict[str, str]]:
    """The skin in each of the sessions before this one that may be believed, and why others may not."""
    if not earlier:
        return [], {}
    if model is not None or solver or recordings[0].info.instrument not in ("cutometer", "aspiration"):
        raise DiagnosisError("earlier sessions are for suction on the built-in tissue, not for other rigs or solvers")
    skins, doubted = [], {}
    for session in earlier:
        name = session[0].info.id
        reason = unlike(session, recordings)
        if not reason:
            d = diagnose(session, quick=True, jobs=jobs, propose_term=False)
            block = d.problems.get("height")
            if d.verdict.claims or d.verdict.verdict == "unknown":
                first = [e.name for e in d.verdict.causes[0].effects] if d.verdict.claims else ["of unknown cause"]
                reason = f"it has a gap of its own: {', '.join(first)}"
            elif isinstance(block, HeightBlock):
                temper = max(d.comparison.temper()["height"], 1.0)
                skins.append(skin_of(name, block, d.comparison.null.fits["height"], temper))
            else:
                reason = "it has no height of skin"
        if reason:
            doubted[name] = reason
    return skins, doubted


def _learnt(comparison: Comparison, skins: Sequence[Skin], doubted: Mapping[str, str]) -> Earlier:
    """The gain of earlier sessions for a comparison."""
    height = comparison.problems.get("height")
    if isinstance(height, HeightBlock) and skins:
        return Earlier(doubted={**doubted, **known_skin(height, skins)[2]})
    if not isinstance(height, KnownSkin):
        return Earlier(doubted=doubted)
    _, believed, unused = known_skin(height.block, skins)
    changed = moved(height, comparison.null.fits["height"])
    return Earlier(believed, {**doubted, **unused}, height.names, changed, gains(comparison, height))


def wrong_references(comparison: Comparison) -> list[Doubt]:
    """Reference specimens that misfit more than any single effect explains."""
    from gap.null.doubts import doubts

    singles = [h for h in comparison.hypotheses if len(h.effects) == 1]
    return doubts(comparison.problems, comparison.null, singles)


def _checked(comparison: Comparison, verdict: Verdict, t: Thresholds) -> tuple[Verdict, int, list[str]]:
    """The verdict once the surrogate of finite elements is checked at the answer, the solves this took, and remarks."""
    from gap.null.fe_tissue import checked

    answer = verdict.causes[0].hypothesis if verdict.causes else comparison.null
    solves, off, words = checked(list(comparison.problems.values()), answer.fits)
    if verdict.verdict == "unknown" and off > t.surrogate:
        verdict = undetectable(verdict, f"surrogate: {off:.1f} sigma off > {t.surrogate:g}")
    return verdict, solves, list(words)


def _problems(
    recordings: Sequence[Recording], model: ForwardModel | None, user_effects: Sequence[Path], solver: str, jobs: int
) -> tuple[Sequence[Problem], tuple[Candidate, ...]]:
    if model is not None:
        if solver:
            raise DiagnosisError("a solver's tissue is for suction probes and the micro-robot, not for a --model rig")
        rig = RigProblem(recordings, model, generic(user_effects))
        return [rig], rig.candidates
    instrument = recordings[0].info.instrument
    if instrument in ("cutometer", "aspiration"):
        from gap.null.suction import suction_problems

        if solver:
            from gap.null.fe_tissue import fe_height

            return suction_problems(recordings, library(instrument, user_effects), fe_height(solver))
        return suction_problems(recordings, library(instrument, user_effects), jobs=jobs)
    if instrument == "microrobot":
        from gap.null.robot import robot_problems

        if solver:
            from gap.null.fe_sheet import fe_force

            return robot_problems(recordings, library(instrument, user_effects), fe_force(solver))
        return robot_problems(recordings, library(instrument, user_effects))
    raise DiagnosisError(f"instrument {instrument!r} has no built-in forward model: give one with --model file.py:Name")


__all__ = ["Diagnosis", "DiagnosisError", "diagnose"]
