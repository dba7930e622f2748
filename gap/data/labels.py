"""Where a residual belongs: channel, phase, level, direction, repeat and recording of every row."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from acquire.recording.model import Recording, SegmentRecord
from gap.inference.hypothesis import Rows
from sim_devices.chain import FloatArray

TRANSIENT = 0.5
"""s for which a step counts as loading after it."""
LABELS = ("channel", "phase", "level", "direction", "repeat")


def phases(recording: Recording, time: FloatArray) -> list[str]:
    """``load``, ``hold``, ``unload`` or ``rest`` at each ``time`` (n,) s: as the recording's segments say, else by the
    first set-point that moves.

    Load is away from zero; without set-points everything is ``all``.
    """
    if recording.segments:
        return _of_segments(recording.segments, time)
    for series in recording.setpoints.values():
        if len(series.time) < 2 or np.ptp(series.value) == 0:
            continue
        span = float(np.ptp(series.value))
        size = np.abs(np.asarray(series.value, dtype=float))
        now, before = np.interp(time, series.time, size), np.interp(time - TRANSIENT, series.time, size)
        rise = now - before
        out = np.where(now < 0.01 * span, "rest", "hold")
        out = np.where(rise > 0.002 * span, "load", out)
        return list(np.where(rise < -0.002 * span, "unload", out))
    return ["all"] * len(time)


def _of_segments(segments: Sequence[SegmentRecord], time: FloatArray) -> list[str]:
    """The phase of the segment at each ``time`` (n,) s; a rest or hold is still what came before while the transient
    lasts."""
    begins = np.array([s.begin for s in segments])
    at = np.clip(np.searchsorted(begins, time, side="right") - 1, 0, None)
    out = np.array([s.phase for s in segments])[at]
    moves = [s for s in segments if s.phase in ("load", "unload")]
    if moves:
        ends = np.array([s.end for s in moves])
        last = np.searchsorted(ends, time, side="right") - 1
        lasts = (last >= 0) & (time - ends[last] < TRANSIENT) & ~np.isin(out, ("load", "unload"))
        out = np.where(lasts, np.array([s.phase for s in moves])[last], out)
    return [str(phase) for phase in out]


def level(recording: Recording) -> str:
    """The largest commanded magnitude, rounded to three figures, with its unit."""
    for name, series in recording.setpoints.items():
        if name.startswith("pressure") and len(series.value):
            return f"{np.nanmax(np.abs(series.value)) / 100:.3g} mbar"
    return "-"


def direction(recording: Recording) -> str:
    """Direction of the commanded tip motion in degrees in the plane, with the elevation where there is one."""
    probe = [recording.setpoints.get(f"probe_{a}") for a in "xyz"]
    if any(p is None for p in probe):
        return "-"
    excursion = np.column_stack([np.asarray(p.value, dtype=float) for p in probe if p is not None])
    if not len(excursion):
        return "-"
    tip = excursion[int(np.argmax(np.sum(excursion**2, axis=1)))]
    azimuth = np.degrees(np.arctan2(tip[1], tip[0])) % 360
    elevation = np.degrees(np.arctan2(tip[2], np.hypot(tip[0], tip[1])))
    return f"{azimuth:.0f}°/{elevation:.0f}°" if abs(elevation) > 1 else f"{azimuth:.0f}°"


def label_rows(parts: Sequence[tuple[Recording, str, FloatArray]]) -> Rows:
    """Rows of ``(recording, channel, time (n,) s)`` parts, in their order."""
    columns: dict[str, list[str]] = {name: [] for name in LABELS}
    run: list[int] = []
    times: list[FloatArray] = []
    ids: dict[int, int] = {}
    for recording, channel, time in parts:
        n = len(time)
        columns["channel"] += [channel] * n
        columns["phase"] += phases(recording, time)
        columns["level"] += [level(recording)] * n
        columns["direction"] += [direction(recording)] * n
        columns["repeat"] += [str(recording.info.repeat)] * n
        run += [ids.setdefault(id(recording), len(ids))] * n
        times.append(time)
    labels = {}
    for name, values in columns.items():
        names, codes = np.unique(np.asarray(values), return_inverse=True)
        labels[name] = (codes.astype(np.int64), tuple(str(v) for v in names))
    return Rows(np.concatenate(times), np.asarray(run, dtype=np.int64), labels)
