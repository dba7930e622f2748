"""The diagnosis as one self-contained page: three sentences first, then the pictures."""

from __future__ import annotations

import base64
import io
from pathlib import Path
from typing import Any

import numpy as np

from gap.diagnose import Diagnosis
from gap.report import as_json

MEASURED, NOMINAL, WITH_EFFECT = "#1d2733", "#d0781c", "#0b6e99"
SCALES = {"Pa": ("mbar", 0.01), "m": ("mm", 1e3), "N": ("N", 1.0), "V": ("V", 1.0)}
MAX_PANELS = 6


def write_page(diagnosis: Diagnosis, path: Path) -> Path:
    """Write the report page (HTML with inlined pictures) to ``path``."""
    path.write_text(page(diagnosis), encoding="utf-8")
    return path


def page(d: Diagnosis) -> str:
    """The report page as text."""
    from jinja2 import Environment, PackageLoader

    environment = Environment(loader=PackageLoader("gap", "templates"), autoescape=True)
    report = as_json(d)
    first = d.recordings[0].info
    title = " · ".join(x for x in (first.instrument, first.subject, first.site) if x)
    pictures = {"where": _where(report), "curves": [_curves(d, name) for name in d.problems]}
    causes = [c for k, c in enumerate(report["causes"]) if k == 0 or c["probability"] > 0.005]
    template = environment.get_template("gap.html")
    return template.render(r=report, title=title, causes=causes, pictures=pictures, bounds=_bounds(d))


def _bounds(d: Diagnosis) -> list[tuple[str, dict[str, Any]]]:
    parameter = {
        s.candidate.key: next((p for p in s.candidate.parameters if p.null is not None), None)
        for s in d.comparison.screened
    }
    out = []
    for key, value in d.bounds.items():
        p = parameter.get(key)
        if p is not None and np.isfinite(value) and value <= max(abs(p.low), abs(p.high)):
            out.append((key, {"value": value, "unit": p.unit, "name": p.name}))
    return sorted(out)


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


def _where(report: dict[str, Any]) -> str:
    """Bars of the gap before and after, by every label that has more than one value."""
    by = {k: v for k, v in report["gap"]["by"].items() if len(v) > 1} or {"channel": report["gap"]["by"]["channel"]}
    figure, axes = _figure(1, len(by), 9.4, 0.7 + 0.32 * max(len(v) for v in by.values()) + 0.5)
    for ax, (label, values) in zip(axes[0], by.items(), strict=True):
        names = list(values)
        at = np.arange(len(names))
        ax.barh(at - 0.18, [values[n]["before"] for n in names], 0.34, color=NOMINAL, label="nominal")
        ax.barh(at + 0.18, [values[n]["after"] for n in names], 0.34, color=WITH_EFFECT, label="with the effect")
        ax.axvline(1.0, color="#5b6b7c", lw=1, ls="--")
        ax.set_yticks(at, names)
        ax.invert_yaxis()
        ax.set_title(f"gap by {label}", fontsize=9.5, loc="left")
    axes[0][0].legend(fontsize=8, loc="lower right")
    return _embedded(figure)


def _panels(d: Diagnosis, name: str) -> list[tuple[int, int]]:
    """(recording, channel code) panels of a block that show most: those with the largest gap before."""
    problem = d.problems[name]
    codes, _ = problem.rows.labels["channel"]
    before = d.comparison.null.fits[name].residual
    keys = sorted({(int(r), int(c)) for r, c in zip(problem.rows.recording, codes, strict=True)})
    size = {k: float(np.sum(before[(problem.rows.recording == k[0]) & (codes == k[1])] ** 2)) for k in keys}
    chosen = sorted(keys, key=lambda k: -size[k])[:MAX_PANELS]
    return sorted(chosen)


def _curves(d: Diagnosis, name: str) -> str:
    problem = d.problems[name]
    codes, channels = problem.rows.labels["channel"]
    panels = _panels(d, name)
    columns = min(3, len(panels))
    rows = -(-len(panels) // columns)
    figure, axes = _figure(2 * rows, columns, 9.4, 3.6 * rows)
    before, after = d.comparison.null.fits[name].residual, d.best.fits[name].residual
    for ax in axes.ravel()[:]:
        ax.set_visible(False)
    for k, (run, code) in enumerate(panels):
        at = (problem.rows.recording == run) & (codes == code)
        top, low = axes[2 * (k // columns)][k % columns], axes[2 * (k // columns) + 1][k % columns]
        recording = d.recordings[min(run, len(d.recordings) - 1)]
        series = recording.streams.get(channels[code])
        unit, scale = SCALES.get(series.unit if series else "", (series.unit if series else "", 1.0))
        time = problem.rows.time[at] - problem.rows.time[at][0]
        measured = problem.measured[at] * scale
        for ax in (top, low):
            ax.set_visible(True)
        top.plot(
            time,
            (problem.measured[at] - before[at] * problem.sigma[at]) * scale,
            color=NOMINAL,
            lw=1.1,
            label="nominal",
        )
        if d.best.effects:
            predicted = (problem.measured[at] - after[at] * problem.sigma[at]) * scale
            top.plot(time, predicted, color=WITH_EFFECT, lw=1.1, label="with the effect")
        top.plot(time, measured, ".", color=MEASURED, ms=1.6, label="measured")
        top.set_title(f"{channels[code]}, {recording.info.id}"[:44], fontsize=8.5, loc="left")
        top.set_ylabel(unit)
        top.tick_params(labelbottom=False)
        low.plot(time, before[at], color=NOMINAL, lw=0.8)
        if d.best.effects:
            low.plot(time, after[at], color=WITH_EFFECT, lw=0.8)
        low.axhspan(-2, 2, color="#5b6b7c", alpha=0.12, lw=0)
        low.set_ylabel("residual / noise")
        low.set_xlabel("time, s")
    axes[0][0].legend(fontsize=7.5)
    return _embedded(figure)
