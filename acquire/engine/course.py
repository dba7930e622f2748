"""The command of a run in device time: as it was executed so far, and as it will go on."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from acquire.engine.feeder import Executed
from drivers.signals import FloatArray
from protocols.setpoints import Setpoints

SAME = 1e-9  # s: two moments no further apart are one


@dataclass(frozen=True)
class Course:
    """A snapshot, written anew wherever the plan moved in time (a start, a pause, an ``until``, the end).

    ``ahead`` goes on where ``done`` ends. It is empty while nobody knows when it will: in a pause, and after the end.
    """

    done: tuple[Executed, ...]
    began: float  # device time (s) at which ``ahead`` begins; NaN where it is empty
    ahead: Setpoints
    rest: Mapping[str, float]

    def table(self) -> tuple[FloatArray, dict[str, FloatArray]]:
        """Break points: device times in s, and the value of each quantity there. At rest between pieces and at the end.

        A step shows as two points at the same time.
        """
        points: list[tuple[float, Mapping[str, float]]] = []
        for piece in self.done:
            if points and piece.begin > points[-1][0] + SAME:
                points += [(points[-1][0], self.rest), (piece.begin, self.rest)]
            points += [(piece.begin, piece.start), (piece.end, piece.finish)]
        if math.isfinite(self.began):
            if points and self.began > points[-1][0] + SAME:
                points += [(points[-1][0], self.rest), (self.began, self.rest)]
            moment = self.began
            for segment in self.ahead.segments:
                points += [(moment, segment.start), (moment + segment.duration, segment.end)]
                moment += segment.duration
        elif points:
            points.append((points[-1][0], self.rest))
        time = np.array([moment for moment, _ in points])
        return time, {q: np.array([values[q] for _, values in points]) for q in self.rest}
