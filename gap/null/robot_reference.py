"""Reference specimens under the micro-robot: recorded axis positions -> transducer forces, with a known law between.

In open air there is no force, a spring's is −k·u, a weight's is m·g along its direction. Nothing of a person's is free,
so gains, crosstalk, lag and axes of the transducers are the instrument's.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import null_space

from gap.inference.hypothesis import FROZEN, Active
from gap.inference.least_squares import fit
from gap.null.blocks import Block
from gap.null.groups import Group, GroupedSession, Table
from gap.null.robot_axes import AxesBlock
from gap.null.robot_force import ForceBlock
from gap.null.sheet_law import TISSUE, Law
from protocols.specimens import GRAVITY, SPECIMENS
from sim_devices.chain import Effect, FloatArray

KNOWN = Law((FROZEN,) * len(TISSUE), ((0.0,) * len(TISSUE),))
"""No freedom of a tissue's."""
POST = "rigid post"
AIR, TELLING = "open air", 100
"""The specimen that has no force, and the rows on it that tell the transducers' noise by themselves."""
LOOSE = 0.3
"""Of a stiffness or mass, were it not known."""
HANGING = (60.0, 20.0, 5.0, 1.0)
"""s before its recording at which a specimen acts already: a sensor's lag has passed when a weight is recorded."""


class ReferenceForceBlock(ForceBlock):
    """Recorded axis positions -> transducer forces, on reference specimens.

    Nuisance: the sampling convention and the transducers' gains within their tolerances; each recording's zeros; a
    spring's stiffness, a weight's mass and its direction within their uncertainties.
    """

    name = "reference"
    floor = 0.1e-3  # N: what is fitted to is known better than skin
    LAWS = (KNOWN,)
    DISCREPANCY_SCALES = (1.0,)
    DISCREPANCY_SIZE = 100
    TRUSTS = (0.9,)

    def __init__(self, session: GroupedSession, library: Mapping[str, Effect], axes: AxesBlock) -> None:
        super().__init__(session, library, axes)
        self.sound = self.prior_mean
        # Slow noise of the transducers shows best where there is no force; elsewhere it may be the specimen's.
        nothing = np.repeat([g.name == AIR for g, _ in self.groups], [at.stop - at.start for _, at in self.groups])
        among = nothing if np.count_nonzero(nothing) >= TELLING else None
        self.remember(fit(self), among)

    def left_out(self, session: GroupedSession) -> tuple[str, ...]:
        return (POST, *{g.name for g in session.groups if g.name not in SPECIMENS})

    def _grid_of(
        self, group: Group, at: slice, axes: Mapping[str, Table], sticks: NDArray[np.bool_]
    ) -> tuple[FloatArray, dict[str, FloatArray]]:
        grid, values = super()._grid_of(group, at, axes, sticks)
        before = grid[0] - np.array(HANGING)
        held = {name: np.concatenate([np.full(len(before), v[0]), v]) for name, v in values.items()}
        return np.concatenate([before, grid]), held

    def _gain_sd(self) -> FloatArray:
        out = np.full(len(self.runs), 1e-6)
        for j, k in enumerate(self.runs):
            known = self.session.recordings[k].info.specimen_properties
            for key in ("k", "mass"):
                if key in known:
                    out[j] = max(known[key].se / known[key].scalar, 1e-6)
        return out

    def _discrepancy_columns(self) -> tuple[FloatArray, FloatArray]:
        """The tolerance of a weight's direction: forces across it, constant in each of its recordings, (3 n, q)."""
        size = max(float(np.ptp(self.measured)), 10 * float(np.median(self.sigma)))
        columns = [np.zeros(len(self.measured))]
        for g, at in self.groups:
            if not {"mass", "direction"} <= g.known.keys():
                continue
            weight, direction = g.known["mass"].scalar * GRAVITY, g.known["direction"]
            transducers: Any = self._nominal[g.specimen]["transducers"]
            across = null_space(np.array([direction.value]))
            legs = np.array(transducers.matrix).reshape(3, 3) @ across * weight * direction.se
            for j in range(2):
                column = np.zeros((3, len(self.stamps)))
                column[:, at] = legs[:, j : j + 1]
                columns.append(column.ravel() / (size * self.DISCREPANCY_SD))
        return np.column_stack(columns), np.ones(len(columns))

    @property
    def open_law(self) -> bool:  # type: ignore[override]
        return False

    @property
    def sd_without_discrepancy(self) -> FloatArray:
        return self.prior_sd

    def scattered(self, active: Active) -> FloatArray | None:
        return Block.scattered(self, active)

    def loosened(self) -> Mapping[str, tuple[FloatArray, tuple[int, ...]]]:
        """For each specimen with a number, the prior widths (p,) were that number unknown, and its recordings."""
        out = {}
        gains = self._parts["gain"].start
        for g, _ in self.groups:
            if {"k", "mass"} & g.known.keys():
                widths = self.prior_sd.copy()
                members = tuple(k for k in g.members if k in self.runs)
                widths[[gains + self.runs.index(k) for k in members]] = LOOSE
                out[g.specimen] = widths, members
        return out

    def quantities(self, nuisance: FloatArray) -> Mapping[str, tuple[float, str]]:
        gains = nuisance[self._parts["calibration"]]
        shift = float(nuisance[self._parts["shift"]][0])
        return {
            **{f"transducer_gain_error_{leg}": (float(g), "1") for leg, g in zip("abc", gains, strict=True)},
            "force_shift": (shift, "s"),
        }
