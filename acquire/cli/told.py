"""Remarks of commands on recordings that they read: warnings among their events, and how large their values are."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from acquire.words import number, pleasant

if TYPE_CHECKING:
    from acquire.recording import Recording


def strange(recordings: Sequence[Recording]) -> list[str]:
    """Warnings and errors among the recordings' events, by their ids."""
    return [
        f"{recording.info.id}: {event.level}: {event.text}"
        for recording in recordings
        for event in recording.events
        if event.level in ("warning", "error")
    ]


def sizes(recording: Recording) -> str:
    """From where to where each channel goes, in units that show a wrong one at a glance."""
    import numpy as np  # reading recordings needs it anyway; a command's help does not

    parts = []
    for name, series in recording.streams.items():
        value = series.value[np.isfinite(series.value)]
        if value.size:
            factor, unit = pleasant(series.unit)
            low, high = (number(factor * float(end)) for end in (value.min(), value.max()))
            parts.append(f"{name} {low} to {high} {unit}".rstrip())
    longest = max((float(np.ptp(s.time)) for s in recording.streams.values() if len(s.time)), default=0.0)
    return f"{recording.info.id}: {longest:.3g} s, {', '.join(parts)}"


def of_bundles(paths: Sequence[Path], recordings: Sequence[Recording]) -> list[str]:
    """An import's remarks on those that are bundles: those on a file were printed when it was imported."""
    found = [recording for path, recording in zip(paths, recordings, strict=True) if _is_bundle(path)]
    return [line for recording in found for line in (sizes(recording), *strange([recording]))]


def _is_bundle(path: Path) -> bool:
    return path.is_dir() or path.suffix.lower() in (".yaml", ".yml")
