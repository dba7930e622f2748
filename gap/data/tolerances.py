"""Stated tolerances of instruments: how far off each may be without a finding (``tolerances.yaml``)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

import yaml


@dataclass(frozen=True)
class Tolerance:
    """``value`` in SI ``unit``, and where it is known from."""

    value: float
    unit: str
    source: str


@cache
def tolerances(instrument: str) -> Mapping[str, Mapping[str, Tolerance]]:
    """For each effect the tolerances of its parameters; none of an instrument that is not ours."""
    text = files("gap.data").joinpath("tolerances.yaml").read_text(encoding="utf-8")
    table = yaml.safe_load(text).get(instrument, {})
    return {
        effect: {name: Tolerance(float(v["value"]), v["unit"], v["source"]) for name, v in parameters.items()}
        for effect, parameters in table.items()
    }
