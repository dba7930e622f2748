"""The diagnosis as one self-contained page: three sentences first, then the pictures."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from acquire.files import write_text
from gap.data.quantities import quantity
from gap.diagnosis import Diagnosis
from gap.report.document import as_json
from gap.report.figures import misfits, overview, residuals, where
from gap.report.pages import render
from gap.report.words import words


def write_page(diagnosis: Diagnosis, path: Path) -> Path:
    """Write the report page (HTML with inlined pictures) to ``path``. Raises CannotWrite."""
    return write_text(path, page(diagnosis))


HEADINGS = {
    "unknown": "The nearest of the known effects: none of them fits",
    "undetectable": "The nearest candidates, none of which stands out",
    "none": "The nearest candidates, none of which stands out",
}
SPLITS = {
    "fitted": "on the fitted data", "repeat": "on a withheld repeat", "level": "on a withheld level",
    "direction": "on a withheld direction", "waveform": "on another waveform", "recording": "on a withheld recording",
}  # fmt: skip
SHOWN = 0.005
"""Probability from which a cause has a line of its own."""


def page(d: Diagnosis) -> str:
    """The report page as text."""
    report = as_json(d)
    first = d.recordings[0].info
    title = " · ".join(x for x in (first.instrument, first.subject, first.site) if x)
    label = _label(d)
    tested = report["causes"][: len(d.shrinks)]
    causes = [c for k, c in enumerate(tested) if k == 0 or c["probability"] > SHOWN]
    return render(
        "gap.report",
        "gap.html",
        r=report,
        title=title,
        causes=causes,
        rest=sum(c["probability"] for c in report["causes"]) - sum(c["probability"] for c in causes),
        pictures={
            "overview": overview(d, label),
            "residuals": [(name, residuals(d, name, label)) for name in d.problems if misfits(d, name)],
            "where": where(report, label),
        },
        beside=any("with_effect" in p for p in report["model"].values()),
        bounds=_bounds(d),
        label=label,
        rig="rig" in d.problems,
        headings=HEADINGS,
        splits=SPLITS,
    )


def _label(d: Diagnosis) -> str:
    """The label of the second simulation; nothing where no effect is claimed."""
    if not d.best.effects or d.verdict.verdict in ("none", "undetectable"):
        return ""
    return "with the nearest effect" if d.verdict.verdict == "unknown" else "with the effect"


def _bounds(d: Diagnosis) -> list[tuple[str, str, str]]:
    """Concept, parameter and the strength that would have been seen, of the form that hides best."""
    parameter = {
        s.candidate.key: next((p for p in s.candidate.parameters if p.null is not None), None)
        for s in d.comparison.screened
    }
    worst: dict[str, tuple[float, str, str]] = {}
    for key, value in d.bounds.items():
        p = parameter.get(key)
        if p is not None and np.isfinite(value) and value <= max(abs(p.low), abs(p.high)):
            name = key.partition("[")[0].replace("@", " at ")
            worst[name] = max(worst.get(name, (0.0, "", "")), (value, p.unit, p.name))
    return [(words(name), words(p), quantity(value, unit, name=p)) for name, (value, unit, p) in sorted(worst.items())]
