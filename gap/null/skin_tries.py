"""Fits of a law of skin without an effect: where they begin, and how probable the law is by one."""

from __future__ import annotations

from typing import NamedTuple

from gap.inference.evidence import Fit
from gap.null.skin_laws import SkinLaw
from sim_devices.chain import FloatArray


class Try(NamedTuple):
    """A fit of the simulation by itself: the law, the nuisance (p,) to begin from, iterations, and a fit near there of
    the same law whose Jacobian may do."""

    law: SkinLaw
    begin: FloatArray
    iterations: int
    near: Fit | None = None


Alone = tuple[Fit, SkinLaw]
"""A law and its fit without an effect."""


def probability(alone: Alone) -> float:
    """log evidence of a law fitted alone."""
    return alone[0].log_evidence(1.0, (alone[0].prior_sd,))
