"""The least-squares problem of a fit: residuals and exact Jacobian from runs of the model, spread over workers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from time import perf_counter
from typing import Any

import numpy as np

from ..api import Array, Experiment, Model, Result, SolverError
from .cases import Case
from .variables import Variables


@dataclass(frozen=True)
class Evaluation:
    """The problem at one point.

    ``residual`` (N,): (model - data) / scale times the square root of the weight, channel by channel and case by case,
    a zero that is not known taken off;
    ``jacobian`` (N, m): its derivatives by the coordinates, None where not asked for. Where the model could not be
    run both are nan and ``trouble`` says why.
    """

    z: Array
    residual: Array
    jacobian: Array | None
    results: tuple[Result, ...] = ()
    trouble: str = ""

    @property
    def objective(self) -> float:
        """Sum of squares; infinite where the model could not be run."""
        return float(self.residual @ self.residual) if not self.trouble else np.inf


@dataclass
class Tally:
    """Costs of a fit so far: runs of the forward model, failed ones among them, evaluations, wall seconds."""

    forward_runs: int = 0
    failed_runs: int = 0
    evaluations: int = 0
    model_seconds: float = 0.0
    started: float = field(default_factory=perf_counter)

    @property
    def seconds(self) -> float:
        return perf_counter() - self.started

    def add(self, other: Tally) -> None:
        """Count another process' runs; its wall time passes here as well."""
        self.forward_runs += other.forward_runs
        self.failed_runs += other.failed_runs
        self.evaluations += other.evaluations
        self.model_seconds += other.model_seconds


def simulate(model: str | Model, experiment: Experiment, values: Mapping[str, float], wanted: Sequence[str]) -> Any:
    """Run a model, known by its name in another process; a `SolverError` is a result: the optimiser steps back."""
    from ..registry import models

    chosen = models()[model] if isinstance(model, str) else model
    try:
        return chosen.simulate(experiment, values, wanted)
    except SolverError as error:
        return f"{experiment.label}: {error}"


class Problem:
    """Cases, unknowns and a model; `evaluate` is all that optimisers and statistics need.

    ``model`` is a registered name, or a Model (one that pickles, if there is an ``executor``). ``observe`` is called
    after every evaluation.
    """

    def __init__(
        self,
        model: str | Model,
        cases: Sequence[Case],
        variables: Variables,
        executor: Executor | None = None,
        tally: Tally | None = None,
        observe: Callable[[Evaluation, Tally], None] | None = None,
    ) -> None:
        self.model, self.cases, self.variables, self.executor = model, tuple(cases), variables, executor
        self.tally = tally or Tally()
        self.observe = observe
        self.size = sum(case.size for case in self.cases)
        self._last: Evaluation | None = None

    def evaluate(self, z: Array, derivatives: bool = True) -> Evaluation:
        """Run every case at coordinates (m,)."""
        last = self._last
        if last is not None and np.array_equal(last.z, z) and (last.jacobian is not None or not derivatives):
            return last
        values = self.variables.values(z)
        wanted = self.variables.wanted if derivatives else ()
        results = self._run(values, wanted)
        trouble = "; ".join(result for result in results if isinstance(result, str))
        if trouble:
            nothing = np.full(self.size, np.nan)
            evaluation = Evaluation(z.copy(), nothing, np.full((self.size, z.size), np.nan), (), trouble)
        else:
            residual, jacobian = self._assemble(results, values if derivatives else None)
            evaluation = Evaluation(z.copy(), residual, jacobian, tuple(results))
        self._last = evaluation
        self.tally.evaluations += 1
        if self.observe is not None:
            self.observe(evaluation, self.tally)
        return evaluation

    def _run(self, values: Mapping[str, float], wanted: Sequence[str]) -> list[Any]:
        runs = [(self.model, case.experiment, case.values(values), wanted) for case in self.cases]
        if self.executor is None or len(runs) == 1:
            results = [simulate(*run) for run in runs]
        else:
            results = [future.result() for future in [self.executor.submit(simulate, *run) for run in runs]]
        for result in results:
            failed = isinstance(result, str)
            self.tally.forward_runs += 1 if failed else result.cost.forward_runs
            self.tally.failed_runs += failed
            self.tally.model_seconds += 0.0 if failed else result.cost.seconds
        return results

    def _assemble(self, results: Sequence[Result], values: Mapping[str, float] | None) -> tuple[Array, Array | None]:
        residuals, slopes = [], []
        chain = None if values is None else self.variables.chain(values)
        for case, result in zip(self.cases, results, strict=True):
            for channel, data in case.data.items():
                factor = case.weight[channel] / case.scale[channel]
                floating = channel in case.floating
                residuals.append(_levelled((result.channels[channel] - data) * factor, factor, floating))
                if chain is not None:
                    assert result.sensitivities is not None
                    slope = (result.sensitivities[channel] @ chain) * factor[:, None]
                    slopes.append(_levelled(slope, factor, floating))
        return np.concatenate(residuals), np.concatenate(slopes) if slopes else None

    def groups(self) -> list[tuple[int, str, slice]]:
        """(case number, channel, where its values lie in the residual) of every compared curve."""
        found, first = [], 0
        for number, case in enumerate(self.cases):
            for channel, data in case.data.items():
                found.append((number, channel, slice(first, first + data.size)))
                first += data.size
        return found

    def zeros(self, results: Sequence[Result]) -> list[float]:
        """Of every compared curve, the zero [SI] to be taken off the data to fit best; 0 where it is known."""
        found = []
        for number, channel, _ in self.groups():
            case = self.cases[number]
            weight = case.weight[channel] ** 2
            off = weight @ (case.data[channel] - results[number].channels[channel]) / max(weight.sum(), 1e-300)
            found.append(float(off) if channel in case.floating else 0.0)
        return found

    def scaled_data(self, results: Sequence[Result]) -> Array:
        """The data (N,) from their zeros, as the residual weighs them."""
        curves = []
        for (number, channel, _), zero in zip(self.groups(), self.zeros(results), strict=True):
            case = self.cases[number]
            curves.append((case.data[channel] - zero) * case.weight[channel] / case.scale[channel])
        return np.concatenate(curves)


def _levelled(rows: Array, factor: Array, floating: bool) -> Array:
    """Weighted rows (n,) or (n, m) without what a zero of the curve takes, ``factor`` (n,) per unit; so a zero that
    nobody knows is fitted at every evaluation (variable projection, Golub and Pereyra 1973)."""
    size = float(factor @ factor)
    if not floating or size == 0.0:
        return rows
    return np.asarray(rows - np.multiply.outer(factor / size, factor @ rows))
