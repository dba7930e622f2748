"""A fit from recordings to result: cases, stages, starts, statistics."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..api import Model, ModelInfo
from ..registry import models
from .bounds import released
from .carried import traced
from .cases import Case, cases, matches
from .gauge import pulled
from .multistart import Found, Search, elsewhere, failed
from .optimisers import FitError, Optimum
from .pictures import pictures
from .problem import Evaluation, Problem, Tally
from .profile import profiles
from .result import Curve, Effort, FitResult, Start
from .ridge import widened
from .spec import Spec, SpecError, Stage, load_spec, read_spec
from .stated import common, remarks
from .statistics import Uncertainty, doubts, estimates, misfit, uncertainty, vaf
from .target import Noise
from .trust import reasons, silent
from .variables import Variables

if TYPE_CHECKING:
    from .posterior import Posterior


@dataclass(frozen=True)
class Progress:
    """Where a fit stands: its task, evaluations so far, the best objective over that of the start, seconds."""

    what: str
    evaluations: int
    forward_runs: int
    relative_objective: float
    seconds: float


Observer = Callable[[Progress], None]


def fit(
    recordings: Sequence[Any],
    spec: Spec | Mapping[str, Any] | Path | str | None = None,
    *,
    model: str | Model = "",
    executor: Executor | None = None,
    progress: Observer | None = None,
    posterior: bool = False,
) -> FitResult:
    """Identify a model's free parameters from one or several recordings together.

    Parameters
    ----------
    recordings : `acquire.recording.Recording` objects, or anything shaped like them (see cases.py)
    spec : a Spec, its plain data, or a file; without one, the parameters that the papers identified are free
    model : a model's name, needed where the specification has none; or a Model that is not registered under any
    executor : runs the recordings of an evaluation, or the starts of a multi-start fit, side by side
    progress : called with a `Progress` after every evaluation that this process sees
    posterior : also draw from the posterior (see posterior.py); needs the extra ``posterior``

    Raises
    ------
    SpecError, RecordingError
        A specification or recording that cannot be used; both are ValueErrors and say where and why.
    FitError
        The model cannot be run at the start, nor, with ``starts: auto``, at others around it.
    """
    named, forward = (model, model) if isinstance(model, str) else (model.info.name, model)
    spec = _read(spec, named, None if isinstance(model, str) else model.info)
    forward = forward or spec.model
    chosen = models()[forward] if isinstance(forward, str) else forward
    variables = spec.variables(chosen.info)
    found = cases(recordings, spec, chosen.info)
    tally = Tally()
    watch = _Watch(progress)
    values, stages = variables.values(variables.start), []
    for stage in spec.stages:
        moving = variables.only(stage.moving(variables.symbols), values)
        watch.begin(stage.name)
        search = Search(forward, _of_stage(found, stage), moving, spec, executor, tally, watch)
        if stage is spec.stages[-1]:
            break
        optimum, _ = search.from_start()
        values = moving.values(optimum.evaluation.z)
        stages.append(f"{stage.name}: {', '.join(moving.symbols)}; {optimum.reason}")
    problem, optimum, starts = _last_stage(search)
    ended = optimum.reason if len(starts) == 1 else f"best of {len(starts)} starts"
    stages.append(f"{stage.name}: {', '.join(moving.symbols)}; {ended}")
    result = _result(problem, optimum, spec, variables, starts, tuple(stages))
    return replace(result, posterior=_posterior(problem, optimum, spec, executor, watch)) if posterior else result


def _last_stage(search: Search) -> tuple[Problem, Optimum, tuple[Start, ...]]:
    """The optimum of the last stage, evaluated with its results and Jacobian, and the starts that were tried.

    Where the specification leaves their number open, one start must do if it explains the data down to white noise;
    else further ones are tried until two agree.
    """
    spec = search.spec
    problem = Problem(search.forward, search.cases, search.moving, search.executor, search.tally, search.observe)
    found: list[Found]
    if spec.starts == "auto":
        found = search.from_start_or_near()
        if len(found) == 1 and not _explains(problem, search.best(found)):
            found = search.until_confirmed(found[0])
    elif spec.starts == 1:
        found = [search.from_start()]
    else:
        found = search.spread(spec.starts)
    best = search.best(found)
    return problem, replace(best, evaluation=problem.evaluate(best.evaluation.z)), tuple(start for _, start in found)


def _posterior(problem: Problem, optimum: Optimum, spec: Spec, executor: Executor | None, watch: _Watch) -> Posterior:
    from .posterior import posterior  # emcee is an extra

    best = optimum.evaluation
    noise = Noise.of(uncertainty(problem, best))
    return posterior(problem, best.z, noise, spec.seed, executor, watch.tell(problem.tally))


def _explains(problem: Problem, optimum: Optimum) -> bool:
    """Whether a fit leaves nothing that another minimum could explain: white residuals and little variance."""
    best = optimum.evaluation
    return not misfit(uncertainty(problem, best), vaf(best.residual, problem.scaled_data(best.results)))


def _read(spec: Spec | Mapping[str, Any] | Path | str | None, model: str, info: ModelInfo | None) -> Spec:
    if spec is None:
        return read_spec({"model": model}, info)
    if not isinstance(spec, Spec):
        spec = read_spec({"model": model, **spec}, info) if isinstance(spec, Mapping) else load_spec(spec, model, info)
    if model not in ("", spec.model):
        raise SpecError(f"model: the specification is for {spec.model}, not for {model}")
    return spec


class _Watch:
    """Turns evaluations into progress."""

    def __init__(self, observer: Observer | None) -> None:
        self.observer, self.what, self.first, self.best = observer, "", np.nan, np.inf

    def begin(self, what: str) -> None:
        self.what, self.first, self.best = what, np.nan, np.inf

    def tell(self, tally: Tally) -> Callable[[str], None]:
        """An observer of steps that have no objective."""

        def told(what: str) -> None:
            if self.observer is not None:
                self.observer(Progress(what, tally.evaluations, tally.forward_runs, np.nan, tally.seconds))

        return told

    def __call__(self, evaluation: Evaluation, tally: Tally) -> None:
        if np.isnan(self.first):
            self.first = evaluation.objective
        self.best = min(self.best, evaluation.objective)
        if self.observer is not None:
            relative = self.best / self.first if np.isfinite(self.first) and self.first > 0.0 else np.nan
            self.observer(Progress(self.what, tally.evaluations, tally.forward_runs, relative, tally.seconds))


def _of_stage(found: Sequence[Case], stage: Stage) -> list[Case]:
    if not stage.recordings:
        return list(found)
    chosen = [
        case
        for number, case in enumerate(found)
        if any(matches(p, case.label, case.experiment.instrument, number) for p in stage.recordings)
    ]
    if not chosen:
        raise FitError(f"stage {stage.name}: {', '.join(stage.recordings)} fits no recording")
    return chosen


def _result(
    problem: Problem,
    optimum: Optimum,
    spec: Spec,
    variables: Variables,
    starts: tuple[Start, ...],
    stages: tuple[str, ...],
) -> FitResult:
    best = optimum.evaluation
    known = released(problem, best, uncertainty(problem, best))
    known = pulled(problem, best, traced(problem, best, widened(problem, best, known)))
    first = {f.symbol: f.start for f in variables.free}
    found = [
        replace(e, free=replace(e.free, start=first[e.free.symbol]))  # where the fit began, not its last stage
        for e in profiles(problem, best, known, estimates(problem, best, known), spec)
    ]
    explained = vaf(best.residual, problem.scaled_data(best.results))
    fatal = [misfit(known, explained), silent(problem, best, known)]
    if any(fatal):
        found = [replace(e, identifiable=False) for e in found]
    values = problem.variables.values(best.z)
    setups = {case.label: case.setup for case in problem.cases}
    about = [*known.warnings, *doubts(found), *remarks(setups)]
    why = reasons(fatal, found, optimum.converged)
    warnings = _warnings(optimum, about, starts, why, bool(fatal[0]))
    slope = np.array([f.slope(values[f.symbol]) for f in problem.variables.free])
    tally = problem.tally
    return FitResult(
        info=variables.info,
        spec=spec,
        estimates=tuple(found),
        parameters=values | common([one.parameters for one in setups.values()]),
        covariance=known.covariance * np.outer(slope, slope),
        correlation=known.correlation,
        vaf=explained,
        objective=best.objective,
        curves=_curves(problem, best, known),
        drives={case.label: case.experiment.drive for case in problem.cases},
        fields=pictures(problem, values),
        experiments={case.label: case.experiment for case in problem.cases},
        model=models()[problem.model] if isinstance(problem.model, str) else problem.model,
        notes={case.label: case.note for case in problem.cases},
        setups=setups,
        starts=starts,
        stages=stages,
        converged=optimum.converged,
        reason=optimum.reason,
        trusted=not why,
        reasons=tuple(why),
        describes=not fatal[0],
        warnings=warnings,
        effort=Effort(tally.forward_runs, tally.failed_runs, tally.evaluations, tally.seconds, tally.model_seconds),
    )


def _warnings(
    optimum: Optimum, known: Sequence[str], starts: Sequence[Start], why: Sequence[str], leaves: bool
) -> tuple[str, ...]:
    """Warnings to read the result with, the gravest first; ``why`` it is not to be trusted, none where it is;
    ``leaves``: the model leaves what another minimum might explain."""
    warnings = [*known, *dict.fromkeys(w for r in optimum.evaluation.results for w in r.warnings)]
    if not optimum.converged:
        warnings.insert(0, f"the optimiser stopped before it converged: {optimum.reason}")
    distinct, broken = elsewhere(starts), failed(starts)
    if broken:
        warnings.append(f"the model could not be run at {broken} of {len(starts)} starts")
    if distinct:
        warnings.append(f"{distinct} of {len(starts)} starts ended in a worse place: the objective has several minima")
    if why:
        alone = leaves and len(starts) - distinct - broken < 2
        told = f"not to be trusted: {'; '.join(why)}"
        warnings.insert(int(not optimum.converged), told + ("; try more starts (starts: 20)" if alone else ""))
    return tuple(warnings)


def _curves(problem: Problem, best: Evaluation, known: Uncertainty) -> tuple[Curve, ...]:
    data, curves = problem.scaled_data(best.results), []
    zeros = problem.zeros(best.results)
    for (number, channel, where), noise, together, zero in zip(
        problem.groups(), known.noise, known.persistence, zeros, strict=True
    ):
        case, result = problem.cases[number], best.results[number]
        own = vaf(best.residual[where], data[where])
        curves.append(
            Curve(
                case.label,
                case.experiment.instrument,
                channel,
                case.experiment.time,
                case.data[channel],
                result.channels[channel] + zero,
                case.weight[channel] ** 2,
                own,
                noise,
                together,
                zero if channel in case.floating else None,
            )
        )
    return tuple(curves)
