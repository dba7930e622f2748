"""The diagnosis as one self-contained page: three sentences first, then the pictures."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from acquire.files import write_text
from acquire.recording.model import Recording
from gap.data.labels import direction, level
from gap.decision.transfer import waveform
from gap.diagnosis import Diagnosis
from gap.inference.least_squares import predicted
from gap.report.document import as_json, quantity, words

MEASURED, NOMINAL, WITH_EFFECT = "#1d2733", "#d0781c", "#0b6e99"
SCALES = {"Pa": ("mbar", 0.01), "m": ("mm", 1e3), "N": ("N", 1.0), "V": ("V", 1.0)}
MAX_PANELS = 6
ORDER = ("rest", "load", "hold", "unload")


def write_page(diagnosis: Diagnosis, path: Path) -> Path:
    """Write the report page (HTML with inlined pictures) to ``path``. Raises CannotWrite."""
    return write_text(path, page(diagnosis))


def page(d: Diagnosis) -> str:
    """The report page as text."""
    from jinja2 import Environment, PackageLoader

    environment = Environment(loader=PackageLoader("gap.report", "templates"), autoescape=True)
    environment.filters |= {"words": words, "quantity": quantity}
    report = as_json(d)
    first = d.recordings[0].info
    title = " · ".join(x for x in (first.instrument, first.subject, first.site) if x)
    label = _label(d)
    pictures = {"where": _where(report, label), "curves": [(name, _curves(d, name, label)) for name in d.problems]}
    causes = [c for k, c in enumerate(report["causes"]) if k == 0 or c["probability"] > 0.005]
    template = environment.get_template("gap.html")
    return template.render(r=report, title=title, causes=causes, pictures=pictures, bounds=_bounds(d), label=label)


def _label(d: Diagnosis) -> str:
    """What the second simulation is; nothing where no effect is claimed."""
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
    return [(words(name), words(p), quantity(value, unit)) for name, (value, unit, p) in sorted(worst.items())]


def _titles(recordings: Sequence[Recording]) -> list[str]:
    """What was done in each recording, in a few words; its name where that does not tell it from others."""
    out = []
    for r in recordings:
        said = [x for x in (level(r), direction(r), waveform(r)) if x != "-"]
        if r.info.specimen not in ("", "skin"):
            said.append(r.info.specimen)
        out.append(", ".join([*said, f"repeat {r.info.repeat}"]))
    return [title if out.count(title) == 1 else r.info.id for title, r in zip(out, recordings, strict=True)]


def _embedded(figure: Any) -> str:
    import matplotlib.pyplot as plt

    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110)
    plt.close(figure)
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode()


def _figure(rows: int, columns: int, width: float, height: float) -> Any:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    plt.rcParams.update({"font.size": 9, "axes.spines.top": False, "axes.spines.right": False, "axes.grid": True,
                         "grid.alpha": 0.25, "legend.frameon": False})  # fmt: skip
    return plt.subplots(rows, columns, figsize=(width, height), squeeze=False, layout="constrained")


def _where(report: dict[str, Any], label: str) -> str:
    """Bars of the gap before and after, by every label that has more than one value."""
    by = {k: v for k, v in report["gap"]["by"].items() if len(v) > 1} or {"channel": report["gap"]["by"]["channel"]}
    figure, axes = _figure(1, len(by), 9.4, 1.3 + 0.3 * max(len(v) for v in by.values()))
    for ax, (kind, values) in zip(axes[0], by.items(), strict=True):
        names = sorted(values, key=lambda n: ORDER.index(n) if n in ORDER else 0)
        at = np.arange(len(names))
        shift = 0.18 if label else 0.0
        ax.barh(at - shift, [values[n]["before"] for n in names], 0.34, color=NOMINAL, label="nominal")
        if label:
            ax.barh(at + shift, [values[n]["after"] for n in names], 0.34, color=WITH_EFFECT, label=label)
        ax.axvline(1.0, color="#5b6b7c", lw=1, ls="--", label="noise")
        ax.set_yticks(at, [words(n) for n in names])
        ax.invert_yaxis()
        ax.set_title(f"gap by {kind}", fontsize=9.5, loc="left")
    _legend(figure, axes[0][0])
    return _embedded(figure)


def _legend(figure: Any, ax: Any) -> None:
    handles, labels = ax.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=len(labels), fontsize=8.5)


def _panels(d: Diagnosis, name: str) -> list[tuple[int, int]]:
    """(recording, channel code) panels of a block that show most: those with the largest gap before."""
    problem = d.problems[name]
    codes, _ = problem.rows.labels["channel"]
    before = d.null.fits[name].residual
    keys = sorted({(int(r), int(c)) for r, c in zip(problem.rows.recording, codes, strict=True)})
    size = {k: float(np.sum(before[(problem.rows.recording == k[0]) & (codes == k[1])] ** 2)) for k in keys}
    chosen = sorted(keys, key=lambda k: -size[k])[:MAX_PANELS]
    return sorted(chosen)


def _curves(d: Diagnosis, name: str, label: str) -> str:
    """Measured and simulated above, residuals below, for the recordings and channels of a block that differ most."""
    problem = d.problems[name]
    codes, channels = problem.rows.labels["channel"]
    panels, titles = _panels(d, name), _titles(d.recordings)
    columns = 2 if len(panels) in (2, 4) else min(3, len(panels))
    rows = -(-len(panels) // columns)
    figure, axes = _figure(2 * rows, columns, 9.4, 3.6 * rows + 0.3)
    fits = (d.null.fits[name], NOMINAL, "nominal"), (d.best.fits[name], WITH_EFFECT, label)
    curves = [(f.residual, predicted(problem, f), colour, said) for f, colour, said in fits if said]
    for ax in axes.ravel():
        ax.set_visible(False)
    for k, (run, code) in enumerate(panels):
        at = (problem.rows.recording == run) & (codes == code)
        top, low = axes[2 * (k // columns)][k % columns], axes[2 * (k // columns) + 1][k % columns]
        series = d.recordings[run].streams.get(channels[code])
        unit, scale = SCALES.get(series.unit if series else "", (series.unit if series else "", 1.0))
        time = problem.rows.time[at] - problem.rows.time[at][0]
        top.set_visible(True)
        low.set_visible(True)
        for residual, simulated, colour, said in curves:
            top.plot(time, simulated[at] * scale, color=colour, lw=1.1, label=said)
            low.plot(time, residual[at], color=colour, lw=0.8)
        top.plot(time, problem.measured[at] * scale, ".", color=MEASURED, ms=1.6, label="measured")
        top.set_title(f"{words(channels[code])}: {titles[run]}"[:52], fontsize=8.5, loc="left")
        top.set_ylabel(unit)
        top.tick_params(labelbottom=False)
        low.axhspan(-2, 2, color="#5b6b7c", alpha=0.12, lw=0)
        low.set_ylabel("residual / noise")
        low.set_xlabel("time, s")
    _legend(figure, axes[0][0])
    return _embedded(figure)
