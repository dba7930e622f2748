"""The pictures of the report page, as data URLs."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from typing import Any

import numpy as np

from acquire.recording.model import Recording
from gap.data.labels import direction, level
from gap.data.waveform import waveform
from gap.diagnosis import Diagnosis
from gap.inference.evidence import Fit
from gap.inference.least_squares import predicted
from gap.report.words import words

MEASURED, NOMINAL, WITH_EFFECT, NOISE = "#1d2733", "#d0781c", "#0b6e99", "#5b6b7c"
SCALES = {"Pa": ("mbar", 0.01), "m": ("mm", 1e3), "N": ("N", 1.0), "V": ("V", 1.0)}
MAX_PANELS = 6
ORDER = ("rest", "load", "hold", "unload")
WIDTH = 9.4
"""inches"""
STYLE: Any = {
    "font.size": 9, "axes.spines.top": False, "axes.spines.right": False, "axes.grid": True, "grid.alpha": 0.25,
    "legend.frameon": False,
}  # fmt: skip
Panel = tuple[str, int, int]
"""Block, recording and channel code."""


def overview(d: Diagnosis, label: str) -> str:
    """The panel that tells most: measured, nominal and with the effect."""
    block, run, code = most_telling(d, label)
    figure, axes = _figure(1, 1, WIDTH, 4.4)
    ax = axes[0][0]
    time, scale, unit = _scale(d, block, run, code)
    problem, at = d.problems[block], _rows(d, block, run, code)
    ax.plot(time, problem.measured[at] * scale, ".", color=MEASURED, ms=3.0, label="measured", zorder=3)
    for fitted, colour, said in _fits(d, block, label):
        ax.plot(time, predicted(problem, fitted)[at] * scale, color=colour, lw=1.6, label=said)
    _, channels = problem.rows.labels["channel"]
    ax.set_title(f"{words(channels[code])}: {_titles(d.recordings)[run]}", fontsize=10.5, loc="left")
    ax.set_ylabel(f"{words(channels[code])}, {unit}" if unit else words(channels[code]))
    ax.set_xlabel("time, s")
    _legend(figure, ax)
    return _embedded(figure)


def most_telling(d: Diagnosis, label: str) -> Panel:
    """The block, recording and channel that differ most or, where an effect is named, of which it takes most away."""
    panels = [p for name in d.problems for p in _panels(d, name)]
    return max(panels, key=lambda p: _taken_away(d, p) if label else _excess(d, p))


def residuals(d: Diagnosis, block: str, label: str) -> str:
    """Residuals of the recordings and channels of a block that differ most."""
    problem = d.problems[block]
    _, channels = problem.rows.labels["channel"]
    panels, titles = sorted(_panels(d, block)), _titles(d.recordings)
    columns = 2 if len(panels) in (2, 4) else min(3, len(panels))
    rows = -(-len(panels) // columns)
    figure, axes = _figure(rows, columns, WIDTH, 2.1 * rows + 0.4)
    for ax in axes.ravel()[len(panels) :]:
        ax.set_visible(False)
    for ax, (_, run, code) in zip(axes.ravel(), panels, strict=False):
        at = _rows(d, block, run, code)
        time, _, _ = _scale(d, block, run, code)
        ax.axhspan(-2, 2, color=NOISE, alpha=0.12, lw=0)
        for fitted, colour, said in _fits(d, block, label):
            ax.plot(time, fitted.residual[at], color=colour, lw=0.8, label=said)
        ax.set_title(f"{words(channels[code])}: {titles[run]}"[:50], fontsize=8.5, loc="left")
    for row in axes:
        row[0].set_ylabel("residual / noise")
    for ax in axes[-1]:
        ax.set_xlabel("time, s")
    _legend(figure, axes[0][0])
    return _embedded(figure)


def misfits(d: Diagnosis, block: str) -> bool:
    """Whether any sample of a block stands above the noise: computed channels that are right have nothing to show."""
    return any(float(np.max(np.abs(f.residual), initial=0.0)) > 1.0 for f, _, _ in _fits(d, block, "any"))


def _fits(d: Diagnosis, block: str, label: str) -> list[tuple[Fit, str, str]]:
    """Fits to draw: the simulation by itself, and with the effect where one is named."""
    both = [(d.null.fits[block], NOMINAL, "nominal"), (d.best.fits[block], WITH_EFFECT, label)]
    return [f for f in both if f[2]]


def _rows(d: Diagnosis, block: str, run: int, code: int) -> np.ndarray:
    rows = d.problems[block].rows
    return np.asarray((rows.recording == run) & (rows.labels["channel"][0] == code))


def _scale(d: Diagnosis, block: str, run: int, code: int) -> tuple[np.ndarray, float, str]:
    """Time from the recording's first sample (s), the factor from SI to the unit that is shown, and that unit."""
    problem = d.problems[block]
    series = d.recordings[run].streams.get(problem.rows.labels["channel"][1][code])
    unit, scale = SCALES.get(series.unit if series else "", (series.unit if series else "", 1.0))
    begin = float(np.min(problem.rows.time[problem.rows.recording == run]))
    return problem.rows.time[_rows(d, block, run, code)] - begin, scale, unit


def _excess(d: Diagnosis, panel: Panel) -> float:
    """How far a panel's residual stands above the noise, rms."""
    return float(np.sqrt(np.mean(np.square(d.null.fits[panel[0]].residual[_rows(d, *panel)]))))


def _taken_away(d: Diagnosis, panel: Panel) -> float:
    """By how much a panel's χ² falls by the first cause."""
    at = _rows(d, *panel)
    null, best = (f.fits[panel[0]].residual[at] for f in (d.null, d.best))
    return float(null @ null - best @ best)


def _panels(d: Diagnosis, block: str) -> list[Panel]:
    """Recordings and channels of a block that differ most, the most first."""
    rows = d.problems[block].rows
    keys = {(block, int(r), int(c)) for r, c in zip(rows.recording, rows.labels["channel"][0], strict=True)}
    return sorted(sorted(keys), key=lambda k: -_excess(d, k))[:MAX_PANELS]


def _titles(recordings: Sequence[Recording]) -> list[str]:
    """The protocol of each recording, in a few words; its name where that does not tell it from others."""
    out = []
    for r in recordings:
        said = [x for x in (level(r), direction(r), waveform(r)) if x != "-"]
        if r.info.specimen not in ("", "skin"):
            said.append(r.info.specimen)
        out.append(", ".join([*said, f"repeat {r.info.repeat}"]))
    return [title if out.count(title) == 1 else r.info.id for title, r in zip(out, recordings, strict=True)]


def _embedded(figure: Any) -> str:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110)
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode()


def _figure(rows: int, columns: int, width: float, height: float) -> Any:
    from matplotlib import rcParams  # without pyplot, which takes most of a second to import and keeps figures
    from matplotlib.figure import Figure

    rcParams.update(STYLE)
    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False)


def where(report: dict[str, Any], label: str) -> str:
    """Bars of the gap before and after, by every label that has more than one value."""
    by = {k: v for k, v in report["gap"]["by"].items() if len(v) > 1} or {"channel": report["gap"]["by"]["channel"]}
    figure, axes = _figure(1, len(by), WIDTH, 1.3 + 0.3 * max(len(v) for v in by.values()))
    for ax, (kind, values) in zip(axes[0], by.items(), strict=True):
        names = sorted(values, key=lambda n: ORDER.index(n) if n in ORDER else 0)
        at = np.arange(len(names))
        shift = 0.18 if label else 0.0
        ax.barh(at - shift, [values[n]["before"] for n in names], 0.34, color=NOMINAL, label="nominal")
        if label:
            ax.barh(at + shift, [values[n]["after"] for n in names], 0.34, color=WITH_EFFECT, label=label)
        ax.axvline(1.0, color=NOISE, lw=1, ls="--", label="noise")
        ax.set_yticks(at, [words(n) for n in names])
        ax.invert_yaxis()
        ax.set_title(f"gap by {kind}", fontsize=9.5, loc="left")
    _legend(figure, axes[0][0])
    return _embedded(figure)


def _legend(figure: Any, ax: Any) -> None:
    handles, labels = ax.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=len(labels), fontsize=8.5)
