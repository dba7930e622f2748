"""From recordings to a diagnosis: check the data, build the problems, compare, judge, and test on what was not used."""

from __future__ import annotations

import time as clock
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from acquire.recording.model import Recording
from gap.data import signatures
from gap.data.pauses import without_pauses
from gap.data.session import REST, Session
from gap.decision.transfer import Shrink, plain, plain_gap, shrink, splits, splits_of_a_rig, transferred
from gap.decision.verdict import RIG, Judgement, Verdict, borne_out, concept, judge, made_by
from gap.effects.load import library
from gap.inference.evidence import Hypothesis
from gap.inference.hypothesis import Candidate
from gap.inference.problem import Problem
from gap.inference.workers import each
from gap.rig.model import ForwardModel
from gap.rig.problem import RigProblem, against_the_model
from gap.search.compare import Comparison, Effort, compare

INSTRUMENTS = ("cutometer", "aspiration", "microrobot")
"""Those with a built-in forward model."""


SHRUNK, TRANSFERRED = 3, 2
"""How many causes are tried as a simulation by themselves, and how many on what they were not fitted to."""
EFFORTS = {
    "microrobot": Effort(quick_fits=5, least_hope=8.0, refit_singles=7, imitators=1, pair_bases=1, refit_pairs=2)
}
"""How wide to search where simulations are slow."""


class DiagnosisError(ValueError):
    """The recordings cannot be diagnosed at all: the message names the recording and the channel."""


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
    next_experiment: Mapping[str, object]
    seconds: float
    null: Hypothesis  # the simulation by itself, without an effect and
    best: Hypothesis  # with the first cause, if there is one
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
    rules: Judgement | None = None,
    user_effects: Sequence[Path] = (),
    solver: str = "",
    advise: bool = True,
    jobs: int = 1,
) -> Diagnosis:
    """Diagnose recordings of one session together; ``model`` is needed for an instrument that is not ours.

    ``user_effects`` are files with further effects, ``solver`` a finite-element model to take the tissue from;
    ``advise`` also looks for the experiment that would split what remains. ``jobs`` processes share the fits, but for a
    solver's, which is a process by itself; the diagnosis is the same.

    Raises DiagnosisError, gap.rig.model.ModelError.
    """
    begin = clock.perf_counter()
    jobs = 1 if solver else jobs
    rules = rules or (Judgement() if model is None else RIG)
    recordings = without_pauses(_in_order(recordings))
    remarks = _remarks(recordings)
    problems, candidates = _problems(recordings, model, user_effects, solver, jobs)
    marks = tuple(signatures.find(recordings, model.channels if model else None))
    suspects = [c for c in candidates if any(made_by(s, c) for s in marks)]
    effort = effort or EFFORTS.get(recordings[0].info.instrument, Effort())
    comparison = compare(problems, candidates, effort, suspects, jobs)
    for rig in (p for p in problems if isinstance(p, RigProblem)):
        alone = comparison.null.fits[rig.name]
        marks = tuple(m for m in marks if against_the_model(m, rig, alone))
        remarks += rig.at_the_end(alone.nuisance)
    verdict = judge(comparison, candidates, rules, marks)
    blocks = {p.name: p for p in problems}
    solves, off = 0, 0.0
    if solver:
        from gap.null.fe_tissue import checked

        answer = verdict.causes[0].hypothesis if verdict.causes else comparison.null
        solves, off, words = checked(problems, answer.fits)
        remarks += words
    withheld = splits(recordings) if model is None else splits_of_a_rig(recordings)
    null = plain(blocks, comparison.null)
    answers = each(lambda cause: plain(blocks, cause.hypothesis, null), verdict.causes[:SHRUNK], jobs)
    shrinks = [{"fitted": Shrink(plain_gap(null), plain_gap(answer))} for answer in answers]
    carried = transferred(blocks, null, answers[:TRANSFERRED], withheld, jobs)
    for shrunk, by in zip(shrinks, carried, strict=False):
        shrunk |= by
    if answers:
        verdict = borne_out(verdict, comparison, shrinks[0], rules)
    if verdict.verdict == "unknown" and off > rules.surrogate:
        verdict = replace(verdict, verdict="undetectable")
    return Diagnosis(
        recordings=tuple(recordings),
        problems=blocks,
        comparison=comparison,
        verdict=verdict,
        signatures=marks,
        shrinks=tuple(shrinks),
        bounds=_bounds(comparison, verdict),
        confusable=confusable(comparison, verdict.temper),
        remarks=tuple(remarks),
        next_experiment=_advice(recordings, comparison.null, verdict, model, user_effects) if advise else {},
        seconds=clock.perf_counter() - begin,
        null=null,
        best=answers[0] if answers else null,
        fe_solves=solves,
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
    others = [null] if verdict.probability_none > 0.02 else []
    others += [c.hypothesis for c in verdict.causes[1:] if c.probability > 0.02]
    rivals = [verdict.causes[0].hypothesis, *twins, *others][:3]
    if len(rivals) < 2:
        return {}
    from gap.design.next_experiment import next_experiment

    return next_experiment(recordings, rivals, library(recordings[0].info.instrument, user_effects))


def _bounds(comparison: Comparison, verdict: Verdict, seen_at: float = 3.0) -> dict[str, float]:
    """For each effect, the strength that would have stood out by ``seen_at`` σ; inf where none in the prior would."""
    out: dict[str, float] = {}
    for s in comparison.screened:
        strengths = [k for k, p in enumerate(s.candidate.parameters) if p.null is not None]
        if not strengths or not s.detectability:
            continue
        p = s.candidate.parameters[strengths[0]]
        temper = max(verdict.temper[b] for b in s.candidate.blocks)
        per_strength = [
            seen_at * abs(s.candidate.values(u)[p.name] - (p.null or 0.0)) / (d / np.sqrt(temper))
            for u, d in s.detectability
            if d > 0
        ]
        bound = float(np.median(per_strength)) if per_strength else float("inf")
        out[s.candidate.key] = min(bound, out.get(s.candidate.key, float("inf")))
    return out


def confusable(
    comparison: Comparison, temper: Mapping[str, float], like: float = 0.985, apart: float = 3.0
) -> tuple[tuple[str, ...], ...]:
    """Groups of effects that no fit of these data can split, in the forms that fit them best.

    Their traces, after the nuisance refit, are the same direction and end less than ``apart`` σ from each other. (Of a
    large effect, poor copies too have nearly its direction, but what they leave gives them away.)
    """
    best: dict[str, Hypothesis] = {}
    for h in sorted(comparison.hypotheses, key=lambda h: h.deviance):
        if len(h.effects) == 1:
            best.setdefault(h.effects[0].name, h)
    null, traces = comparison.null, {}
    for name, h in best.items():
        parts = [(null.fits[b].residual - h.fits[b].residual) / np.sqrt(temper[b]) for b in comparison.problems]
        if np.any(change := np.concatenate(parts)):
            traces[name] = change
    groups: list[set[str]] = []
    for one, other in combinations(traces, 2):
        a, b = traces[one], traces[other]
        alike = abs(float(a @ b)) > like * np.linalg.norm(a) * np.linalg.norm(b)
        if alike and np.linalg.norm(a - b) < apart:
            touching = [g for g in groups if one in g or other in g]
            groups = [g for g in groups if g not in touching] + [{one, other}.union(*touching)]
    return tuple(tuple(sorted(g)) for g in groups)


__all__ = ["Diagnosis", "DiagnosisError", "diagnose", "shrink"]
