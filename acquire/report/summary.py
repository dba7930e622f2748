"""A recording in numbers and in words, for `acquire show`, `ls` and the HTML pages."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from acquire.analysis.curves import recording_parameters
from acquire.analysis.loops import by_direction, loops
from acquire.analysis.quality import lost_samples, quality
from acquire.recording.model import Recording, Series
from acquire.recording.review import left_out
from acquire.words import pleasant, share, shown
from protocols.specimens import described

_DELIVERY = {  # code of an event -> how its count is put
    "lost": "samples lost",
    "duplicate": "came twice",
    "late": "came late",
    "conflict": "contradicted themselves",
    "misdated": "bore a wrong time",
    "discarded": "bytes discarded",
}

_EVENTS = 20
"""Events that are shown in words."""


def summarise(recording: Recording) -> dict[str, Any]:
    """Everything worth saying about a recording, in SI, as JSON knows it (NaN as null)."""
    info = recording.info
    begin, end = span(recording)
    summary: dict[str, Any] = {
        "schema": "recording-summary/1",
        "id": info.id,
        "instrument": info.instrument,
        "device": info.device,
        "protocol": info.protocol_name,
        "has_protocol": bool(info.protocol),
        "subject": info.subject,
        "site": info.site,
        "repeat": info.repeat,
        "specimen": info.specimen,
        "specimen_properties": {key: known.plain() for key, known in info.specimen_properties.items()},
        "specimen_described": described(info.specimen, info.specimen_properties),
        "operator": info.operator,
        "start_time": info.start_time,
        "end_time": info.end_time,
        "status": info.status,
        "trip_reason": info.trip_reason,
        "left_out": left_out(recording),
        "decisions": [vars(decision) for decision in recording.decisions],
        "notes": info.notes,
        "consent": info.consent or "not stated",
        "duration": end - begin,
        "channels": {name: _channel(series) for name, series in recording.streams.items()},
        "setpoints": list(recording.setpoints),
        "derived": list(recording.derived),
        "frames": None,
        "events": [vars(event) for event in recording.events],
        "delivery": delivery(recording),
        "quality": [vars(flag) for flag in quality(recording)],
        "parameters": recording_parameters(recording),
        "directions": directions(recording),
        "calibration": {name: dict(facts) for name, facts in info.calibration.items()},
    }
    if recording.frames is not None:
        count, height, width = recording.frames.data.shape
        summary["frames"] = {"count": count, "width": width, "height": height, "scale": recording.frames.scale}
    plain: dict[str, Any] = _jsonable(summary)
    return plain


def delivery(recording: Recording) -> dict[str, int]:
    """Damage by the links to the data, by kind of event: samples lost, late, twice …, bytes discarded."""
    counts = dict.fromkeys(_DELIVERY, 0)
    for event in recording.events:
        if event.code in counts:
            counts[event.code] += event.count
    return counts


def directions(recording: Recording) -> list[dict[str, Any]]:
    """Per direction of a robot recording: peak displacement (m) and force (N) of the last loop, energy lost in it."""
    found = []
    for direction, group in by_direction(loops(recording)).items():
        displacement, force = group[-1].peak
        peaks = [loop.peak[1] for loop in group]
        found.append(
            {
                "direction": list(direction),
                "loops": len(group),
                "displacement": displacement,
                "force": force,
                "spread": float(np.ptp(peaks) / np.mean(peaks)) if np.mean(peaks) else math.nan,
                "energy_loss": group[-1].loss,
            }
        )
    return found


def span(recording: Recording) -> tuple[float, float]:
    """First and last time (s) of anything recorded; (0, 0) if nothing was."""
    times = [series.time for series in recording.streams.values()]
    times += [recording.frames.time] if recording.frames is not None else []
    times = [time for time in times if len(time)]
    if not times:
        return 0.0, 0.0
    return min(float(time[0]) for time in times), max(float(time[-1]) for time in times)


def in_words(summary: Mapping[str, Any]) -> str:
    """`summarise`'s result for a terminal."""
    who = [f"{key} {summary[key]}" for key in ("subject", "site") if summary[key]]
    who += [f"repeat {summary['repeat']}", f"on {summary['specimen_described']}"]
    words = "a protocol without a name" if summary["has_protocol"] else "no protocol"
    lines = [
        f"{summary['id']}: {summary['instrument']}, {summary['protocol'] or words}, {summary['status']}",
        f"  {', '.join(who)}; {summary['duration']:.4g} s"
        + (f", begun {summary['start_time']}" * bool(summary["start_time"])),
    ]
    if summary["trip_reason"]:
        lines.append(f"  {summary['trip_reason']}")
    if summary["left_out"]:
        lines.append(f"  does not count with others: {summary['left_out']}")
    lines += ["channels", *map(_channel_line, summary["channels"].items()), *_frame_lines(summary["frames"])]
    if summary["parameters"]:
        lines += ["parameters", *_parameter_lines(summary["parameters"])]
    if summary["directions"]:
        lines += ["directions", *map(_direction_line, summary["directions"])]
    if told := [f"{count} {_DELIVERY[code]}" for code, count in summary["delivery"].items() if count]:
        lines.append(f"links: {', '.join(told)}")
    lines.append("quality")
    lines += [f"  {flag['level']:<8} {flag['text']}" for flag in summary["quality"]]
    return "\n".join([*lines, *_event_lines(summary["events"])])


def _channel_line(named: tuple[str, Mapping[str, Any]]) -> str:
    name, channel = named
    return f"  {name:<20} {_range(channel)}  {channel['samples']} samples, {_rate(channel['rate'])}"


def _frame_lines(frames: Mapping[str, Any] | None) -> list[str]:
    if not frames:
        return []
    scale = f", {1e3 * frames['scale']:.4g} mm/px" if frames["scale"] else ""
    return [f"  {'frames':<20} {frames['count']} of {frames['width']}x{frames['height']} px{scale}"]


def _event_lines(events: Sequence[Mapping[str, Any]]) -> list[str]:
    """The first events, and how many more there are."""
    if not events:
        return []
    lines = [f"  {_number(e['time']):>8} s {e['level']:<8} {e['text']}" for e in events[:_EVENTS]]
    more = [f"  … and {len(events) - _EVENTS} more"] if len(events) > _EVENTS else []
    return ["events", *lines, *more]


def _parameter_lines(parameters: Mapping[str, float | None]) -> list[str]:
    from acquire.analysis.curves import DEFINITIONS

    cells = [f"{name} {shown(value, DEFINITIONS[name].unit)}" for name, value in parameters.items()]
    return ["  " + "".join(f"{cell:<17}" for cell in cells[k : k + 5]).rstrip() for k in range(0, len(cells), 5)]


def _direction_line(entry: Mapping[str, Any]) -> str:
    direction = ", ".join(f"{x:+.2f}" for x in entry["direction"])
    facts = f"{shown(entry['displacement'], 'm')}, {shown(entry['force'], 'N')}"
    return f"  ({direction})  {facts}, energy lost {share(entry['energy_loss'])}"


def _channel(series: Series) -> dict[str, Any]:
    finite = series.value[np.isfinite(series.value)]
    length = float(series.time[-1] - series.time[0]) if len(series.time) > 1 else 0.0
    return {
        "unit": series.unit,
        "stage": series.stage,
        "samples": len(series.value),
        "rate": (len(series.time) - 1) / length if length > 0 else None,
        "low": float(finite.min()) if len(finite) else None,
        "high": float(finite.max()) if len(finite) else None,
        "lost": lost_samples(series),
    }


def _range(channel: Mapping[str, Any]) -> str:
    factor, unit = pleasant(channel["unit"])
    if channel["low"] is None:
        return f"{'no values':<28}"
    return f"{channel['low'] * factor:>9.4g} … {channel['high'] * factor:<9.4g} {unit:<5}"


def _rate(rate: float | None) -> str:
    return "–" if rate is None else f"{rate:.4g} Hz"


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}"


def _jsonable(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _jsonable(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_jsonable(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return _jsonable(value.tolist())
    return None if isinstance(value, float) and not math.isfinite(value) else value
