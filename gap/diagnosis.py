"""From recordings to a diagnosis, step by step."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from acquire.recording.model import Recording
from gap.data import signatures
from gap.data.pauses import without_pauses
from gap.data.session import REST, Session
from gap.data.splits import splits, splits_of_a_rig
from gap.data.tolerances import Tolerance, tolerances
from gap.decision.limits import bounds, confusable
from gap.decision.marks import explains_marks, made_by
from gap.decision.posterior import Posterior, concept, posterior
from gap.decision.thresholds import INSTRUMENT, RIG, Thresholds
from gap.decision.transfer import Shrink, best_elsewhere, in_changed_blocks, plain, plain_gap, transferred
from gap.decision.verdict import Findings, Verdict, decide, in_tolerances, undetectable, without_skin
from gap.effects import library
from gap.inference.evidence import Hypothesis
from gap.inference.hypothesis import Candidate
from gap.inference.problem import Problem
from gap.inference.workers import each
from gap.rig.model import ForwardModel
from gap.rig.problem import RigProblem, against_the_model
from gap.search.compare import Comparison, Effort, compare

INSTRUMENTS = ("cutometer", "aspiration", "microrobot")
"""Those with a built-in forward model."""
SHRUNK, TRANSFERRED, MEMBERS = 3, 2, 3
"""How many causes are tried as a simulation by themselves, how many on what they were not fitted to, and how many
members of the first one's class."""
EFFORTS = {
    "microrobot": Effort(quick_fits=5, least_hope=8.0, refit_singles=7, imitators=1, pair_bases=1, refit_pairs=2)
}
"""How wide to search where simulations are slow."""
Tell = Callable[[str, float], None]
"""Hears the name of a stage, and which share of a diagnosis is usually over when it begins."""


class DiagnosisError(ValueError):
    """The recordings cannot be diagnosed at all: the message names the recording and the channel."""


@dataclass(frozen=True)
class Diagnosis:
    """Everything a report needs. ``shrinks`` maps the first causes to their shrinkage by split; ``remarks`` are plain
    words; ``advised`` is whether the next experiment was asked for."""

    recordings: tuple[Recording, ...]
    problems: Mapping[str, Problem]
    comparison: Comparison
    verdict: Verdict
    signatures: tuple[signatures.Signature, ...]
    shrinks: tuple[Mapping[str, Shrink], ...]
    bounds: Mapping[str, float]  # effect -> strength (SI) that would have been seen
    confusable: tuple[tuple[str, ...], ...]
    remarks: tuple[str, ...]
    next_experiment: Mapping[str, object]
    advised: bool
    seconds: float
    null: Hypothesis  # the simulation by itself, without an effect and
    best: Hypothesis  # with the first cause, if there is one
    thresholds: Thresholds
    fe_solves: int = 0

    @property
    def gap_before(self) -> float:
        """rms of the simulation's residual, in σ, skin of another law not allowed for."""
        return plain_gap(self.null)

    @property
    def gap_after(self) -> float:
        """The same with the first cause."""
        return plain_gap(self.best)


# Systems this small take many times as long on several threads when the cores are busy.
@threadpool_limits.wrap(limits=1)
def diagnose(
    recordings: Sequence[Recording],
    model: ForwardModel | None = None,
    effort: Effort | None = None,
    thresholds: Thresholds | None = None,
    user_effects: Sequence[Path] = (),
    solver: str = "",
    advise: bool = False,
    quick: bool = False,
    jobs: int = 1,
    tell: Tell = lambda stage, share: None,
) -> Diagnosis:
    """Diagnose recordings of one session together; ``model`` is needed for an instrument that is not ours.

    ``user_effects`` are files with further effects, ``solver`` a finite-element model to take the tissue from;
    ``advise`` also looks for the experiment that would split what remains, which simulates whole sessions; ``quick``
    fits few effects and no pairs. ``jobs``
    processes share the fits, but for a solver's, which is a process by itself; the diagnosis is the same. ``tell``
    hears of each stage when it begins.

    Raises DiagnosisError, gap.ModelError.
    """
    begin = clock.perf_counter()
    jobs = 1 if solver else jobs
    t = thresholds or (INSTRUMENT if model is None else RIG)
    recordings = without_pauses(_in_order(recordings))
    tell("reading the recordings", 0.0)
    remarks = _remarks(recordings)
    problems, candidates = _problems(recordings, model, user_effects, solver, jobs)
    marks = tuple(signatures.find(recordings, model.channels if model else None))
    suspects = [c for c in candidates if any(made_by(s, c) for s in marks)]
    effort = effort or EFFORTS.get(recordings[0].info.instrument, Effort())
    effort = effort.quicker() if quick else effort
    comparison = compare(problems, candidates, effort, suspects, jobs, tell)
    for rig in (p for p in problems if isinstance(p, RigProblem)):
        alone = comparison.null.fits[rig.name]
        marks = tuple(m for m in marks if against_the_model(m, rig, alone))
        remarks += rig.at_the_end(alone.nuisance)
    tell("testing on recordings withheld", 0.88)
    null = plain(comparison.problems, comparison.null)
    found = posterior(comparison, candidates, t, marks, plain_gap(null))
    withheld = splits(recordings) if model is None else splits_of_a_rig(recordings)
    found, answers, shrinks = _tested(comparison, found, null, withheld, t, jobs)
    stated = tolerances(recordings[0].info.instrument) if model is None else {}
    verdict = decide(_findings(comparison, found, null, answers, shrinks, stated, t))
    solves = 0
    if solver:
        from gap.null.fe_tissue import checked

        solves, off, words = checked(problems, (answers[0] if answers else comparison.null).fits)
        remarks += words
        if verdict.verdict == "unknown" and off > t.surrogate:
            verdict = undetectable(verdict, f"surrogate: {off:.1f} sigma off > {t.surrogate:g}")
    if advise:
        tell("planning the next experiment", 1.0)
    return Diagnosis(
        recordings=tuple(recordings),
        problems=comparison.problems,
        comparison=comparison,
        verdict=verdict,
        signatures=marks,
        shrinks=tuple(shrinks),
        bounds=bounds(comparison, found.temper),
        confusable=confusable(comparison, found.temper),
        remarks=tuple(remarks),
        next_experiment=_advice(recordings, comparison.null, verdict, model, user_effects) if advise else {},
        advised=advise,
        seconds=clock.perf_counter() - begin,
        null=null,
        best=answers[0] if answers else null,
        thresholds=t,
        fe_solves=solves,
    )


def _tested(
    comparison: Comparison,
    found: Posterior,
    null: Hypothesis,
    withheld: Mapping[str, set[int]],
    t: Thresholds,
    jobs: int,
) -> tuple[Posterior, list[Hypothesis], list[dict[str, Shrink]]]:
    """The posterior with the member of the first class in the lead that meets withheld data best; the first causes as
    simulations by themselves; and their shrinks by split."""
    if not found.causes:
        return found, [], []
    first, *others = found.causes
    rivals: dict[str, Hypothesis] = {concept(first.hypothesis): first.hypothesis}
    for member in first.members:
        rivals.setdefault(concept(member), member)
    members = list(rivals.values())[:MEMBERS]
    every = [*members, *(c.hypothesis for c in others[: SHRUNK - 1])]
    answers = each(lambda h: plain(comparison.problems, h, null), every, jobs)
    asked = answers[: len(members) + TRANSFERRED - 1]
    carried = transferred(comparison.problems, null, asked, withheld, jobs)
    shrinks = [{"fitted": Shrink(plain_gap(null), plain_gap(answer))} for answer in answers]
    for shrunk, by in zip(shrinks, carried, strict=False):
        shrunk |= by
    shown = explains_marks(first.at_marks, t)
    best = 0 if shown else best_elsewhere(carried[: len(members)], t.transfer_lead)
    kept = [best, *range(len(members), len(every))]
    return found.led_by(members[best]), [answers[k] for k in kept], [shrinks[k] for k in kept]


def _findings(
    comparison: Comparison,
    found: Posterior,
    null: Hypothesis,
    answers: Sequence[Hypothesis],
    shrinks: Sequence[Mapping[str, Shrink]],
    stated: Mapping[str, Mapping[str, Tolerance]],
    t: Thresholds,
) -> Findings:
    if not answers:
        return Findings(found, t)
    return Findings(
        posterior=found,
        t=t,
        fitted=in_changed_blocks(null, answers[0]),
        held_out={k: s for k, s in shrinks[0].items() if k != "fitted"},
        without_skin=without_skin(found.causes[0], comparison, found.temper),
        tolerances=in_tolerances(found.causes[0].hypothesis, stated),
    )


def _in_order(recordings: Sequence[Recording]) -> list[Recording]:
    """Recordings by their session clock. Raises DiagnosisError for none, or for several instruments."""
    if not recordings:
        raise DiagnosisError("no recording to diagnose")
    instruments = {r.info.instrument for r in recordings}
    if len(instruments) > 1:
        raise DiagnosisError(
            f"recordings of several instruments ({', '.join(sorted(instruments))}): diagnose each apart"
        )
    for r in recordings:
        if not r.streams:
            raise DiagnosisError(f"recording {r.info.id} has no measured channel")
    return sorted(recordings, key=lambda r: (r.info.start_time, _first_time(r)))


def _first_time(recording: Recording) -> float:
    return min((float(s.time[0]) for s in recording.streams.values() if len(s.time)), default=0.0)


def _remarks(recordings: Sequence[Recording]) -> list[str]:
    """What is weak about the data, in plain words."""
    out = []
    for r in recordings:
        for name, s in r.streams.items():
            bad = int(np.sum(~np.isfinite(s.value)))
            if bad:
                out.append(
                    f"{r.info.id}: channel {name} has {bad} of {len(s.value)} samples that are not numbers; left out"
                )
            if len(s.time) > 1 and np.any(np.diff(s.time) <= 0):
                out.append(f"{r.info.id}: time stamps of {name} do not always increase")
    if recordings[0].info.instrument in INSTRUMENTS and Session(recordings).own_clocks:
        out.append(f"every recording has a clock of its own: rests of {REST:.0f} s between them are assumed")
    if len(recordings) == 1:
        out.append(
            "one recording only: no repeat to take the noise from, and shrinkage on unused data cannot be tested"
        )
    return out


def _problems(
    recordings: Sequence[Recording], model: ForwardModel | None, user_effects: Sequence[Path], solver: str, jobs: int
) -> tuple[Sequence[Problem], tuple[Candidate, ...]]:
    if model is not None:
        if solver:
            raise DiagnosisError("a solver's tissue is for suction probes and the micro-robot, not for a --model rig")
        rig = RigProblem(recordings, model)
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


def _advice(
    recordings: Sequence[Recording],
    null: Hypothesis,
    verdict: Verdict,
    model: ForwardModel | None,
    user_effects: Sequence[Path],
) -> Mapping[str, object]:
    """The next experiment, where more than one explanation survives on an instrument that we can simulate."""
    if model is not None or verdict.verdict in ("none", "undetectable") or not verdict.causes:
        return {}
    twins = [h for h in verdict.causes[0].members if concept(h) != concept(verdict.causes[0].hypothesis)][:1]
    others = [null] if verdict.posterior.none > 0.02 else []
    others += [c.hypothesis for c in verdict.causes[1:] if c.probability > 0.02]
    rivals = [verdict.causes[0].hypothesis, *twins, *others][:3]
    if len(rivals) < 2:
        return {}
    from gap.design.next_experiment import next_experiment

    return next_experiment(recordings, rivals, library(recordings[0].info.instrument, user_effects))
