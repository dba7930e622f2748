"""The assumptions of a diagnosis, in plain words."""

from __future__ import annotations

from gap.data.quantities import quantity
from gap.data.tolerances import tolerances
from gap.diagnosis import Diagnosis
from gap.report.words import words


def assumed(d: Diagnosis) -> list[str]:
    """Priors, tolerances and the course of set-points; each with its source where it has one."""
    t = d.thresholds
    none = 1.0 - t.prior_effect - t.prior_pair
    out = [
        f"Before any data: no effect has probability {none:.2f}, one {t.prior_effect:g}, two {t.prior_pair:g}, "
        "each concept as probable as another.",
        "Set-points are straight lines between their rows.",
    ]
    if "rig" in d.problems:
        return [
            *out,
            "The model's equations hold but for one or two of the generic effects.",
            "A delay or lag within a quarter of a sample is no finding: a model's steps and the sampling make as much.",
        ]
    for group, parameters in tolerances(d.recordings[0].info.instrument).items():
        if group == "quantities":  # by which a qualification is passed
            continue
        for name, tolerance in parameters.items():
            size = quantity(tolerance.value, tolerance.unit, name=name)
            source = tolerance.source.removeprefix("assumed: ")
            out.append(f"{_said(group, name)} within {size} of nominal is no fault: {source}.")
    return out


def _said(group: str, name: str) -> str:
    """A parameter in words; ``group`` is the effect that it belongs to, or ``channels``."""
    if group == "channels":
        return f"Zero, gain and linearity of the channel {words(name)}"
    return f"{words(group).capitalize()} ({words(name)})"
