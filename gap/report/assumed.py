"""The assumptions of a diagnosis, in plain words."""

from __future__ import annotations

from gap.data.tolerances import tolerances
from gap.diagnosis import Diagnosis
from gap.report.words import quantity, words


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
        return [*out, "The model's equations hold but for one or two of the generic effects."]
    for effect, parameters in tolerances(d.recordings[0].info.instrument).items():
        for name, tolerance in parameters.items():
            size = quantity(tolerance.value, tolerance.unit)
            out.append(f"{words(effect).capitalize()}: {words(name)} up to {size} is sound ({tolerance.source}).")
    return out
