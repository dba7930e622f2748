"""The values that all inference shares: candidate effects, labelled rows, evaluations of a model, starts of a fit."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_devices.chain import FloatArray, Parameter

FROZEN = 1e-9
"""Prior width at which a parameter of the tissue does not move, and its derivative is not asked for."""


@dataclass(frozen=True)
class Candidate:
    """An effect as one possible cause: ``name`` is the concept, ``key`` tells its instances and forms apart.

    ``remedy`` and ``meaning`` are for the report. ``blocks`` names the data blocks the effect can change; others
    keep their nominal prediction. ``form`` is which of its laws an effect follows; an ``event`` happens at one moment,
    which no repeat foretells; one by chance is ``sparse`` if it hits few samples of many. ``extends`` names effects
    that it becomes in a limit of its parameters.
    """

    key: str
    name: str
    stage: str
    parameters: tuple[Parameter, ...]
    blocks: tuple[str, ...]
    meaning: str = ""
    remedy: str = ""
    form: int = 0
    event: bool = False
    sparse: bool = False
    extends: tuple[str, ...] = ()

    def values(self, unit: FloatArray) -> dict[str, float]:
        """Parameter values at ``unit`` (k,) in [0, 1], uniform under the prior."""
        return {p.name: from_unit(p, float(u)) for p, u in zip(self.parameters, unit, strict=True)}


def from_unit(parameter: Parameter, u: float) -> float:
    """The parameter's value at quantile ``u`` of its prior."""
    u = min(max(u, 0.0), 1.0)
    if parameter.scale == "log":
        return float(parameter.low * (parameter.high / parameter.low) ** u)
    return parameter.low + u * (parameter.high - parameter.low)


def slope(parameter: Parameter, u: float) -> float:
    """How the parameter's value changes with the quantile of its prior, at ``u``."""
    if parameter.scale == "log":
        return float(from_unit(parameter, u) * np.log(parameter.high / parameter.low))
    return parameter.high - parameter.low


def to_unit(parameter: Parameter, value: float) -> float:
    """The prior quantile of ``value``, clipped to [0, 1]."""
    if parameter.scale == "log":
        u = np.log(max(value, parameter.low) / parameter.low) / np.log(parameter.high / parameter.low)
    else:
        u = (value - parameter.low) / (parameter.high - parameter.low)
    return float(np.clip(u, 0.0, 1.0))


def touched(effects: Iterable[Candidate]) -> set[str]:
    """The blocks that some of ``effects`` change."""
    return {b for e in effects for b in e.blocks}


Active = Mapping[Candidate, Mapping[str, float]]
"""Effects switched on, with their parameter values; empty for the nominal chain."""


@dataclass(frozen=True)
class Rows:
    """Where each residual belongs: integer codes (n,) into the label lists, and time (n,) s of the session clock."""

    time: FloatArray
    recording: NDArray[np.int64]
    labels: Mapping[str, tuple[NDArray[np.int64], tuple[str, ...]]]  # channel, phase, level, direction, repeat …

    def __len__(self) -> int:
        return len(self.time)


@dataclass(frozen=True)
class Evaluation:
    """Whitened residual (n,) = (measured − predicted)/σ, and its Jacobian (n, p) by the nuisance, d(predicted)/dc/σ."""

    residual: FloatArray
    jacobian: FloatArray


class Start(NamedTuple):
    """Where a fit begins: the prior's mean and width (p,) as the effects would have them, the nuisance (p,), and the
    effects' parameters in prior quantiles (k,); and the Jacobian (n, p) there under that prior, where it is known."""

    mean: FloatArray
    sd: FloatArray
    nuisance: FloatArray
    unit: FloatArray
    jacobian: FloatArray | None = None


@dataclass(frozen=True)
class Lateness:
    """How much later than simulated the command's kinks at ``time`` (m,) s show: ``late`` and its ``sd``, (m,) s.
    ``steps`` are those (m,) at which it jumps: they wait for the next look at it, a ramp is late by the mean wait.
    ``intervals`` s may be those between looks at the command, where a ripple tells them; ``since`` (m,) s is the time
    of the kinks from the beginning of their recordings on, None where nobody asks for it."""

    time: FloatArray
    late: FloatArray
    sd: FloatArray
    steps: NDArray[np.bool_]
    intervals: tuple[float, ...] = ()
    since: FloatArray | None = None
