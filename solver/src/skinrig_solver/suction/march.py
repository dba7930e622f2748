"""A suction experiment from preload to the last sample, with parameter derivatives along the way."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..api import Array, SolverError
from ..fem.body import Body
from ..fem.types import Directions, Load, State, Tangents
from .schedule import Segment

MAX_CUTS = 8  # halvings of one step before giving up
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
        self.state = self.body.rest()
        if self.directions is not None:
            self.tangents = self.body.rest_tangents(len(self.directions.friction))

    def advance(self, piece: Segment, load: Callable[[float], Load], visit: Callable[[float], None]) -> None:
        """Step through a segment: ``load`` gives what acts at a drive value; ``visit`` gets the time of each step."""
        now, previous = piece.start, None
        for time in piece.times:
            start = self.state
            self._step(float(now), float(time), piece, load, _extrapolated(previous, start), 0)
            previous, now = start, time
            visit(float(time))

    def _step(
        self, now: float, time: float, piece: Segment, load: Callable[[float], Load], guess: State, depth: int
    ) -> None:
        acting = load(piece.drive(time))
        try:
            new, iterations, last = self.body.step(self.state, guess, acting, time - now, self.parameters, time)
        except SolverError:
            if guess is not self.state:  # first without extrapolation
                self._step(now, time, piece, load, self.state, depth)
                return
            if depth >= MAX_CUTS:
                raise
            self.cuts += 1
            middle = 0.5 * (now + time)
            self._step(now, middle, piece, load, self.state, depth + 1)
            self._step(middle, time, piece, load, self.state, depth + 1)
            return
        self.newton += iterations
        self.steps += 1
        if self.tangents is not None and self.directions is not None:
            step = (acting, time - now, self.parameters)
            moves = self.body.shape_partials(self.state, new, *step, self.directions)
            if last > EXACT * self.body.scale or moves:
                self.body.relinearise(self.state, new, *step)
            self.tangents = self.body.differentiate(self.state, new, self.tangents, *step, self.directions, moves)
        self.state = new


def _extrapolated(before: State | None, now: State) -> State:
    """The state if the last step's change came once more: steps are even in the drive or in the logarithm of time."""
    if before is None:
        return now
    guess = now.copy()
    for name in ("u", "theta", "p", "lam", "shear"):
        values, old = getattr(guess, name), getattr(before, name)
        values += values - old
    guess.height += guess.height - before.height
    np.maximum(guess.lam, 0.0, out=guess.lam)
    return guess
