"""The reduced tissue under a suction probe, by the parameters that a fit moves (`gap.null.skin_laws.PARTS`)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from gap.inference.hypothesis import FROZEN
from gap.null.skin_laws import bounded_exp
from sim_devices.effects.tissue import power_law_creep
from sim_devices.stages.suction import elastic_height
from sim_devices.stages.tissues import SuctionTissue

LOGARITHM = 1e-4
"""Exponent of an elastic curve that is as good as a logarithm; below nought curves have an end."""
FRACTION = 0.25
"""Exponent of power-law creep from which fits begin."""
TOLD = 4
"""Creep times that are told one by one; a power law stands for many."""


@lru_cache(maxsize=64)
def _reach(suction: float, knee: float, exponent: float) -> float:
    """Elastic height at a ``suction`` (Pa) for a compliance of 1 m/Pa, m."""
    return float(elastic_height(np.zeros(1), np.array([-suction]), 1.0, knee, exponent)[0])


@dataclass(frozen=True)
class Loaded:
    """A ``base`` tissue whose compliance is ``size`` times as large, under suction up to ``strongest`` Pa."""

    base: SuctionTissue
    size: float
    strongest: float

    def tissue(self, c: Mapping[str, float]) -> SuctionTissue:
        """The reduced tissue of parameters ``c``."""
        base = self.base
        knee = base.knee * bounded_exp(c["knee"])
        exponent = min(max(base.exponent + c["exponent"], -3.0), 3.0)
        exponent = exponent if abs(exponent) > LOGARITHM else LOGARITHM
        fraction = min(max(FRACTION * bounded_exp(c["fraction"]), 0.03), 0.9)
        memory = [
            (c[f"creep{i + 1}"], tau * bounded_exp(c[f"time{i + 1}"]))
            for i, tau in enumerate(base.times)
            if abs(c[f"creep{i + 1}"]) > FROZEN
        ]
        memory += power_law_creep(c["power"], fraction) if c["power"] else []
        # The compliance is that at the strongest suction: knee and exponent then bend the curve and do not scale it.
        return replace(
            base,
            compliance=self.reaching(c) / _reach(self.strongest, knee, exponent),
            knee=knee,
            exponent=exponent,
            creep=tuple(g for g, _ in memory),
            times=tuple(tau for _, tau in memory),
            residual=c["residual"],
            softening=base.softening + c["softening"],
        )

    def quantities(self, c: Mapping[str, float]) -> Mapping[str, tuple[float, str]]:
        """The skin's parameters for a report: value and unit, SI."""
        tissue = self.tissue(c)
        creep: dict[str, tuple[float, str]] = {}
        for k, (amount, time) in enumerate(zip(tissue.creep, tissue.times, strict=True), start=1):
            creep |= {f"creep_{k}": (amount, "1"), f"creep_time_{k}": (time, "s")}
        return {
            "elastic_height": (self.reaching(c), "m"),
            "compliance": (tissue.compliance, "m/Pa"),
            "knee": (tissue.knee, "Pa"),
            "elastic_exponent": (tissue.exponent, "1"),
            **(creep if len(tissue.creep) <= TOLD else {"creep": (sum(tissue.creep), "1")}),
            "residual": (tissue.residual, "1"),
        }

    def reaching(self, c: Mapping[str, float]) -> float:
        """Elastic height at the strongest suction, m."""
        base = self.base
        size = base.compliance * self.size * bounded_exp(c["compliance"])
        return size * _reach(self.strongest, base.knee, base.exponent)
