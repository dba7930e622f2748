"""A recording as a bundle: tables that any program reads, and a ``recording.yaml`` that brings them back whole."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from acquire.files import whole_folder
from acquire.recording.bundle import FILE_NAME
from acquire.recording.bundle_schema import SCHEMA
from acquire.recording.model import FloatArray, Frames, Recording, RecordingError, Series
from acquire.recording.segments import write_csv as write_segments
from acquire.recording.tables import write_table

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
    info = recording.info
    about: dict[str, Any] = {"schema": SCHEMA, "instrument": info.instrument}
    if info.protocol:
        (folder / "protocol.yaml").write_text(info.protocol, encoding="utf-8", newline="")
        about["protocol"] = "protocol.yaml"
    about |= {key: getattr(info, key) for key in _OWN_KEYS if key not in ("instrument", "protocol")}
    about["specimen_properties"] = {key: known.plain() for key, known in info.specimen_properties.items()}
    about["channels"] = _tables(folder, "data", recording.streams)
    about["setpoints"] = _tables(folder, "setpoints", recording.setpoints)
    if recording.segments:
        about["segments"] = "segments.csv"
        write_segments(recording.segments, folder / about["segments"])
    about["derived"] = _tables(folder, "derived", recording.derived)
    if recording.frames is not None and len(recording.frames.time):
        about["frames"] = _images(folder, recording.frames)
    about["events"] = [dataclasses.asdict(event) for event in recording.events]
    run = {f.name: getattr(info, f.name) for f in dataclasses.fields(info) if f.name not in _OWN_KEYS}
    run |= {"plot": recording.plot}
    # An empty name says that there is none; left out, import would take the protocol file's.
    about["run"] = _plain({key: value for key, value in run.items() if value or key == "protocol_name"})
    about = {key: value for key, value in about.items() if value not in ({}, [], "")}
    text = yaml.dump(about, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=110)
    (folder / FILE_NAME).write_text(text, encoding="utf-8")


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
        first = next(iter(members.values()))
        file = f"{stem}.csv" if number == 0 else f"{stem}_{number + 1}.csv"
        columns: dict[str, FloatArray] = {"time": np.asarray(first.time, float)}
        for name, series in members.items():
            column = name if name not in columns else f"{name}_value"
            time = {"column": "time", "unit": "s"}
            entry: dict[str, Any] = {"file": file, "column": column, "unit": series.unit or "1", "time": time}
            for axis in ("seq", "time_host"):
                array = getattr(series, axis)
                if array is None or (stem == "data" and axis == "seq" and np.array_equal(array, np.arange(len(array)))):
                    continue  # a channel's rows are counted anyway
                shared = [c for c in columns if c.startswith(axis) and np.array_equal(columns[c], array)]
                chosen = shared[0] if shared else axis if axis not in columns else f"{axis}_{name}"
                columns[chosen] = array
                entry[axis] = chosen
            entry |= {"stage": series.stage} if series.stage else {}
            entry |= {"range": [float(x) for x in series.range]} if series.range else {}
            entry |= {"resolution": float(series.resolution)} if series.resolution else {}
            entry |= {"noise": {"value": float(series.noise), "unit": series.unit or "1"}} if series.noise else {}
            entry |= {"allow_nan": True} if np.isnan(series.value).any() else {}
            if np.ndim(series.value) == 2:
                entry["width"] = int(series.value.shape[1])
                columns |= {f"{column}_{k}": series.value[:, k] for k in range(series.value.shape[1])}
            else:
                columns[column] = series.value
            about[name] = entry
        write_table(folder / file, columns)
    # In the recording's order, which the groups may have changed.
    return {name: about[name] for name in group}


def _images(folder: Path, frames: Frames) -> dict[str, Any]:
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


class _Dumper(yaml.SafeDumper):
    """Writes a text of several lines as a block, and nothing as an alias."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def _text(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style="|" if "\n" in text else None)


_Dumper.add_representer(str, _text)
