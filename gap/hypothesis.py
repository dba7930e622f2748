"""What the diagnosis compares: hypotheses (which effects act), and problems (data against a forward model).

A problem hides instrument and tissue behind whitened residuals: everything in `gap.solve` and `gap.infer` is the same
for a suction probe, the micro-robot and any other rig.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from sim_devices.chain import Parameter

if TYPE_CHECKING:
    from gap.rhythms import Lateness
    from gap.solve import Fit

FloatArray = NDArray[np.float64]

FROZEN = 1e-9
"""Prior width at which a parameter of the tissue does not move, and its derivative is not asked for."""


@dataclass(frozen=True)
class Candidate:
    """An effect as one possible cause: ``name`` is the concept, ``key`` tells its instances and forms apart.

    ``remedy`` and ``meaning`` are for the report. ``blocks`` names the data blocks the effect can change; others
    keep their nominal prediction.
    """

    key: str
    name: str
    stage: str
    parameters: tuple[Parameter, ...]
    blocks: tuple[str, ...]
    meaning: str = ""
    remedy: str = ""

    def values(self, unit: FloatArray) -> dict[str, float]:
        """Parameter values at ``unit`` (k,) in [0, 1], uniform under the prior."""
        return {p.name: from_unit(p, float(u)) for p, u in zip(self.parameters, unit, strict=True)}


def from_unit(parameter: Parameter, u: float) -> float:
    """The parameter's value at quantile ``u`` of its prior."""
    u = min(max(u, 0.0), 1.0)
    if parameter.scale == "log":
        return float(parameter.low * (parameter.high / parameter.low) ** u)
    return parameter.low + u * (parameter.high - parameter.low)


def to_unit(parameter: Parameter, value: float) -> float:
    """The prior quantile of ``value``, clipped to [0, 1]."""
    if parameter.scale == "log":
        u = np.log(max(value, parameter.low) / parameter.low) / np.log(parameter.high / parameter.low)
    else:
        u = (value - parameter.low) / (parameter.high - parameter.low)
    return float(np.clip(u, 0.0, 1.0))


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
    effects' parameters in prior quantiles (k,)."""

    mean: FloatArray
    sd: FloatArray
    nuisance: FloatArray
    unit: FloatArray


class Problem(Protocol):
    """One block of data with its forward model.

    ``measured`` (n,) and ``sigma`` (n,) are the data behind the rows in SI and their noise, so that the prediction is
    measured − residual·sigma (`gap.solve.predicted`, as chance widens the noise). ``alternatives`` are prior widths
    (p,) over which the evidence is averaged, narrow ones first; ``prior_sd`` is the one used while fitting,
    ``plain_sd`` that of the simulation by itself, without a discrepancy. ``sound`` (p,) is the nuisance of an
    instrument as it should be, where that is all there is to know; None where there is tissue. ``trusts``, one for each
    width, are exponents on the evidence, for model error that tempering does not see: low where a person's tissue may
    do what it likes. The first also weighs the widths against each other.
    """

    name: str
    rows: Rows
    measured: FloatArray
    sigma: FloatArray
    prior_mean: FloatArray
    prior_sd: FloatArray
    alternatives: Sequence[FloatArray]
    sound: FloatArray | None

    @property
    def trusts(self) -> Sequence[float]:
        """How far the evidence is trusted under each of the prior's widths."""
        ...

    @property
    def resets(self) -> Sequence[float]:
        """Times (s) after the beginning of suction at which recordings jump; none of other rigs."""
        ...

    @property
    def plain_sd(self) -> FloatArray:
        """Prior widths (p,) of the simulation by itself."""
        ...

    def evaluate(self, nuisance: FloatArray, active: Active, want_jacobian: bool = True) -> Evaluation:
        """Residual and Jacobian at nuisance parameters (p,) with the effects of ``active`` switched on."""
        ...

    def start(self) -> FloatArray:
        """A sensible nuisance vector (p,) to begin from."""
        ...

    def anchored(self, hypothesis: Sequence[Candidate], unit: FloatArray) -> Start | None:
        """Where else a fit with effects about ``unit`` (k,) should begin. None where the prior is known."""
        ...

    def lateness(self, fitted: Fit) -> Lateness | None:
        """How much later than ``fitted`` each of the command's kinks shows; None where that is not known, or they all
        are in time."""
        ...

    def widening(self, active: Active) -> FloatArray | None:
        """How many times wider (n,) the noise is under effects that happen by chance; None without such effects."""
        ...

    def unlike(self, fitted: Fit) -> float:
        """Nats by which another law of chance than that of the ``fitted`` effects describes what they leave better."""
        ...
