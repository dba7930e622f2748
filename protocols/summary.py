"""A compiled protocol in a few figures and as a picture, for people and for ``acquire check``."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from protocols import units
from protocols.limits import PROBE, PROBE_AXES, Limits, Range, limited
from protocols.schema import CHANNELS, Protocol
from protocols.setpoints import Segment, Setpoints

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_PHASES = ("load", "hold", "unload", "rest")
_COLOURS = {"load": "#f8cfa9", "hold": "#fbeede", "unload": "#dbe9f6", "rest": "#f4f4f4"}
_MAX_SHADED = 400  # more phases than this are thinner than a line


def summarise(protocol: Protocol, setpoints: Setpoints, limits: Limits) -> dict[str, Any]:
    """Duration, phases, the range and largest rate of every quantity beside its limits; SI, JSON-ready.

    ``rate`` is None for a quantity that somewhere steps at once; limits that are not set are None too.
    """
    watched = [n for n in CHANNELS[protocol.instrument] if n in limits.ranges and n not in setpoints.quantities]
    phases = {p: sum(s.duration for s in setpoints.segments if s.phase == p) for p in _PHASES}
    return {
        "name": protocol.name,
        "title": protocol.title,
        "instrument": protocol.instrument,
        "setup": protocol.model_dump(mode="json", exclude_none=True)["setup"],
        "duration": setpoints.duration,
        "until": any(s.until for s in setpoints.segments),
        "steps": len(protocol.steps),
        "segments": len(setpoints.segments),
        "phases": phases,
        "quantities": {q: _quantity(q, setpoints, limits) for q in limited(setpoints.quantities)},
        "measured_limits": {name: _measured(limits[name]) for name in watched},
    }


def _measured(limit: Range) -> dict[str, float | None]:
    """The limits of a channel that is measured alone; None where there is none."""
    bounds = {"low": limit.low, "high": limit.high, "rate": limit.rate, "dwell": limit.dwell}
    return {name: bound if math.isfinite(bound) else None for name, bound in bounds.items()}


def in_words(summary: dict[str, Any]) -> str:
    """A summary as lines for a terminal."""
    return "\n".join([headline(summary), *(f"  {name:<11} {text}" for name, text in rows(summary))])


def headline(summary: dict[str, Any]) -> str:
    """Name and title."""
    return f"{summary['name']}: {summary['title']}" if summary["title"] else str(summary["name"])


def rows(summary: dict[str, Any]) -> list[tuple[str, str]]:
    """A summary as rows of a table: a name, and a text for people."""
    longest = " at most, ends earlier on a condition" if summary["until"] else ""
    setup = ", ".join(f"{k.replace('_', ' ')} {v}" for k, v in summary["setup"].items())
    phases = ", ".join(f"{name} {seconds:.6g} s" for name, seconds in summary["phases"].items() if seconds)
    found = [
        ("instrument", summary["instrument"] + (f" ({setup})" if setup else "")),
        ("duration", _clock(summary["duration"]) + longest),
        ("steps", f"{summary['steps']} in the file, {summary['segments']} segments"),
        ("phases", phases),
    ]
    found += [(name, _commanded_row(name, facts)) for name, facts in summary["quantities"].items()]
    found += [(name, _measured_row(name, bounds)) for name, bounds in summary["measured_limits"].items()]
    return found


def _commanded_row(name: str, facts: dict[str, Any]) -> str:
    kind = units.kind_of(name)
    unit = units.KINDS[kind][1][0]
    low, high, most = (_number(facts[k], kind) for k in ("low", "high", "rate"))
    rate = "steps at once" if facts["rate"] is None else f"at most {most} {unit}/s"
    allowed = f"{_ends(facts['limits'], kind)} {unit}"
    if facts["rate_limit"] is not None:
        allowed += f", {_number(facts['rate_limit'], kind)} {unit}/s"
    return f"{low} … {high} {unit}, {rate}; allowed {allowed}"


def _measured_row(name: str, bounds: dict[str, float | None]) -> str:
    kind = units.kind_of(name)
    unit = units.KINDS[kind][1][0]
    ends = (bounds["low"], bounds["high"])
    allowed = [f"{_ends(ends, kind)} {unit}"] if any(end is not None for end in ends) else []
    allowed += [f"{_number(bounds['rate'], kind)} {unit}/s"] if bounds["rate"] is not None else []
    allowed += [f"{bounds['dwell']:g} s away from rest"] if bounds["dwell"] is not None else []
    return f"measured; allowed {', '.join(allowed)}"


def _ends(bounds: Iterable[float | None], kind: str) -> str:
    return " … ".join(_number(bound, kind, absent="unbounded") for bound in bounds)


def draw(protocol: Protocol, setpoints: Setpoints, limits: Limits) -> Figure:
    """A picture of the set-points with phases and limits."""
    from matplotlib.figure import Figure

    robot = len(setpoints.quantities) > 1
    figure = Figure(figsize=(11, 4), dpi=120, layout="constrained")
    axes = figure.subplots(1, 2 if robot else 1, width_ratios=(3, 1) if robot else (1,), squeeze=False)[0]
    _draw_time(axes[0], setpoints, limits)
    if robot:
        _draw_directions(axes[1], setpoints)
    figure.suptitle(f"{protocol.title or protocol.name} — {protocol.instrument}, {_clock(setpoints.duration)}")
    return figure


def _draw_time(axes: Any, setpoints: Setpoints, limits: Limits) -> None:
    seconds, values = setpoints.table()
    scale, unit = (1 / 60, "min") if setpoints.duration > 180 else (1.0, "s")
    kind = units.kind_of(setpoints.quantities[0])
    label = units.KINDS[kind][1][0]
    factor = 1 / units.parse(f"1 {label}", kind)
    if len(setpoints.segments) <= _MAX_SHADED:
        edges = setpoints.edges * scale
        for segment, left, right in zip(setpoints.segments, edges[:-1], edges[1:], strict=True):
            axes.axvspan(left, right, color=_COLOURS[segment.phase], linewidth=0)
    for name, value in values.items():
        axes.plot(seconds * scale, value * factor, linewidth=1.4, label=name)
    reached = np.concatenate(list(values.values()))
    for name in setpoints.quantities:
        for bound in (limits[name].low, limits[name].high):
            # A limit far away would squeeze the curve; it is in the text anyway.
            if np.isfinite(bound) and abs(bound) <= 2 * np.abs(reached).max():
                axes.axhline(bound * factor, color="#c0392b", linestyle="--", linewidth=1)
    axes.set_xlim(0, max(setpoints.duration * scale, 1e-9))
    axes.set_xlabel(f"time ({unit})")
    axes.set_ylabel(f"{'gauge pressure' if kind == 'pressure' else 'tip set-point'} ({label})")
    from matplotlib.patches import Patch

    used = [p for p in _PHASES if any(s.phase == p and s.duration for s in setpoints.segments)]
    handles, _ = axes.get_legend_handles_labels()
    handles += [Patch(color=_COLOURS[p], label=p) for p in used]
    axes.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=7, frameon=False, fontsize=9)


def _draw_directions(axes: Any, setpoints: Setpoints) -> None:
    for segment in setpoints.segments:
        x, y, z = (np.array([segment.start[q], segment.end[q]]) * 1e3 for q in PROBE_AXES)
        axes.plot(x, y, color="#2c5d8a", linewidth=1)
        axes.scatter(x, y, c=z, cmap="viridis", vmin=0, vmax=1.5, s=22, zorder=3)
    axes.set_aspect("equal")
    axes.set_xlabel("x (mm)")
    axes.set_ylabel("y (mm)")
    axes.set_title("seen along the normal, colour: z", fontsize=9)


def _quantity(name: str, setpoints: Setpoints, limits: Limits) -> dict[str, Any]:
    starts = np.array([_value(name, s, s.start) for s in setpoints.segments])
    ends = np.array([_value(name, s, s.end) for s in setpoints.segments])
    moved = np.abs(ends - starts)
    if name == PROBE:
        moved = np.array([np.linalg.norm([s.end[q] - s.start[q] for q in PROBE_AXES]) for s in setpoints.segments])
    duration = np.array([s.duration for s in setpoints.segments])
    steps = bool(np.any((duration == 0) & (moved > 0)))
    going = duration > 0
    allowed = limits[name]
    finite = [v if np.isfinite(v) else None for v in (allowed.low, allowed.high, allowed.rate)]
    return {
        "low": float(min(starts.min(), ends.min())),
        "high": float(max(starts.max(), ends.max())),
        "rate": None if steps else float((moved[going] / duration[going]).max(initial=0.0)),
        "limits": finite[:2],
        "rate_limit": finite[2],
    }


def _value(name: str, segment: Segment, point: Any) -> float:
    return float(np.linalg.norm([point[q] for q in PROBE_AXES])) if name == PROBE else float(point[name])


def _number(value: float | None, kind: str, absent: str = "") -> str:
    if value is None:
        return absent
    return f"{value / units.parse(f'1 {units.KINDS[kind][1][0]}', kind) + 0.0:.4g}"


def _clock(seconds: float) -> str:
    """``525 s`` as ``8 min 45 s``."""
    minutes, rest = divmod(round(seconds, 3), 60)
    hours, minutes = divmod(int(minutes), 60)
    parts = [f"{hours} h"] * (hours > 0) + [f"{minutes} min"] * (minutes > 0) + [f"{rest:.6g} s"] * (rest > 0)
    return " ".join(parts) or "0 s"
