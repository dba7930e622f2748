"""The result of a fit, as data, as JSON and in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..api import Array, Experiment, Field, Model, ModelInfo
from . import units
from .posterior import Posterior
from .spec import Spec
from .stated import Setup
from .statistics import Estimate

SCHEMA = "skinrig-fit/1"


@dataclass(frozen=True, eq=False)
class Curve:
    """One compared channel of one recording: arrays (n,) in SI, ``vaf`` in 1, ``noise`` its residual deviation.

    ``zero`` is the fitted reading at no deformation, which ``model`` includes; None where it was taken as recorded."""

    label: str
    instrument: str
    channel: str
    time: Array
    data: Array
    model: Array
    weight: Array
    vaf: float
    noise: float
    persistence: float
    zero: float | None = None

    @property
    def residual(self) -> Array:
        """model - data."""
        return self.model - self.data


@dataclass(frozen=True)
class Effort:
    """Costs of the fit: runs of the forward model, failed ones among them, wall seconds, seconds inside the model."""

    forward_runs: int
    failed_runs: int
    evaluations: int
    seconds: float
    model_seconds: float


@dataclass(frozen=True)
class Start:
    """One starting point of a multi-start fit, and where it ended."""

    start: Mapping[str, float]
    end: Mapping[str, float]
    objective: float
    converged: bool
    reason: str


@dataclass(frozen=True)
class FitResult:
    """The outcome. ``parameters`` holds all of the model's; ``vaf`` is over all curves as the fit weighs them.

    ``trusted`` is False where ``reasons`` say why, in plain words: the model leaves more than noise of the data (then
    not ``describes``) or the data hold no response, where no parameter is called identifiable; or one is on a bound or
    cannot be told, or the optimiser did not converge. ``setups`` says, by the recording's label, which opening and
    force were taken, and why.

    ``correlation`` (m, m) and ``covariance`` (m, m; natural units) are in the order of ``estimates``. ``drives``,
    ``fields`` and ``experiments`` are keyed by the recording's label; ``model`` is the one that was fitted.
    """

    info: ModelInfo
    spec: Spec
    estimates: tuple[Estimate, ...]
    parameters: Mapping[str, float]
    covariance: Array
    correlation: Array
    vaf: float
    objective: float
    curves: tuple[Curve, ...]
    drives: Mapping[str, Mapping[str, Array]]
    fields: Mapping[str, tuple[Field, ...]]
    experiments: Mapping[str, Experiment]
    model: Model
    notes: Mapping[str, str]
    setups: Mapping[str, Setup]
    starts: tuple[Start, ...]
    stages: tuple[str, ...]
    converged: bool
    reason: str
    trusted: bool
    reasons: tuple[str, ...]
    describes: bool
    warnings: tuple[str, ...]
    effort: Effort
    posterior: Posterior | None = None

    def as_dict(self, curves: bool = True) -> dict[str, Any]:
        """Plain data for JSON: SI numbers, None for numbers that are not finite; ``curves`` adds the arrays."""
        plain: dict[str, Any] = _plain(
            {
                "schema": SCHEMA,
                "model": self.info.name,
                "optimiser": self.spec.optimiser,
                "converged": self.converged,
                "reason": self.reason,
                "trusted": self.trusted,
                "not_trusted_because": self.reasons,
                "vaf": self.vaf,
                "objective": self.objective,
                "parameters": [self._estimate(e) for e in self.estimates],
                "held": {s: v for s, v in self.parameters.items() if s not in [e.free.symbol for e in self.estimates]},
                "correlation": self.correlation,
                "covariance": self.covariance,
                "warnings": self.warnings,
                "recordings": [self._recording(label, curves) for label in self.drives],
                "starts": [s.__dict__ for s in self.starts],
                "stages": self.stages,
                "cost": self.effort.__dict__,
            }
            | ({} if self.posterior is None else {"posterior": self.posterior.as_dict()})
        )
        return plain

    def _estimate(self, e: Estimate) -> dict[str, Any]:
        return {
            "symbol": e.free.symbol,
            "unit": e.unit,
            "value": e.value,
            "standard_error": e.standard_error,
            "interval_95": e.interval,
            "identifiable": e.identifiable,
            "at_bound": e.at,
            "start": e.free.start,
            "bounds": (e.free.lower, e.free.upper),
            "meaning": self.info[e.free.symbol].meaning,
            "profile": e.profile,
            "profile_interval_95": e.profile_interval,
        }

    def _recording(self, label: str, curves: bool) -> dict[str, Any]:
        own = [c for c in self.curves if c.label == label]
        channels = {
            c.channel: {
                "vaf": c.vaf,
                "noise": c.noise,
                "samples": c.data.size,
                "persistence": c.persistence,
                "zero": c.zero,
            }
            | ({"data": c.data, "model": c.model, "residual": c.residual} if curves else {})
            for c in own
        }
        found = {
            "id": label,
            "instrument": own[0].instrument,
            "note": self.notes[label],
            "setup": [fact.as_dict() for fact in self.setups[label].facts],
            "geometry": self.experiments[label].geometry,
            "channels": channels,
        }
        return found | ({"time": own[0].time, "drive": self.drives[label]} if curves else {})

    def in_words(self) -> str:
        """A short report for a terminal."""
        cost, size = self.effort, max(len(e.free.symbol) for e in self.estimates)
        end = "converged" if self.converged else f"not converged ({self.reason})"
        lines = [
            f"{self.info.name}: {100 * self.vaf:.2f} % of the variance explained, {end}; "
            f"{cost.forward_runs} forward runs, {cost.seconds:.1f} s"
        ]
        for e in self.estimates:
            error = "?" if not np.isfinite(e.standard_error) else units.show(e.standard_error, e.unit, 2)
            state = f"at its {e.at} bound" if e.at else "" if e.identifiable else "not identifiable"
            lines.append(f"  {e.free.symbol:<{size}}  {units.show(e.value, e.unit):>12} ± {error:<12} {state}".rstrip())
        lines += self._set_ups()
        lines += [f"! {warning}" for warning in self.warnings]
        return "\n".join(lines if self.posterior is None else [*lines, "", self.posterior.in_words()])

    def _set_ups(self) -> list[str]:
        """A line for all recordings of one set-up: its values, and their sources."""
        alike: dict[str, list[str]] = {}
        for label, one in self.setups.items():
            alike.setdefault(one.in_words(), []).append(label)
        return [f"set-up of {', '.join(labels)}: {words}" for words, labels in alike.items() if words]

    def write_page(self, path: Path | str) -> Path:
        """Write one self-contained HTML page. Raises ImportError naming a missing library; OSError."""
        from .page import write_page

        return write_page(self, path)

    def write_fields(self, folder: Path | str, times: Sequence[float] = ()) -> list[Path]:
        """Write the fitted model's fields as VTU and XDMF: see `skinrig_solver.fit.pictures.write_fields`."""
        from .pictures import write_fields

        return write_fields(self, Path(folder), times)


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_plain(v) for v in value]
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value
