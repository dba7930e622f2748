"""The null models of a session and the effects that may be hidden in it, by its instrument."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from acquire.recording.model import Recording
from gap.data import signatures
from gap.data.checks import DiagnosisError
from gap.data.session import Session
from gap.effects.load import generic, library
from gap.inference.hypothesis import Candidate
from gap.inference.problem import Problem
from gap.rig.model import ForwardModel
from gap.rig.problem import RigProblem

Gathered = tuple[Sequence[Problem], tuple[Candidate, ...]]


def problems_of(
    recordings: Sequence[Recording],
    model: ForwardModel | None = None,
    user_effects: Sequence[Path] = (),
    solver: str = "",
    jobs: int = 1,
    unknown_regulator: bool = False,
) -> Gathered:
    """Null models of recordings of one session, and the effects that can be fitted beside them; arguments as for
    `gap.diagnosis.diagnose`. With an ``unknown_regulator``, a suction instrument's may be of any structure.

    Raises DiagnosisError for an instrument without a built-in forward model where no ``model`` is given, and for a
    ``solver`` beside one.
    """
    if model is not None:
        if solver:
            raise DiagnosisError("a solver's tissue is for suction probes and the micro-robot, not for a --model rig")
        rig = RigProblem(recordings, model, generic(user_effects))
        return [rig], rig.candidates
    problems, candidates = _built_in(recordings, user_effects, solver, jobs, unknown_regulator)
    return problems, _possible(candidates, recordings)


def _built_in(
    recordings: Sequence[Recording], user_effects: Sequence[Path], solver: str, jobs: int, unknown_regulator: bool
) -> Gathered:
    instrument = recordings[0].info.instrument
    if instrument in ("cutometer", "aspiration"):
        from gap.null.fe_tissue import fe_height
        from gap.null.suction import suction_problems

        effects = library(instrument, user_effects)
        if solver:
            return suction_problems(recordings, effects, fe_height(solver))
        return suction_problems(recordings, effects, jobs=jobs, unknown_regulator=unknown_regulator)
    if instrument == "microrobot":
        from gap.null.fe_sheet import fe_force
        from gap.null.robot import robot_problems

        return robot_problems(recordings, library(instrument, user_effects), *([fe_force(solver)] if solver else []))
    raise DiagnosisError(f"instrument {instrument!r} has no built-in forward model: give one with --model file.py:Name")


def _possible(candidates: Sequence[Candidate], recordings: Sequence[Recording]) -> tuple[Candidate, ...]:
    """The candidates without those that would have left marks that are not there (a repeated value in place of a lost
    sample), or that need a clock which goes on through the session, where each recording has its own."""
    absent, anew = signatures.never_repeat(recordings), Session(recordings).own_clocks
    left_out = (
        [("dropped_samples", 0)] * absent + [("clock_skew", form) for form in (1, 2) if anew] + [("latency", 1)] * anew
    )
    return tuple(c for c in candidates if (c.name, c.form) not in left_out)
