"""Optimisations from several starts: as many as were asked for, or until two of them agree on the best place."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np

from ..api import Array, Model
from .cases import Case
from .optimisers import FitError, Optimum, minimise
from .problem import Evaluation, Problem, Tally
from .result import Start
from .spec import Spec
from .variables import Free, Variables

SAME = 1.01  # times the best objective: a start that ended below it ended in the same place
MOST = 8  # starts of an automatic search altogether
Found = tuple[Optimum | None, Start]  # where a start led; None where the model could not be run
ROUND = 2  # further starts of an automatic search between two looks at whether any agree


@dataclass(frozen=True)
class Search:
    """Shared by every start of a fit."""

    forward: str | Model
    cases: Sequence[Case]
    moving: Variables
    spec: Spec
    executor: Executor | None
    tally: Tally
    observe: Callable[[Evaluation, Tally], None] | None

    def from_start(self) -> tuple[Optimum, Start]:
        """The optimum reached from the specification's own start. Raises FitError where the model cannot run there."""
        problem = Problem(self.forward, self.cases, self.moving, self.executor, self.tally, self.observe)
        optimum = minimise(problem, self.spec.optimiser, self.spec.evaluations, self.spec.tolerance)
        return optimum, _start(self.moving, optimum)

    def from_start_or_near(self) -> list[Found]:
        """From the specification's own start; where the model cannot be run there, from others until two agree.

        Raises FitError, saying why the model cannot be run at the start, where it can be run at none of them.
        """
        try:
            return [self.from_start()]
        except FitError as error:
            values = {f.symbol: f.start for f in self.moving.free}
            found = self.until_confirmed((None, Start(values, {}, np.inf, False, str(error))))
            if all(optimum is None for optimum, _ in found):
                raise
            return found

    def spread(self, count: int) -> list[Found]:
        """``count`` optimisations, from the start and points scattered around it, side by side on the executor."""
        return self._run([self.moving.start, *_scattered(self.moving.free, self.spec, count - 1)])

    def until_confirmed(self, first: Found) -> list[Found]:
        """``first`` and further starts, until two have ended in the best place found, or `MOST` have been tried."""
        points = _scattered(self.moving.free, self.spec, MOST - 1)
        found: list[Found] = [first]
        while points and not _confirmed(found):
            found += self._run(points[:ROUND])
            points = points[ROUND:]
        return found

    def best(self, found: Sequence[Found]) -> Optimum:
        """The best optimum, in the coordinates of the specification's own start. Raises FitError for none."""
        reached = [optimum for optimum, _ in found if optimum is not None]
        if not reached:
            raise FitError(f"none of {len(found)} starts could be run; the first: {found[0][1].reason}")
        return min(reached, key=lambda optimum: optimum.evaluation.objective)

    def _run(self, points: Sequence[Array]) -> list[Found]:
        own = [
            replace(self.moving, free=tuple(_from(f, z) for f, z in zip(self.moving.free, point, strict=True)))
            for point in points
        ]
        if self.executor is None:
            done = [_one(self.forward, self.cases, o, self.spec, self.tally, self.observe) for o in own]
        else:
            futures = [self.executor.submit(_one, self.forward, tuple(self.cases), o, self.spec) for o in own]
            done = [future.result() for future in futures]
            for _, cost in done:
                self.tally.add(cost)
        found: list[Found] = []
        for o, (optimum, _) in zip(own, done, strict=True):
            if isinstance(optimum, str):
                found.append((None, Start({f.symbol: f.start for f in o.free}, {}, np.inf, False, optimum)))
            else:
                # the coordinate of a linear parameter is counted in its start: back to the first one's
                values = o.values(optimum.evaluation.z)
                z = np.array([f.coordinate(values[f.symbol]) for f in self.moving.free])
                moved = replace(optimum, evaluation=replace(optimum.evaluation, z=z))
                found.append((moved, _start(o, optimum)))
        return found


def elsewhere(starts: Sequence[Start]) -> int:
    """How many starts at which the model could be run ended in a worse place than the best one."""
    best = min(start.objective for start in starts)
    return sum(SAME * best < start.objective < np.inf for start in starts)


def failed(starts: Sequence[Start]) -> int:
    """How many starts the model could not be run at."""
    return sum(start.objective == np.inf for start in starts)


def _confirmed(found: Sequence[Found]) -> bool:
    starts = [start for _, start in found]
    return len(found) - elsewhere(starts) - failed(starts) >= 2


def _one(
    forward: str | Model,
    cases: Sequence[Case],
    own: Variables,
    spec: Spec,
    tally: Tally | None = None,
    observe: Callable[[Evaluation, Tally], None] | None = None,
) -> tuple[Optimum | str, Tally]:
    """One optimisation, without its runs' results: they would be many megabytes on their way between processes."""
    tally = tally or Tally()
    try:
        optimum = minimise(
            Problem(forward, cases, own, None, tally, observe), spec.optimiser, spec.evaluations, spec.tolerance
        )
    except FitError as error:
        return str(error), tally
    return replace(optimum, evaluation=replace(optimum.evaluation, results=(), jacobian=None)), tally


def _from(free: Free, z: float) -> Free:
    return replace(free, start=free.value(z))


def _scattered(free: Sequence[Free], spec: Spec, count: int) -> list[Array]:
    """Points spread around the start by a Latin hypercube (McKay, Beckman and Conover 1979)."""
    random = np.random.default_rng(spec.seed)
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


def _start(own: Variables, optimum: Optimum) -> Start:
    last = own.values(optimum.evaluation.z)
    return Start(
        {f.symbol: f.start for f in own.free},
        {s: last[s] for s in own.symbols},
        optimum.evaluation.objective,
        optimum.converged,
        optimum.reason,
    )
