"""Forms of effects: data that turns one strength into the knobs of a chain.

A concept of the vocabulary has a textbook form (tier T1) and at least one of its own (tiers T2 and up).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from .vocabulary import UNKNOWN

Draw = tuple[float, float] | range | list[float] | float
SIZE = {"cutometer": 1.0, "aspiration": 7.0, "microrobot": 1.0}
"""Heights of the instrument in units of the Cutometer's: lengths among the strengths scale with them."""


@dataclass(frozen=True)
class Form:
    """One form of an effect concept, on one kind of instrument.

    ``knob`` names the chain's knob that takes the strength: ``±name`` with a random sign, ``1/name`` its inverse.
    The strength runs up to ``strong`` (the most that is physically plausible) or takes one of ``steps``. ``draws``
    are the other knobs of the form: an interval, an integer range, a choice, or a constant. ``length`` marks
    strengths that scale with the instrument's heights.
    """

    concept: str
    name: str
    own: bool
    knob: str
    strong: float
    draws: Mapping[str, Draw] = field(default_factory=dict)
    length: bool = False
    steps: tuple[float, ...] = ()
    instruments: tuple[str, ...] = ("cutometer", "aspiration")

    @property
    def outside(self) -> bool:
        """Whether the effect is deliberately not in the public vocabulary (tier T5)."""
        return self.concept.startswith(UNKNOWN)

    def knobs(self, strength: float, instrument: str, seed: int) -> dict[str, float]:
        """Knobs for a strength; the same ``seed`` gives the same sign and draws at every strength."""
        rng = np.random.default_rng(seed)
        sign = 1.0 if rng.random() < 0.5 else -1.0
        value = strength
        if self.knob.startswith("±"):
            value *= sign
        if self.length:
            value *= SIZE[instrument] if not self.knob.startswith("1/") else 1 / SIZE[instrument]
        if self.knob.startswith("1/"):
            value = 1 / value
        return {self.knob.removeprefix("±").removeprefix("1/"): value} | {
            k: _drawn(d, rng) for k, d in self.draws.items()
        }


def _drawn(draw: Draw, rng: np.random.Generator) -> float:
    if isinstance(draw, tuple):
        return float(rng.uniform(*draw))
    if isinstance(draw, (range, list)):
        return float(rng.choice(list(draw)))
    return float(draw)
