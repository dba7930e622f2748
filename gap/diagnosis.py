"""From recordings to a diagnosis, step by step."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from threadpoolctl import threadpool_limits

from acquire.recording.model import Recording
from gap.data import signatures
from gap.data.checks import DiagnosisError, in_order, of_one_skin, refuse_impossible, remarks
from gap.data.pauses import without_pauses
from gap.data.pulse import pulse
from gap.data.splits import splits, splits_of_a_rig
from gap.data.tolerances import sampled, tolerances
from gap.decision.earlier import Earlier, Skin, gains, known_skin, moved, skin_of, unlike
from gap.decision.gaps import Shrink, in_session
from gap.decision.limits import beyond_the_fitted, bounds, confusable
from gap.decision.marks import made_by
from gap.decision.posterior import Posterior
from gap.decision.qualified import Qualified, inform
from gap.decision.qualified import read as read_qualification
from gap.decision.settle import Case, Settled, believed, settle
from gap.decision.structure import conventions, regulator_unknown
from gap.decision.thresholds import INSTRUMENT, RIG, Thresholds
from gap.decision.tolerance import Stated
from gap.decision.transfer import plain
from gap.decision.verdict import DOUBT, Verdict, in_doubt, undetectable
from gap.inference.evidence import Hypothesis
from gap.inference.hypothesis import Candidate
from gap.inference.problem import Problem
from gap.null.blocks import Block
from gap.null.instruments import problems_of
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
        quick_fits=8,
        least_score=8.0,
        far_fits=12,
        refit_singles=9,
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
        return in_session(self.null, self.best).before

    @property
    def gap_after(self) -> float:
        """The same with the first cause."""
        return in_session(self.null, self.best).after


def _untold(stage: str, share: float) -> None:
    """Nobody hears of the stages."""


@dataclass(frozen=True)
class Options:
    """The grounds of a diagnosis besides its recordings, and how wide it searches; as for `diagnose`.

    ``qualified`` is the qualification once read, ``skins`` those of earlier sessions that are believed. With an
    ``unknown_regulator``, a suction instrument's may be of any structure; where ``nominal``, no effect is fitted.
    """

    model: ForwardModel | None = None
    effort: Effort = field(default_factory=Effort)
    user_effects: Sequence[Path] = ()
    solver: str = ""
    jobs: int = 1
    tell: Tell = _untold
    qualified: Qualified | None = None
    skins: Sequence[Skin] = ()
    unknown_regulator: bool = False
    nominal: bool = False


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
    tell: Tell = _untold,
    qualification: Path | None = None,
    propose_term: bool = True,
    earlier: Sequence[Sequence[Recording]] = (),
    nominal: bool = False,
) -> Diagnosis:
    """Diagnose recordings of one session together; ``model`` is needed for an instrument that is not ours.

    ``user_effects`` are files with further effects, ``solver`` a finite-element model to take the tissue from;
    ``quick`` fits few effects and no pairs. ``jobs`` processes share the fits, but for a solver's, which is a process
    by itself; the diagnosis is the same. ``tell`` hears of each stage when it begins. ``qualification`` is the file of
    one of this instrument; where it is another's or has expired, it is told and not believed. With ``propose_term`` a
    term is looked for where no known effect explains the gap. ``earlier`` are sessions of the same person and site,
    each diagnosed by itself: those that were sound are the prior of the skin's law. Where ``nominal``, the simulation
    is fitted by itself and no effect is looked for: its parameters and its gap, in a fraction of the time.

    Raises DiagnosisError, gap.ModelError.
    """
    begin = clock.perf_counter()
    t = thresholds or (INSTRUMENT if model is None else RIG)
    recordings, other_skin = without_pauses(in_order(recordings)), list[str]()
    if model is None:
        recordings, other_skin = of_one_skin(recordings)
        refuse_impossible(recordings)
    effort = effort or EFFORTS.get(recordings[0].info.instrument, Effort())
    effort = effort.quicker() if quick else effort
    qualified = read_qualification(qualification, recordings) if qualification is not None else None
    options = Options(model, effort, user_effects, solver, 1 if solver else jobs, tell, qualified, nominal=nominal)
    skins, unsound = _skins(earlier, recordings, options)
    options = replace(options, skins=skins)
    judged = _judged(recordings, options, t)
    case, settled = judged.case, judged.settled
    verdict, solves, words = _checked(case.comparison, settled.verdict, t) if solver else (settled.verdict, 0, [])
    proposal = _proposed(case, verdict, t, options) if propose_term else None
    return Diagnosis(
        recordings=tuple(judged.recordings),
        problems=case.comparison.problems,
        comparison=case.comparison,
        verdict=verdict,
        signatures=tuple(case.marks),
        shrinks=tuple(trial.shrinks for trial in settled.trials),
        bounds=beyond_the_fitted(bounds(case.comparison, settled.found.temper, t, case.stated), verdict),
        confusable=confusable(case.comparison, settled.found.temper),
        remarks=(*other_skin, *judged.remarks, *_at_the_end(case, settled), *words),
        seconds=clock.perf_counter() - begin,
        null=case.null,
        best=next((trial.answer for trial in settled.trials), case.null),
        thresholds=t,
        fe_solves=solves,
        doubts=tuple(map(str, judged.doubted)),
        qualified=qualified,
        unqualified=case.posterior(t, qualified=False) if qualified is not None else None,
        term=proposal,
        earlier=_learnt(case.comparison, skins, unsound) if earlier else None,
    )


def _proposed(case: Case, verdict: Verdict, t: Thresholds, options: Options) -> Proposal | None:
    """A term for a gap that no known effect explains; None where one does or was not asked for, or where a solver makes
    each try dear."""
    if options.solver or options.nominal or verdict.verdict != "unknown" or verdict.settled_by == DOUBT:
        return None
    options.tell("looking for a term", 0.95)
    return best_term(case, t, options.jobs)


def _at_the_end(case: Case, settled: Settled) -> list[str]:
    """Remarks on parameters of a user's rig that end at the end of their range, with the effect that is claimed."""
    rig = case.comparison.problems.get("rig")
    if not isinstance(rig, RigProblem):
        return []
    answer = settled.trials[0].answer if settled.verdict.claims else case.comparison.null
    return rig.at_the_end(answer.fits["rig"])


@dataclass(frozen=True)
class _Judged:
    """The recordings that may be believed, all that their verdict rests on, the verdict, the reference specimens that
    contradict their statement, and remarks."""

    recordings: Sequence[Recording]
    case: Case
    settled: Settled
    doubted: Sequence[Doubt]
    remarks: Sequence[str]


def _judged(recordings: Sequence[Recording], options: Options, t: Thresholds) -> _Judged:
    """The verdict without specimens that contradict their statement; where nothing else is found, and one effect
    explains them as well, the verdict is that it may be either."""
    whole, told = gathered(recordings, options)
    doubted = [] if options.nominal else wrong_references(whole.comparison)  # an effect may explain these as well
    wrong = {k for d in doubted for k in d.runs}
    kept = [r for k, r in enumerate(recordings) if k not in wrong]
    if not doubted or not kept:
        case, taken = believed(whole, t)
        return _Judged(recordings, case, settle(case, t, options.jobs), doubted, (*told, *taken))
    rest, told = gathered(kept, options)
    case, taken = believed(rest, t)
    left_out = [f"left out, {d}" for d in doubted]
    judged = _Judged(kept, case, settle(case, t, options.jobs), doubted, (*told, *taken, *left_out))
    if judged.settled.verdict.claims or not all(d.effect for d in doubted):
        return judged
    case, taken = believed(whole, t)
    settled = settle(case, t, options.jobs)
    causes = settled.verdict.causes
    if not causes or not {d.effect for d in doubted} & set(causes[0].names):
        return judged
    verdict = in_doubt(settled.verdict, str(doubted[0]), t)
    return _Judged(recordings, case, replace(settled, verdict=verdict), doubted, (*told, *taken))


def gathered(recordings: Sequence[Recording], options: Options = Options()) -> tuple[Case, list[str]]:
    """All that the verdict on recordings rests on, every fit done; and remarks on the data. Where nothing explains a
    pressure by a regulator that is known, all is done again with one that is not."""
    case, told = _gathered(recordings, options)
    if options.solver or not regulator_unknown(case.comparison):
        return case, told
    again = replace(options, unknown_regulator=True, effort=options.effort.shallower())
    case, told = _gathered(recordings, again)
    return case, [*told, "the regulator is of a structure that the library does not hold: its answers are fitted"]


def _gathered(recordings: Sequence[Recording], options: Options) -> tuple[Case, list[str]]:
    """The same with the regulators that ``options`` allow."""
    options.tell("reading the recordings", 0.0)
    model = options.model
    told = remarks(recordings, one_clock=model is None)
    problems, candidates = problems_of(
        recordings, model, options.user_effects, options.solver, options.jobs, options.unknown_regulator
    )
    told += conventions(problems) + (_informed(problems, options.qualified) if options.qualified is not None else [])
    if options.nominal:
        candidates = ()
    marks = signatures.find(recordings, model.channels if model else None)
    marks += [] if model else pulse(recordings)
    suspects = _suspects(problems, candidates, marks)
    problems = [_on_known_skin(p, options.skins) for p in problems]
    comparison = compare(problems, candidates, options.effort, suspects, options.jobs, options.tell)
    stated: Stated
    if isinstance(rig := problems[0], RigProblem):
        alone = comparison.null.fits[rig.name]
        marks = [m for m in marks if against_the_model(m, rig, alone)]
        stated, withheld = sampled(tolerances("rig"), rig.interval), splits_of_a_rig(recordings)
    else:
        stated, withheld = tolerances(recordings[0].info.instrument), splits(recordings)
    options.tell("testing on recordings withheld", 0.88)
    return Case(
        comparison=comparison,
        candidates=candidates,
        marks=marks,
        null=plain(comparison.problems, comparison.null),
        withheld=withheld,
        stated=stated,
        qualified=options.qualified,
    ), told


def _informed(problems: Sequence[Problem], qualified: Qualified) -> list[str]:
    """Give the problems the priors of a qualification that is believed; remarks on it."""
    if qualified.believed:
        inform(problems, qualified)
    return [qualified.remark] if qualified.remark else []


def _suspects(
    problems: Sequence[Problem], candidates: Sequence[Candidate], marks: Sequence[signatures.Signature]
) -> list[Candidate]:
    """Candidates to be fitted in any case: a null model suspects them, or they leave marks that were found."""
    asked = {key for p in problems if isinstance(p, Block) for key in p.suspected}
    return [c for c in candidates if c.key in asked or any(made_by(s, c) for s in marks)]


def _on_known_skin(problem: Problem, skins: Sequence[Skin]) -> Problem:
    """A problem, which if it is the height of skin has earlier sessions' skin as its prior."""
    if not skins or not isinstance(problem, HeightBlock):
        return problem
    return known_skin(problem, skins)[0] or problem


def _skins(
    earlier: Sequence[Sequence[Recording]], recordings: Sequence[Recording], options: Options
) -> tuple[list[Skin], dict[str, str]]:
    """The skin in each of the sessions before this one that may be believed, and why others may not."""
    if not earlier:
        return [], {}
    built_in = recordings[0].info.instrument in ("cutometer", "aspiration")
    if options.model is not None or options.solver or not built_in:
        raise DiagnosisError("earlier sessions are for suction on the built-in tissue, not for other rigs or solvers")
    skins, doubted = [], {}
    for session in earlier:
        skin = unlike(session, recordings) or _skin(session, options.jobs)
        if isinstance(skin, Skin):
            skins.append(skin)
        else:
            doubted[session[0].info.id] = skin
    return skins, doubted


def _skin(session: Sequence[Recording], jobs: int) -> Skin | str:
    """The skin of a session that is sound by itself, or why it is not to be believed."""
    d = diagnose(session, quick=True, jobs=jobs, propose_term=False)
    if d.verdict.claims:
        return f"it has a gap of its own: {', '.join(e.name for e in d.verdict.causes[0].effects)}"
    if d.verdict.verdict == "unknown":
        return "it has a gap of its own: of unknown cause"
    block = d.problems.get("height")
    if not isinstance(block, HeightBlock):
        return "it has no height of skin"
    temper = max(d.comparison.temper()["height"], 1.0)
    return skin_of(session[0].info.id, block, d.comparison.null.fits["height"], temper)


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


__all__ = ["Diagnosis", "DiagnosisError", "diagnose"]
