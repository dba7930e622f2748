"""From the micro-robot's raw values to its channels: tared transducer forces, probe position, force on the probe."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drivers.device import Refused
from drivers.microrobot import forces, kinematics
from drivers.signals import FloatArray

#: Samples of which the tare is the mean.
TARE_SAMPLES = 200


class Processing:
    """Converts raw blocks (n, 6): axis positions in m, transducer voltages in V; remembers the tare.

    ``force_matrix`` are the nine numbers, row by row, that turn the transducers' forces into the force on the probe;
    none: those of the paper. Raises ValueError for another count.
    """

    def __init__(self, force_matrix: Sequence[float] | None = None) -> None:
        matrix = forces.matrix().ravel() if force_matrix is None else np.asarray(force_matrix, dtype=float)
        if matrix.shape != (9,) or not np.isfinite(matrix).all():
            raise ValueError(f"force_matrix: nine finite numbers, row by row, are needed, not {force_matrix}")
        self._matrix = matrix.reshape(3, 3)
        self._tare = np.zeros(3)

    def __call__(self, raw: FloatArray) -> dict[str, FloatArray]:
        """Every channel's values (n,), SI."""
        axis, untared = raw[:, :3], forces.transducer_forces(raw[:, 3:])
        force = untared - self._tare
        columns = np.column_stack([axis, force, kinematics.forward(axis), force @ self._matrix.T])
        return dict(zip(NAMES, columns.T, strict=True))

    def tare(self, raw: FloatArray) -> None:
        """Take the mean of raw samples (n, 6) as zero: the probe is at rest, before it touches the skin.

        Raises Refused when a transducer gives no numbers.
        """
        try:
            self._tare = forces.tare(forces.transducer_forces(raw[:, 3:]))
        except ValueError as error:
            raise Refused(f"microrobot: {error}") from error


NAMES = (
    *(f"axis_position_{k}" for k in (1, 2, 3)),
    *(f"transducer_force_{k}" for k in "abc"),
    *(f"probe_{k}" for k in "xyz"),
    *(f"force_{k}" for k in "xyz"),
)
