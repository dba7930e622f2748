"""From the micro-robot's raw values to its channels: tared transducer forces, probe position, force on the probe."""

from __future__ import annotations

from collections import deque

import numpy as np

from drivers.device import Refused
from drivers.microrobot import forces, kinematics
from drivers.signals import FloatArray

#: Samples of which the tare is the mean.
TARE_SAMPLES = 200


class Processing:
    """Converts raw blocks (n, 6): axis positions in m, transducer voltages in V; remembers the tare."""

    def __init__(self) -> None:
        self._recent: deque[FloatArray] = deque()
        self._tare = np.zeros(3)

    def __call__(self, raw: FloatArray) -> dict[str, FloatArray]:
        """Every channel's values (n,), SI."""
        axis, untared = raw[:, :3], forces.transducer_forces(raw[:, 3:])
        self._remember(untared)
        force = untared - self._tare
        columns = np.column_stack([axis, force, kinematics.forward(axis), forces.reaction(force)])
        return dict(zip(NAMES, columns.T, strict=True))

    def tare(self) -> None:
        """Take the mean of the latest samples as zero; the probe must be at rest. Without samples the tare stays.

        Raises Refused when a transducer gives no numbers.
        """
        if self._recent:
            try:
                self._tare = forces.tare(np.concatenate(self._recent)[-TARE_SAMPLES:])
            except ValueError as error:
                raise Refused(f"microrobot: {error}") from error

    def _remember(self, untared: FloatArray) -> None:
        self._recent.append(untared[-TARE_SAMPLES:])
        while sum(map(len, self._recent)) - len(self._recent[0]) >= TARE_SAMPLES:
            self._recent.popleft()


NAMES = (
    *(f"axis_position_{k}" for k in (1, 2, 3)),
    *(f"transducer_force_{k}" for k in "abc"),
    *(f"probe_{k}" for k in "xyz"),
    *(f"force_{k}" for k in "xyz"),
)
