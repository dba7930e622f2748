"""Reference specimens in the forward chain: bodies in place of skin, and their laws.

The same operators as the tissue's, so that every effect of the instrument finds its place; the person's own effects (of
the tissue stage) have none on a specimen. Numbers of the simulated specimens that nobody states are assumed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from protocols.specimens import GRAVITY, SPECIMENS, Stated
from sim_devices.chain import Chain, Effect, FloatArray, Signals
from sim_devices.stages.operators import Wired, after
from sim_devices.stages.suction import OPENING, with_tissue
from sim_devices.stages.tissues import SheetTissue, SuctionTissue, for_opening, sheet_tissue, suction_tissue

SPECIMEN = "specimen"
"""Name of an operator that begins anew when the instrument is armed."""
SLID_IN, SLIDE = 2.0, 0.5
"""s after arming at which a gauge step begins to be slid under the probe, and how long that takes (assumed)."""
MEMBRANE = SuctionTissue(6.0e-9, knee=15e3, exponent=0.55, creep=(), times=(), residual=0.0, softening=0.0)
"""Elastic curve of the simulated reference membrane: stiffening like a taut sheet of rubber (assumed)."""
LOSS_TIME = 0.3
"""s: time constant of the little that the simulated membrane loses (assumed)."""
SHEETS = ("open air", "rigid post", "reference spring")
"""Specimens that resist the robot's probe as a sheet of skin does."""
YIELDING = ("reference membrane", "reference spring", "rigid post")
OF_SKIN = ("probe_recoil", "support_slip")
"""Specimens that load the interface, and effects there that are skin's all the same."""
OF_PROBE = {("probe_recoil", 1), ("probe_tilt", 1), ("rim_leak", 3)}
"""Effects and their forms that need no specimen to give way: a probe that moves on its own spring, to a stop, or that
suction tips flat on whatever it stands; and a hose that loses some of the suction on its way there."""
POST = 2e5
"""N/m: stiffness of post, glue and frame together, as the simulated robot meets them (assumed)."""


def mounted(chain: Chain, specimen: str, properties: Mapping[str, Stated]) -> Chain:
    """``chain`` with a reference specimen in the place of its tissue, as a simulated instrument meets it.

    ``properties`` that are missing take their defaults, where they have one. Raises ValueError for an unknown specimen,
    one of another instrument, or a property that must be stated.
    """
    reference = SPECIMENS.get(specimen)
    if reference is None:
        raise ValueError(f"no simulated specimen {specimen!r}; there is skin, {', '.join(SPECIMENS)}")
    if chain.instrument not in reference.instruments:
        raise ValueError(f"a {specimen} is not for a {chain.instrument}")
    known = {p.key: p.otherwise for p in reference.properties} | {k: s.scalar for k, s in properties.items()}
    missing = [key for key, value in known.items() if np.isnan(value)]
    if missing:
        raise ValueError(f"{missing[0]}: must be stated for a simulated {specimen}")
    if specimen == "gauge step":
        return with_step(chain, known["height"], SLID_IN)
    if specimen == "reference membrane":
        # A lag of share g loses at most pi g / 2 of the work of a cycle, about its own frequency.
        membrane = replace(MEMBRANE, creep=(known["memory"] / 2.0,), times=(LOSS_TIME,))
        return with_tissue(chain, for_opening(membrane, OPENING[chain.instrument]))
    if specimen == "dead weight":
        return with_weight(chain, known["mass"], properties["direction"].value)
    if chain.instrument == "microrobot":
        return chain.tuned("tissue", tissue=sheet_of(specimen, known.get("k", 0.0)))
    return with_tissue(chain, suction_tissue("rigid block"))  # the manometer's adapter closes the probe as a block does


def meets(effect: Effect, specimen: str) -> bool:
    """Whether an effect shows on a specimen at all.

    Effects of a person's tissue do not act on a reference; and only what gives way as skin does shows most of what
    happens between probe and skin. A probe that yields on its own spring, or is tipped flat, does so on anything;
    and so does a hose that leaks.
    """
    if (
        specimen not in SPECIMENS
        or effect.stage not in ("tissue", "interface")
        or (effect.name, effect.form) in OF_PROBE
    ):
        return True
    return effect.stage == "interface" and specimen in YIELDING and effect.name not in OF_SKIN


def sheet_of(specimen: str, stiffness: float = 0.0) -> SheetTissue:
    """The resistance to the robot's probe of open air, a rigid post or a reference spring of ``stiffness`` N/m."""
    k = {"open air": 0.0, "rigid post": POST, "reference spring": stiffness}[specimen]
    return replace(sheet_tissue("open air"), stiffness=(k, k, k))


def with_step(chain: Chain, height: float, delay: float) -> Chain:
    """A suction chain on a solid of ``height`` m, slid in ``delay`` s after it is armed, whatever the pressure."""
    chain = with_tissue(chain, suction_tissue("rigid block"))
    return after(chain, "softening", lambda s, t: Slid(SPECIMEN, "tissue", s, t, height, delay))


def with_weight(chain: Chain, mass: float, direction: tuple[float, ...]) -> Chain:
    """The robot's chain with a ``mass`` (kg) that pulls on the probe along ``direction`` (unit vector)."""
    chain = chain.tuned("tissue", tissue=sheet_tissue("open air"))
    force = tuple(mass * GRAVITY * d for d in direction)
    return after(chain, "tissue", lambda s, t: Weight(SPECIMEN, "tissue", s, t, force))


@dataclass(frozen=True)
class Slid(Wired):
    """A solid of ``height`` m more, under the probe from ``delay`` s after the beginning on."""

    height: float
    delay: float

    def fresh(self) -> Any:
        return np.full(1, np.nan)

    def advance(self, state: Any, time: FloatArray, signals: Signals) -> None:
        if np.isnan(state[0]) and len(time):
            state[0] = time[0]
        part = np.clip((time - state[0] - self.delay) / SLIDE, 0.0, 1.0)
        signals[self.target[0]] = signals[self.source[0]] + self.height * part


@dataclass(frozen=True)
class Weight(Wired):
    """A constant ``force`` (N) on the probe more, wherever it is."""

    force: tuple[float, ...]

    def advance(self, state: Any, time: FloatArray, signals: Signals) -> None:
        for source, target, force in zip(self.source, self.target, self.force, strict=True):
            signals[target] = signals[source] + force
