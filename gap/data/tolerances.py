"""Stated tolerances of instruments: how far off each may be without a finding (``tolerances.yaml``)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files

import yaml


@dataclass(frozen=True)
class Tolerance:
    """``value`` in SI ``unit``, and where it is known from; ``other`` is that of a sound instrument of another make,
    where it is wider; ``nominal`` is what it is a tolerance about, ``like`` the effect that would look the same."""

    value: float
    unit: str
    source: str
    other: float = 0.0
    nominal: float = 0.0
    like: str = ""

    @property
    def widest(self) -> float:
        return max(self.value, self.other)


@cache
def tolerances(instrument: str) -> Mapping[str, Mapping[str, Tolerance]]:
    """For each effect, or part of the instrument, the tolerances of its parameters; none of an instrument that is not
    ours."""
    text = files("gap.data").joinpath("tolerances.yaml").read_text(encoding="utf-8")
    table = yaml.safe_load(text).get(instrument, {})
    return {
        group: {
            name: Tolerance(
                float(v["value"]),
                v["unit"],
                v["source"],
                float(v.get("other", 0.0)),
                float(v.get("nominal", 0.0)),
                v.get("like", ""),
            )
            for name, v in parameters.items()
        }
        for group, parameters in table.items()
    }


def sampled(stated: Mapping[str, Mapping[str, Tolerance]], dt: float) -> dict[str, dict[str, Tolerance]]:
    """Tolerances stated in samples as seconds, for a sampling interval ``dt`` s."""
    return {g: {n: replace(v, value=v.value * dt, unit="s") for n, v in some.items()} for g, some in stated.items()}
