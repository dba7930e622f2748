"""A suction experiment from preload to the last sample, with parameter derivatives along the way."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from math import inf, isfinite

from ..api import Array, SolverError
from ..fem.body import Body
from ..fem.types import Directions, Load, State, Tangents
from .schedule import Segment

SMALLEST = 2.0**-8  # share of a step's load below which approaching it gradually is given up
EXACT = 1e-6  # last Newton correction (in length scales) above which derivatives need a fresh tangent


@dataclass
class Run:
    """One march: the body, its parameters (one array a layer) and what to differentiate by."""

    body: Body
    parameters: Sequence[Array]
    directions: Directions | None = None
    state: State = field(init=False)
    tangents: Tangents | None = field(init=False, default=None)
    newton: int = 0
    steps: int = 0
    cuts: int = 0

    def __post_init__(self) -> None:
        names = self.body.mesh.layer_names
        for name, values in zip(names, self.parameters, strict=True):
            if fault := self.body.law.domain(values):
                raise SolverError(f"{name}: {fault}")
        self._stable_to = [self.body.law.stable_to(values) for values in self.parameters]
        self._always_stable = all(reach == inf for reach in self._stable_to)
        self.state = self.body.rest()
        if self.directions is not None:
            self.tangents = self.body.rest_tangents(len(self.directions.friction))

    def advance(self, piece: Segment, load: Callable[[float], Load], visit: Callable[[float], None]) -> None:
        """Step through a segment: ``load`` gives what acts at a drive value; ``visit`` gets the time of each step."""
        now, previous = piece.start, None
        for time in piece.times:
            start = self.state
            # steps are even in the drive or in the logarithm of time
            guess = start if previous is None else start.beyond(previous)
            self._step(float(now), float(time), piece, load, guess)
            previous, now = start, time
            visit(float(time))

    def _step(self, now: float, time: float, piece: Segment, load: Callable[[float], Load], guess: State) -> None:
        acting, dt = load(piece.drive(time)), time - now
        new, last = self._solved(now, time, piece, load, guess)
        self.steps += 1
        if self.tangents is not None and self.directions is not None:
            step = (acting, dt, self.parameters)
            moves = self.body.shape_partials(self.state, new, *step, self.directions)
            anew = last > EXACT * self.body.scale or bool(moves)
            self.tangents = self.body.differentiate(self.state, new, self.tangents, *step, self.directions, moves, anew)
        self.state = new

    def _solved(
        self, now: float, time: float, piece: Segment, load: Callable[[float], Load], guess: State
    ) -> tuple[State, float]:
        """The state at ``time`` and the last Newton correction [m].

        Where neither the extrapolated state nor the step's own start lies near enough for Newton's method, load and
        time approach the step's end gradually, and each solution is the next one's first guess only: a step is one
        step of the implicit rule however hard it was to solve, so that the forward map has no jumps where a
        parameter makes it harder.
        """
        trials = [(1.0, guess)] if guess is self.state else [(1.0, guess), (1.0, self.state)]
        try:
            new, last = self._approached(trials, now, time, lambda share: load(piece.drive(now + share * (time - now))))
        except SolverError as error:
            acting = load(piece.drive(time))
            if acting.friction == 0.0:
                raise self._explained(error) from None
            new, last = self._rubbed_gradually(now, time, acting)
        self._refuse_instability(time)
        return new, last

    def _approached(
        self, trials: list[tuple[float, State]], now: float, time: float, load: Callable[[float], Load]
    ) -> tuple[State, float]:
        """First ``trials`` (share of the step, guess), then in shares that halve where Newton's method fails."""
        done, share, found = 0.0, 1.0, self.state
        while True:
            target, first = trials.pop(0) if trials else (min(1.0, done + share), found)
            at = now + target * (time - now)
            try:
                new, iterations, last = self.body.step(
                    self.state, first, load(target), at - now, self.parameters, at, self.directions is None
                )
            except SolverError:
                if trials:
                    continue
                share *= 0.5
                self.cuts += 1
                if share < SMALLEST:
                    raise
                continue
            self.newton += iterations
            if target == 1.0:
                return new, last
            done, found = target, new

    def _rubbed_gradually(self, now: float, time: float, load: Load) -> tuple[State, float]:
        """The step's end without friction, then with ever more of it: a strong one has no way through small loads."""
        done, share, found = -1.0, 1.0, self.state
        while True:
            target = min(1.0, done + share)
            acting = replace(load, friction=max(target, 0.0) * load.friction)
            try:
                new, iterations, last = self.body.step(
                    self.state, found, acting, time - now, self.parameters, time, self.directions is None
                )
            except SolverError as error:
                share *= 0.5
                self.cuts += 1
                if done < 0.0 or share < SMALLEST:
                    raise self._explained(error) from None
                continue
            self.newton += iterations
            if target == 1.0:
                return new, last
            done, found = target, new

    def _refuse_instability(self, time: float) -> None:
        """Raise SolverError where a layer is distorted beyond the reach of its stable energy."""
        if self._always_stable:
            return
        layers = zip(self.body.mesh.layer_names, self.body.distortions(), self._stable_to, strict=True)
        for name, distortion, reach in layers:
            if distortion > reach:
                raise SolverError(
                    f"{name}: the energy is unstable, shear stress falls with shear beyond I1 - 3 = {reach:.3g}, and "
                    f"the load distorts it to {distortion:.3g}",
                    time=time,
                )

    def _explained(self, error: SolverError) -> SolverError:
        """The error, with the energy's instability named where there is one that could be behind it."""
        reach = min(self._stable_to)
        if not isfinite(reach):
            return error
        hint = f"; the energy is unstable beyond I1 - 3 = {reach:.3g}"
        return SolverError(error.reason + hint, time=error.time, load=error.load, element=error.element)
