"""A recording as a bundle: tables that any program reads, and a ``recording.yaml`` that brings them back whole."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acquire.files import whole_folder
from acquire.recording.bundle import FILE_NAME
from acquire.recording.bundle_schema import SCHEMA
from acquire.recording.model import FloatArray, Frames, Recording, RecordingError, RunInfo, SegmentRecord, Series
from acquire.recording.segments import write_csv as write_segments
from acquire.recording.tables import write_table
from protocols.source import written

_OWN_KEYS = (
    "instrument",
    "protocol",
    "subject",
    "site",
    "repeat",
    "specimen",
    "specimen_properties",
    "experiment",
    "operator",
    "notes",
)


def write_bundle(recording: Recording, folder: Path | str) -> Path:
    """Write ``recording`` as a bundle into ``folder``, which is made and must be empty.

    Channels that share their time stamps share a table; values are SI and carry every digit. Frames become PNG files.
    Raises RecordingError if there is something in ``folder``, CannotWrite where the disk refuses.
    """
    folder = Path(folder)
    if folder.is_dir() and any(folder.iterdir()):
        raise RecordingError(f"{folder}: is not empty; a bundle needs a folder of its own")
    with whole_folder(folder) as partial:
        _write(recording, partial)
    return folder


def _write(recording: Recording, folder: Path) -> None:
    about = {
        "schema": SCHEMA,
        "instrument": recording.info.instrument,
        **_description(recording.info, folder),
        "channels": _tables(folder, "data", recording.streams),
        "setpoints": _tables(folder, "setpoints", recording.setpoints),
        "segments": _segments(folder, recording.segments),
        "derived": _tables(folder, "derived", recording.derived),
        "frames": _images(folder, recording.frames),
        "events": [dataclasses.asdict(event) for event in recording.events],
        "run": _run(recording),
    }
    about = {key: value for key, value in about.items() if value not in ({}, [], "")}
    (folder / FILE_NAME).write_text(written(about), encoding="utf-8")


def _description(info: RunInfo, folder: Path) -> dict[str, Any]:
    """The keys of recording.yaml that describe a run; the protocol is a file of its own in ``folder``."""
    said = {key: getattr(info, key) for key in _OWN_KEYS if key != "instrument"}
    said["specimen_properties"] = {key: known.plain() for key, known in info.specimen_properties.items()}
    if info.protocol:
        (folder / "protocol.yaml").write_text(info.protocol, encoding="utf-8", newline="")
        said["protocol"] = "protocol.yaml"
    return said


def _segments(folder: Path, segments: Sequence[SegmentRecord]) -> str:
    """Write the segments, if there are some, and return the name of their file."""
    if not segments:
        return ""
    write_segments(segments, folder / "segments.csv")
    return "segments.csv"


def _run(recording: Recording) -> dict[str, Any]:
    """The entry ``run``: the other facts of the run, under the names of their fields."""
    info = recording.info
    run = {f.name: getattr(info, f.name) for f in dataclasses.fields(info) if f.name not in _OWN_KEYS}
    run["plot"] = recording.plot
    # An empty name says that there is none; left out, import would take the protocol file's.
    return {key: _plain(value) for key, value in run.items() if value or key == "protocol_name"}


def table_groups(group: Mapping[str, Series]) -> list[dict[str, Series]]:
    """Channels gathered by shared time stamps: each group fits into one table with one time column."""
    groups: list[dict[str, Series]] = []
    for name, series in group.items():
        for members in groups:
            first = next(iter(members.values()))
            if first.time is series.time or np.array_equal(first.time, series.time):
                members[name] = series
                break
        else:
            groups.append({name: series})
    return groups


def _tables(folder: Path, stem: str, group: Mapping[str, Series]) -> dict[str, Any]:
    """Write ``group`` as tables and return the entry of each channel in recording.yaml."""
    about: dict[str, Any] = {}
    for number, members in enumerate(table_groups(group)):
        file = f"{stem}.csv" if number == 0 else f"{stem}_{number + 1}.csv"
        columns: dict[str, NDArray[Any]] = {"time": np.asarray(next(iter(members.values())).time, float)}
        for name, series in members.items():
            column = name if name not in columns else f"{name}_value"
            # A channel's rows are counted anyway.
            numbers = _numbers(series, counted=stem == "data")
            about[name] = {
                "file": file,
                "column": column,
                "unit": series.unit or "1",
                "time": {"column": "time", "unit": "s"},
                **{axis: _column_of(array, axis, name, columns) for axis, array in numbers.items()},
                **_properties(series),
            }
            columns |= _values(column, series.value)
        write_table(folder / file, columns)
    # In the recording's order, which the groups may have changed.
    return {name: about[name] for name in group}


def _numbers(series: Series, counted: bool) -> dict[str, NDArray[Any]]:
    """The sequence numbers and host's time stamps of a channel's samples; not numbers that only count the rows of a
    table where those are ``counted``."""
    axes = {"seq": series.seq, "time_host": series.time_host}
    if counted and series.seq is not None and np.array_equal(series.seq, np.arange(len(series.seq))):
        del axes["seq"]
    return {axis: array for axis, array in axes.items() if array is not None}


def _column_of(array: NDArray[Any], axis: str, channel: str, columns: dict[str, NDArray[Any]]) -> str:
    """The column of ``axis`` that holds ``array``; one is added to ``columns`` where none does."""
    for column, held in columns.items():
        if column.startswith(axis) and np.array_equal(held, array):
            return column
    column = axis if axis not in columns else f"{axis}_{channel}"
    columns[column] = array
    return column


def _properties(series: Series) -> dict[str, Any]:
    """A channel's entry besides its file and columns: only that which is known of it."""
    said = {
        "stage": series.stage,
        "range": [float(x) for x in series.range or ()],
        "resolution": float(series.resolution or 0.0),
        "noise": {"value": float(series.noise), "unit": series.unit or "1"} if series.noise else {},
        "allow_nan": bool(np.isnan(series.value).any()),
    }
    width = {"width": int(series.value.shape[1])} if np.ndim(series.value) == 2 else {}
    return {key: value for key, value in said.items() if value} | width


def _values(column: str, value: FloatArray) -> dict[str, NDArray[Any]]:
    """The columns of a channel's values: one, or of several components one each."""
    if np.ndim(value) < 2:
        return {column: value}
    return {f"{column}_{k}": component for k, component in enumerate(value.T)}


def _images(folder: Path, frames: Frames | None) -> dict[str, Any]:
    """Write the frames, if there are some, as pictures with a table of their times, and return their entry."""
    if frames is None or not len(frames.time):
        return {}
    import cv2

    (folder / "frames").mkdir()
    for number, image in enumerate(frames.data):
        encoded, png = cv2.imencode(".png", np.asarray(image))
        if not encoded:
            raise RecordingError(f"{folder}: frame {number} cannot be written as PNG")
        (folder / "frames" / f"{number:06d}.png").write_bytes(png.tobytes())
    seq = np.arange(len(frames.time)) if frames.seq is None else frames.seq
    write_table(folder / "frames.csv", {"time": frames.time, "seq": seq})
    about: dict[str, Any] = {
        "files": "frames/*.png",
        "time_file": "frames.csv",
        "time": {"column": "time", "unit": "s"},
    }
    about["seq"] = "seq"
    return about | ({"scale": f"{frames.scale!r} m/px"} if frames.scale else {})


def _plain(value: Any) -> Any:
    """Only values that YAML writes without tags."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return value
