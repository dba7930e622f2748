"""A recording for other programs: CSV tables and MATLAB files (`write_bundle` makes the kind that comes back whole)."""

from __future__ import annotations

import re
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from acquire.files import whole_file
from acquire.recording.bundle_export import table_groups
from acquire.recording.model import FloatArray, Recording, RecordingError, Series
from acquire.recording.tables import write_table


def write_csv(recording: Recording, path: Path | str) -> list[Path]:
    """One CSV of all channels that share time stamps, more files (``<name>_2.csv`` …) for the others.

    Columns carry their unit: ``time [s],pressure [Pa]``; ``commanded pressure [Pa]`` is the set-point at the sample's
    time. Values are SI. Returns the files. Raises FileExistsError, CannotWrite.
    """
    path = Path(path)
    groups = table_groups(recording.streams)
    if not groups:
        raise RecordingError(f"run {recording.info.id} has no channels to export")
    files = [path, *(path.with_name(f"{path.stem}_{k + 1}{path.suffix}") for k in range(1, len(groups)))]
    with ExitStack() as stack:  # all of them, or none
        partial = [stack.enter_context(whole_file(file, overwrite=False)) for file in files]
        for members, file in zip(groups, partial, strict=True):
            write_table(Path(file.name), _columns(recording, members))
    return files


def _columns(recording: Recording, members: Mapping[str, Series]) -> dict[str, FloatArray]:
    """The table of ``members``, channels that share their time stamps."""
    time = next(iter(members.values())).time
    columns: dict[str, FloatArray] = {"time [s]": time}
    columns |= {f"{name} [{series.unit}]": series.value for name, series in members.items()}
    for name, series in recording.setpoints.items():
        columns[f"commanded {name} [{series.unit}]"] = _held(time, series.time, series.value)
    return columns


def write_mat(recording: Recording, path: Path | str) -> Path:
    """A MATLAB 5 file: structs ``streams``, ``setpoints``, ``derived`` (value, time, unit each), ``run``, ``frames``.

    Raises FileExistsError, CannotWrite.
    """
    from scipy.io import savemat

    path = Path(path)
    content: dict[str, Any] = {"run": _run(recording)}
    for kind in ("streams", "setpoints", "derived"):
        group = getattr(recording, kind)
        content[kind] = {
            _identifier(name): {"value": series.value, "time": series.time, "unit": series.unit}
            for name, series in group.items()
        }
    if recording.frames is not None:
        frames = recording.frames
        content["frames"] = {"data": np.asarray(frames.data), "time": frames.time, "scale": frames.scale}
    with whole_file(path, overwrite=False) as file:
        savemat(file, content, do_compression=True, oned_as="column", long_field_names=True)
    return path


def _run(recording: Recording) -> dict[str, Any]:
    info = recording.info
    return {f.name: getattr(info, f.name) for f in fields(info) if isinstance(getattr(info, f.name), str | int)}


def _identifier(name: str) -> str:
    """A name that MATLAB takes for a field."""
    plain = re.sub(r"\W", "_", name, flags=re.ASCII)
    return (plain if plain[:1].isalpha() else f"x{plain}")[:63]


def _held(time: FloatArray, points: FloatArray, values: FloatArray) -> FloatArray:
    """Set-points at ``time``: linear between break points, right-continuous at steps."""
    if not len(points):
        return np.full(len(time), np.nan)
    after = np.clip(np.searchsorted(points, time, side="right"), 1, len(points) - 1) if len(points) > 1 else 0
    if len(points) == 1:
        return np.full(len(time), values[0])
    length = points[after] - points[after - 1]
    fraction = np.clip(np.divide(time - points[after - 1], length, out=np.ones(len(time)), where=length > 0), 0, 1)
    return np.asarray(values[after - 1] + fraction * (values[after] - values[after - 1]))
