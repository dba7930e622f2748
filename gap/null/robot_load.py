"""The load on the robot's axes by the recorded transducer forces."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

import numpy as np

from gap.null.chains import needed, run, undone
from gap.null.groups import Table
from sim_devices.chain import Chain, FloatArray
from sim_devices.stages.robot import TRANSDUCERS, numbered, xyz

SPRING = 200.0
"""N/m by which the load gives way where an axis is not where it was recorded: less than skin does, and enough that an
axis whose coil is at its limit does not run away under the millinewtons that the load is not known better."""
THIN, OFTEN = 2, 4e-3
"""Of the record's samples, each how many-th the load is taken at at least, and s apart at most for that of a fast
record: the loop evens out the rest."""


class RecordedLoad:
    """The load on the axes of one group's recordings, by its recorded forces and axis positions.

    ``sound`` is the group's nominal chain. The lever arms are those where the axes are, or, if ``centred``, those of
    the centre. The recorded tip force is not asked: its matrix may be wrong.
    """

    def __init__(self, sound: Chain, forces: Mapping[str, Table], axes: Mapping[str, Table], centred: bool) -> None:
        self._sound, self._centred, self.known = sound, centred, len(forces) == len(TRANSDUCERS)
        if not self.known:
            return
        time = np.unique(axes["axis_1"][0])
        self.time = time[:: max(THIN, round(OFTEN / float(np.median(np.diff(time)))))]
        self._read = np.stack([np.interp(self.time, *forces[name]) for name in TRANSDUCERS])
        self.axes = {name: np.interp(self.time, *axes[name]) for name in numbered("axis")}

    @cached_property
    def _matrix(self) -> FloatArray:
        """Tip force by transducer forces, (3, 3)."""
        unit = dict(zip(TRANSDUCERS, np.eye(3), strict=True))
        made = run(needed(self._sound, xyz("force"), TRANSDUCERS), np.arange(3.0), unit)
        return np.stack([made[s] for s in xyz("force")])

    @cached_property
    def _arms(self) -> FloatArray:
        """Load on the axes by tip force at each of the times, (3 axes, 3, m)."""
        where = {n: 0.0 * x if self._centred else x for n, x in self.axes.items()}
        operators = needed(self._sound, numbered("axis_load"), (*xyz("reaction"), *where))
        arms = []
        for way in np.eye(3):
            force = {s: np.full(len(self.time), x) for s, x in zip(xyz("reaction"), way, strict=True)}
            made = run(operators, self.time, force | where)
            arms.append(np.stack([made[s] for s in numbered("axis_load")]))
        return np.stack(arms, axis=1)

    def load(self, erring: Chain | None = None) -> dict[str, Table]:
        """Load on each axis, N, less the errors that the transducers of the chain ``erring`` make; nothing where it is
        not known."""
        if not self.known:
            return {}
        operators = () if erring is None else needed(erring, TRANSDUCERS, (*xyz("reaction"), *self.axes))

        def made(force: FloatArray) -> FloatArray:
            reaction = dict(zip(xyz("reaction"), self._matrix @ force, strict=True))
            signals = run(operators, self.time, reaction | self.axes)
            return np.stack([signals[n] for n in TRANSDUCERS])

        force = undone(made, self._read) if operators else self._read
        return dict(zip(numbered("load"), ((self.time, push) for push in self._pushes(force)), strict=True))

    def _pushes(self, force: FloatArray) -> FloatArray:
        """The load (3, m) N of transducer forces (3, m) N on the axes, with what gives way as `SPRING` taken off, (3,
        m)."""
        spring = SPRING * np.stack(list(self.axes.values()))
        return np.asarray(np.einsum("akm,km->am", self._arms, self._matrix @ force) + spring)

    def greatest(self) -> float:
        """The greatest force that a coil has to hold, N; 0 where that is not known."""
        if not self.known:
            return 0.0
        return float(np.max(np.abs(np.einsum("akm,km->am", self._arms, self._matrix @ self._read))))
