"""A fit from recordings to result: cases, stages, starts, statistics."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..api import Array, Model
from ..registry import models
from .cases import Case, cases, matches
from .optimisers import FitError, Optimum, minimise
from .problem import Evaluation, Problem, Tally
from .profile import profiles
from .result import Curve, Effort, FitResult, Start
from .spec import Spec, SpecError, Stage, load_spec, read_spec
from .statistics import doubts, estimates, uncertainty
from .variables import Free, Variables


@dataclass(frozen=True)
class Progress:
    """Where a fit stands: what it does, evaluations so far, the best objective over that of the start, seconds."""

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
) -> FitResult:
    """Identify a model's free parameters from one or several recordings together.

    Parameters
    ----------
    recordings : `acquire.recording.Recording` objects, or anything shaped like them (see cases.py)
    spec : a Spec, its plain data, or a file; without one, what the papers identified is free
    model : a model's name, needed where the specification has none; or a Model that is not registered under any
    executor : runs the recordings of an evaluation, or the starts of a multi-start fit, side by side
    progress : called with a `Progress` after every evaluation that this process sees

    Raises
    ------
    SpecError, RecordingError
        A specification or recording that cannot be used; both are ValueErrors and say where and why.
    FitError
        The model cannot be run at the start.
    """
    named, forward = (model, model) if isinstance(model, str) else (model.info.name, model)
    spec = _read(spec, named)
    forward = forward or spec.model
    chosen = models()[forward] if isinstance(forward, str) else forward
    variables = spec.variables(chosen.info)
    found = cases(recordings, spec, chosen.info)
    tally = Tally()
    watch = _Watch(progress)
    values, stages = variables.values(variables.start), []
    for number, stage in enumerate(spec.stages):
        last = number == len(spec.stages) - 1
        moving = variables.only(stage.moving(variables.symbols), values)
        chosen_cases = _of_stage(found, stage)
        watch.begin(stage.name)
        if last and spec.starts > 1:
            break
        problem = Problem(forward, chosen_cases, moving, executor, tally, watch)
        optimum = minimise(problem, spec.optimiser, spec.evaluations, spec.tolerance)
        values = moving.values(optimum.evaluation.z)
        stages.append(f"{stage.name}: {', '.join(moving.symbols)}; {optimum.reason}")
    if spec.starts > 1:
        optimum, starts = _multistart(forward, chosen_cases, moving, spec, executor, tally, watch)
        stages.append(f"{stage.name}: {', '.join(moving.symbols)}; best of {spec.starts} starts")
        problem = Problem(forward, chosen_cases, moving, executor, tally, watch)
        optimum = replace(optimum, evaluation=problem.evaluate(optimum.evaluation.z))
    else:
        starts = [_start(moving, moving.start, optimum)]
    return _result(problem, optimum, spec, variables, tuple(starts), tuple(stages))


def _read(spec: Spec | Mapping[str, Any] | Path | str | None, model: str) -> Spec:
    if spec is None:
        return read_spec({"model": model})
    if not isinstance(spec, Spec):
        spec = read_spec({"model": model, **spec}) if isinstance(spec, Mapping) else load_spec(spec, model)
    if model not in ("", spec.model):
        raise SpecError(f"model: the specification is for {spec.model}, not for {model}")
    return spec


class _Watch:
    """Turns evaluations into progress."""

    def __init__(self, observer: Observer | None) -> None:
        self.observer, self.what, self.first, self.best = observer, "", np.nan, np.inf

    def begin(self, what: str) -> None:
        self.what, self.first, self.best = what, np.nan, np.inf

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


def _multistart(
    forward: str | Model,
    found: Sequence[Case],
    moving: Variables,
    spec: Spec,
    executor: Executor | None,
    tally: Tally,
    watch: _Watch,
) -> tuple[Optimum, list[Start]]:
    """Optimise from several points, each as one job of the executor; the best optimum, and all of them."""
    points = [moving.start, *_scattered(moving.free, spec)]
    jobs = [
        (forward, tuple(found), replace(moving, free=tuple(_from(f, z) for f, z in zip(moving.free, p, strict=True))))
        for p in points
    ]
    if executor is None:
        done = [_one_start(*job, spec, tally, watch) for job in jobs]
    else:
        done = [future.result() for future in [executor.submit(_one_start, *job, spec) for job in jobs]]
        for _, cost in done:
            tally.forward_runs += cost.forward_runs
            tally.failed_runs += cost.failed_runs
            tally.evaluations += cost.evaluations
            tally.model_seconds += cost.model_seconds
    starts = []
    best: Optimum | None = None
    for (_, _, own), (optimum, _) in zip(jobs, done, strict=True):
        if isinstance(optimum, str):
            starts.append(Start({f.symbol: f.start for f in own.free}, {}, np.inf, False, optimum))
            continue
        starts.append(_start(own, own.start, optimum))
        if best is None or optimum.evaluation.objective < best.evaluation.objective:
            # the coordinate of a linear parameter is counted in its start: back to the first one's
            values = own.values(optimum.evaluation.z)
            z = np.array([f.coordinate(values[f.symbol]) for f in moving.free])
            best = replace(optimum, evaluation=replace(optimum.evaluation, z=z))
    if best is None:
        raise FitError(f"none of {len(points)} starts could be run; the first: {starts[0].reason}")
    return best, starts


def _one_start(
    forward: str | Model,
    found: Sequence[Case],
    own: Variables,
    spec: Spec,
    tally: Tally | None = None,
    watch: _Watch | None = None,
) -> tuple[Optimum | str, Tally]:
    """One optimisation, without its runs' results: they would be many megabytes on their way between processes."""
    tally = tally or Tally()
    problem = Problem(forward, found, own, None, tally, watch)
    try:
        optimum = minimise(problem, spec.optimiser, spec.evaluations, spec.tolerance)
    except FitError as error:
        return str(error), tally
    return replace(optimum, evaluation=replace(optimum.evaluation, results=(), jacobian=None)), tally


def _from(free: Free, z: float) -> Free:
    return replace(free, start=free.value(z))


def _scattered(free: Sequence[Free], spec: Spec) -> list[Array]:
    """Points spread around the start by a Latin hypercube (McKay, Beckman and Conover 1979)."""
    random = np.random.default_rng(spec.seed)
    count = spec.starts - 1
    strata = np.stack([random.permutation(count) for _ in free], axis=1)
    unit = 2.0 * (strata + random.random(strata.shape)) / count - 1.0
    points = []
    for row in unit:
        point = []
        for f, x in zip(free, row, strict=True):
            reach = (
                np.log(spec.spread) if f.log else min(0.5 * (f.upper - f.lower), (spec.spread - 1.0) * f.unit) / f.unit
            )
            z = f.coordinate(f.start) + x * reach
            point.append(float(np.clip(z, f.coordinate(f.lower), f.coordinate(f.upper))))
        points.append(np.array(point))
    return points


def _start(own: Variables, z: Array, optimum: Optimum) -> Start:
    first, last = own.values(z), own.values(optimum.evaluation.z)
    return Start(
        {s: first[s] for s in own.symbols},
        {s: last[s] for s in own.symbols},
        optimum.evaluation.objective,
        optimum.converged,
        optimum.reason,
    )


def _result(
    problem: Problem,
    optimum: Optimum,
    spec: Spec,
    variables: Variables,
    starts: tuple[Start, ...],
    stages: tuple[str, ...],
) -> FitResult:
    best = optimum.evaluation
    known = uncertainty(problem, best)
    first = {f.symbol: f.start for f in variables.free}
    found = [
        replace(e, free=replace(e.free, start=first[e.free.symbol]))  # where the fit began, not its last stage
        for e in profiles(problem, best, known, estimates(problem, best, known), spec)
    ]
    warnings = [*known.warnings, *doubts(found)]
    if not optimum.converged:
        warnings.insert(0, f"the optimiser stopped before it converged: {optimum.reason}")
    distinct = sum(s.objective > 1.01 * best.objective for s in starts)
    if distinct:
        warnings.append(f"{distinct} of {len(starts)} starts ended in a worse place: the objective has several minima")
    data = problem.scaled_data()
    curves = []
    for (number, channel, where), noise, together in zip(problem.groups(), known.noise, known.persistence, strict=True):
        case, result = problem.cases[number], best.results[number]
        own = best.residual[where]
        curves.append(
            Curve(
                case.label,
                case.experiment.instrument,
                channel,
                case.experiment.time,
                case.data[channel],
                result.channels[channel],
                case.weight[channel] ** 2,
                _vaf(own, data[where]),
                noise,
                together,
            )
        )
    values = problem.variables.values(best.z)
    slope = np.array([f.slope(values[f.symbol]) for f in problem.variables.free])
    tally = problem.tally
    return FitResult(
        info=variables.info,
        spec=spec,
        estimates=tuple(found),
        parameters=values,
        covariance=known.covariance * np.outer(slope, slope),
        correlation=known.correlation,
        vaf=_vaf(best.residual, data),
        objective=best.objective,
        curves=tuple(curves),
        drives={case.label: case.experiment.drive for case in problem.cases},
        fields={case.label: result.fields for case, result in zip(problem.cases, best.results, strict=True)},
        notes={case.label: case.note for case in problem.cases},
        starts=starts,
        stages=stages,
        converged=optimum.converged,
        reason=optimum.reason,
        warnings=tuple(warnings),
        effort=Effort(tally.forward_runs, tally.failed_runs, tally.evaluations, tally.seconds, tally.model_seconds),
    )


def _vaf(residual: Array, data: Array) -> float:
    """Variance accounted for as paper M counts it: 1 - sum of squared residuals over sum of squared data.

    nan for a curve that is zero or has no weight."""
    size = float(data @ data)
    return 1.0 - float(residual @ residual) / size if size > 0.0 else float("nan")
