"""Reference specimens under the micro-robot: recorded axis positions -> transducer forces, with a known law between.

In open air there is no force, a spring's is −k·u, a weight's is m·g along its direction. Nothing of a person's is free,
so gains, crosstalk, lag and axes of the transducers are the instrument's.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gap.inference.hypothesis import FROZEN
from gap.null.blocks import GroupedSession
from gap.null.robot_force import ForceBlock
from gap.null.sheet_law import TISSUE, Law
from protocols.specimens import GRAVITY, SPECIMENS
from sim_devices.chain import FloatArray

KNOWN = Law((FROZEN,) * len(TISSUE), ((0.0,) * len(TISSUE),))
"""No freedom of a tissue's."""
LEVER = 2.3
"""Greatest force of a transducer over the force across the probe that makes it: 2h/(√3 w) but for a hair."""
POST = "rigid post"
LOOSE = 0.3
"""Of a stiffness or mass, were it not known."""


class ReferenceForceBlock(ForceBlock):
    """Recorded axis positions -> transducer forces, on reference specimens.

    Nuisance: the sampling convention and the transducers' gains within their tolerances; each recording's zeros; a
    spring's stiffness, a weight's mass and its direction within their uncertainties.
    """

    name = "reference"
    LAWS = (KNOWN,)
    DISCREPANCY_SCALES = (1.0,)
    DISCREPANCY_SIZE = 1
    TRUSTS = (0.9,)

    def left_out(self, session: GroupedSession) -> tuple[str, ...]:
        return (POST, *{g.name for g in session.groups if g.name not in SPECIMENS})

    def _gain_sd(self) -> FloatArray:
        out = np.full(len(self.runs), 1e-6)
        for j, k in enumerate(self.runs):
            known = self.session.recordings[k].info.specimen_properties
            for key in ("k", "mass"):
                if key in known:
                    out[j] = max(known[key].se / known[key].scalar, 1e-6)
        return out

    def _zero_sd(self) -> FloatArray:
        """That of the zeros, and what a weight's direction may be off: a force across it that does not change."""
        out = np.full(len(self.runs), self.ZERO_SD)
        for j, k in enumerate(self.runs):
            known = self.session.recordings[k].info.specimen_properties
            if {"mass", "direction"} <= known.keys():
                across = known["mass"].scalar * GRAVITY * known["direction"].se
                out[j] = np.hypot(out[j], LEVER * across)
        return out

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
