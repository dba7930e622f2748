"""The recording file: NeXus-flavoured HDF5, written whole or not at all, read with suspicion.

Layout (schema ``acquire-recording/1``); every dataset has ``units``, every string is of fixed width::

    /entry                              NXentry; schema, start_time, end_time, status, trip_reason, default plot
    /entry/run                          who, what and where; the protocol's text and its sha256; package versions
    /entry/run/specimen_properties/<key>  known properties of a reference specimen; attributes units, se
    /entry/instrument                   name (of the kind), device (by the station's name), station file,
                                        limits, calibration with provenance
    /entry/streams/<channel>/{value,time,time_host,seq}    group attributes units, stage, range, resolution, noise
    /entry/frames/{data,time,seq,crc}   one chunk per frame; where only a region of most was kept: attributes
                                        region (left, top, width, height), kept; dataset whole
    /entry/derived/<name>/{value,time}  results of an analysis
    /entry/setpoints/{time,<quantity>}  set-points (a quantity with times of its own: <quantity>_time)
    /entry/setpoints/segments           compound: begin, end, phase, step, start_, finish_<quantity>, label_<name>
    /entry/events                       compound: time, level, code, text
    /entry/plot                         NXdata on the default stream

Channels that share their time stamps share one dataset on disk (hard links).
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import astuple
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from acquire.files import PRIVATE, named, whole_file
from acquire.recording import checksum
from acquire.recording.draft import Draft
from acquire.recording.hdf5_reader import (
    ADDED_FIELDS,
    ENTRY_FIELDS,
    EVENT_COLUMNS,
    RUN_FIELDS,
    SCHEMA,
    TEXTS,
    open_recording,
    read_open,
)
from acquire.recording.hdf5_sink import Sink
from acquire.recording.lazy import LEVEL, LazyFrames, pack
from acquire.recording.model import Event, Frames, Recording, RecordingError, RunInfo, SegmentRecord, Series, difference
from acquire.recording.segments import LABEL, to_columns
from drivers.signals import Channel


def write_recording(recording: Recording, path: Path | str, *, overwrite: bool = False) -> Path:
    """Write ``recording`` to ``path``: to a file of another name, read back and compared, fsynced, and renamed.

    Only the owner of the file may read it, because it names a subject. Raises RecordingError if ``path`` exists (unless
    ``overwrite``; it is then replaced only by a verified file), if the recording is inconsistent, or if what was
    written does not read back equal; CannotWrite if the disk refuses.
    """
    path = Path(path)
    _check_consistent(recording)
    try:
        with whole_file(path, mode=PRIVATE, overwrite=overwrite) as partial:
            sink = Sink(partial)
            with h5py.File(sink, "w", track_order=True) as file:
                _write(file, recording, sink.check)
            sink.check()
            _verify(recording, Path(partial.name))
    except FileExistsError as error:
        raise RecordingError(str(error)) from None
    return path


def complete(draft: Draft, recording: Recording, path: Path) -> Path:
    """Write to ``draft``, which has the frames of ``recording``, everything else; verify it and name it ``path``.

    Raises as `write_recording`; the draft is of no use then.
    """
    _check_consistent(recording)
    try:
        _write(draft.file, recording, draft.sink.check, draft)
        draft.file.close()
        draft.sink.check()
        with named(draft.raw, path) as partial:
            _verify(recording, partial)
    finally:
        draft.close()
    return path


def rehearse(info: RunInfo, channels: Iterable[Channel]) -> None:
    """Write a recording without samples in memory and read it back: ``info`` can be recorded, whatever is in it.

    Asked before a run, because after it nothing can be refused any more. Raises RecordingError.
    """
    nothing = np.empty(0)
    streams = {c.name: Series(nothing, nothing, c.unit, nothing, nothing.astype(np.int64), c.stage) for c in channels}
    recording = Recording(info, streams)
    try:
        _check_consistent(recording)
        with h5py.File(f"rehearsal-{id(recording)}", "w", driver="core", backing_store=False, track_order=True) as file:
            _write(file, recording)
            problem = difference(recording, read_open(file, Path(info.id)))
    except (ValueError, TypeError, OverflowError, OSError, RuntimeError, KeyError) as error:
        raise RecordingError(f"run {info.id!r} could not be recorded: {error}") from error
    if problem:
        raise RecordingError(f"run {info.id!r} could not be recorded: {problem}")


def _check_consistent(recording: Recording) -> None:
    run = recording.info.id
    for kind, group in (
        ("stream", recording.streams),
        ("derived", recording.derived),
        ("set-point", recording.setpoints),
    ):
        for name, series in group.items():
            if not name or "/" in name or name in (".", ".."):
                raise RecordingError(f"run {run}: {name!r} cannot be the name of a {kind}")
            shape = np.shape(series.value)
            for axis in ("time", "time_host", "seq"):
                array = getattr(series, axis)
                if array is not None and np.shape(array) != shape[:1]:
                    raise RecordingError(f"run {run}: {kind} {name} has {shape} values but {axis} of {np.shape(array)}")
    for name, series in recording.streams.items():
        if len(back := np.flatnonzero(np.diff(series.time) < 0)):
            raise RecordingError(f"run {run}: stream {name}: time goes back after {series.time[back[0]]:g} s")
    if recording.frames is not None and len(recording.frames.data) != len(recording.frames.time):
        raise RecordingError(
            f"run {run}: {len(recording.frames.data)} frames but {len(recording.frames.time)} frame times"
        )


def _write(
    file: h5py.File, recording: Recording, check: Callable[[], None] = lambda: None, draft: Draft | None = None
) -> None:
    """Write everything but the frames that a ``draft`` has already; ``check()`` raises when the disk failed."""
    info, plot = recording.info, recording.default_plot
    file.attrs.create("NX_class", **_text("NXroot"))
    file.attrs.create("default", **_text("entry"))
    entry = _group(file, "entry", "NXentry")
    # As attributes for a quick look, as fields because that is where NeXus readers expect them.
    for name, text in {"schema": SCHEMA, **{f: getattr(info, f) for f in ENTRY_FIELDS}}.items():
        entry.attrs.create(name, **_text(text[:1000]))  # HDF5 takes no more than 64 KB
        _put(entry, name, text)
    _write_run(_group(entry, "run", "NXcollection"), info)
    _write_instrument(_group(entry, "instrument", "NXinstrument"), recording)
    shared: dict[tuple[int, str], h5py.Dataset] = {}
    streams = _group(entry, "streams", "NXcollection")
    for name, series in recording.streams.items():
        _write_series(streams, name, series, shared)
        check()
    if recording.derived:
        derived = _group(entry, "derived", "NXcollection")
        for name, series in recording.derived.items():
            _write_series(derived, name, series, shared)
    if recording.frames is not None:
        _write_frames(_group(entry, "frames", "NXdata"), recording.frames, check, draft)
    _write_setpoints(_group(entry, "setpoints", "NXcollection"), recording.setpoints, recording.segments)
    _write_events(entry, recording.events)
    if plot:
        entry.attrs.create("default", **_text("plot"))
        _write_plot(_group(entry, "plot", "NXdata"), streams, recording, plot)
    entry.attrs[checksum.OF_ALL] = np.uint32(checksum.of_structure(entry))


def _write_run(group: h5py.Group, info: RunInfo) -> None:
    for name in RUN_FIELDS:
        _put(group, name, getattr(info, name))
    _put(group, "protocol_sha256", hashlib.sha256(info.protocol.encode()).hexdigest())
    group["protocol"].attrs.create("sha256", **_text(hashlib.sha256(info.protocol.encode()).hexdigest()))
    for name in ADDED_FIELDS:
        _put(group, name, getattr(info, name))
    properties = _group(group, "specimen_properties", "NXcollection")
    for name, known in info.specimen_properties.items():
        dataset = _put(properties, name, np.asarray(known.value), known.unit)
        dataset.attrs["se"] = float(known.se)
    _put(group, "repeat", np.int64(info.repeat), "1")
    versions = _group(group, "versions", "NXcollection")
    for name, version in info.versions.items():
        _put(versions, name, version)


def _write_instrument(group: h5py.Group, recording: Recording) -> None:
    info = recording.info
    _put(group, "name", info.instrument)
    _put(group, "station", info.station)
    _put(group, "device", info.device)
    limits = _group(group, "limits", "NXcollection")
    for name, limit in info.limits.items():
        known = recording.streams.get(name) or recording.setpoints.get(name)
        _put(limits, name, np.asarray(limit, float), known.unit if known else "")
    calibration = _group(group, "calibration", "NXcollection")
    for name, facts in info.calibration.items():
        value = facts.get("value", "")
        dataset = _put(
            calibration, name, value if isinstance(value, str) else np.asarray(value), str(facts.get("unit", ""))
        )
        for fact, content in facts.items():
            if fact not in ("value", "unit"):
                dataset.attrs.create(fact, **(_text(content) if isinstance(content, str) else {"data": content}))


def _write_series(parent: h5py.Group, name: str, series: Series, shared: dict[tuple[int, str], h5py.Dataset]) -> None:
    group = _group(parent, name, "NXdata")
    group.attrs.create("signal", **_text("value"))
    group.attrs.create("axes", **_text("time"))
    group.attrs.create("units", **_text(series.unit))
    group.attrs.create("stage", **_text(series.stage))
    if series.range is not None:
        group.attrs["range"] = np.asarray(series.range, float)
    group.attrs["resolution"] = float(series.resolution)
    if series.noise:
        group.attrs["noise"] = float(series.noise)
    _put(group, "value", np.asarray(series.value, float), series.unit)
    for axis, array, unit in (
        ("time", series.time, "s"),
        ("time_host", series.time_host, "s"),
        ("seq", series.seq, "1"),
    ):
        if array is None:
            continue
        key = (id(array), unit)
        if key in shared:
            group[axis] = shared[key]
        else:
            shared[key] = _put(group, axis, np.asarray(array, np.int64 if axis == "seq" else float), unit)


def _write_frames(group: h5py.Group, frames: Frames, check: Callable[[], None], draft: Draft | None) -> None:
    count, height, width = np.shape(frames.data)
    group.attrs.create("signal", **_text("data"))
    group.attrs.create("axes", _texts(("time", ".", ".")))
    group.attrs["scale"] = float(frames.scale)
    group.attrs.create("scale_units", **_text("m/px"))
    if draft is not None:
        data, crc = draft.frames(group), np.array(draft.crc, np.uint32)
    else:
        how: dict[str, Any] = (
            {"chunks": (1, height, width), "compression": "gzip", "compression_opts": LEVEL} if count else {}
        )
        data, crc = group.create_dataset("data", (count, height, width), np.uint8, **how), np.empty(count, np.uint32)
    data.attrs.create("units", **_text("1"))
    for index in range(count if draft is None else 0):
        frame = frames.data.stored(index) if isinstance(frames.data, LazyFrames) else pack(frames.data[index])
        crc[index] = frame.crc
        # A mask says which filters were skipped: the only one, where a frame is stored as it is.
        data.id.write_direct_chunk((index, 0, 0), frame.content, filter_mask=0 if frame.packed else 1)
        check()
    _put(group, "time", np.asarray(frames.time, float), "s")
    _put(group, "seq", np.arange(count) if frames.seq is None else np.asarray(frames.seq, np.int64), "1")
    _put(group, "crc", crc, "1")
    if isinstance(frames.data, LazyFrames) and frames.data.kept is not None:
        kept = frames.data.kept
        group.attrs["region"] = np.array(astuple(kept.region), np.int64)
        group.attrs.create("kept", **_text(kept.words))
        _put(group, "whole", kept.whole.astype(np.uint8), "1")


def _write_setpoints(group: h5py.Group, setpoints: Mapping[str, Series], segments: Sequence[SegmentRecord]) -> None:
    common: np.ndarray[Any, Any] | None = None
    for name, series in setpoints.items():
        time, axis = np.asarray(series.time, float), "time"
        if common is None:
            common = time
            _put(group, "time", time, "s")
        elif not np.array_equal(common, time):
            axis = f"{name}_time"
            _put(group, axis, time, "s")
        _put(group, name, np.asarray(series.value, float), series.unit).attrs.create("axes", **_text(axis))
    if segments:
        _put(group, "segments", _table(to_columns(segments)), "begin, end: s; others SI")


def _write_events(entry: h5py.Group, events: Iterable[Event]) -> None:
    events = tuple(events)
    columns: dict[str, list[Any]] = {name: [getattr(e, name) for e in events] for name in EVENT_COLUMNS}
    _put(entry, "events", _table(columns), "time: s")


def _table(columns: Mapping[str, Sequence[Any]]) -> np.ndarray[Any, Any]:
    """A compound array of equally long ``columns`` of numbers or texts; texts are of fixed width."""
    encoded = {
        name: [item.encode() for item in column] if name in TEXTS or name.startswith(LABEL) else column
        for name, column in columns.items()
    }
    kinds = {
        name: "<i8" if name == "count" else "<f8" if column is columns[name] else _fixed_width(column)
        for name, column in encoded.items()
    }
    table = np.zeros(len(next(iter(columns.values()))), np.dtype(list(kinds.items())))
    for name, column in encoded.items():
        table[name] = column
    return table


def _fixed_width(texts: Iterable[bytes]) -> Any:
    return h5py.string_dtype("utf-8", max([1, *map(len, texts)]))


def _write_plot(group: h5py.Group, streams: h5py.Group, recording: Recording, plot: str) -> None:
    group.attrs.create("signal", **_text(plot))
    group.attrs.create("axes", **_text("time"))
    _put(group, "title", f"{recording.info.instrument} {recording.info.id}: {plot}")
    group[plot] = streams[plot]["value"]
    group["time"] = streams[plot]["time"]
    shown, quantity = recording.streams[plot], plot.rpartition("_")[0]
    # The other components of a vector: force_y and force_z beside force_x.
    others = [
        name
        for name, series in recording.streams.items()
        if quantity and name != plot and name.rpartition("_")[0] == quantity and np.array_equal(series.time, shown.time)
    ]
    for name in others:
        group[name] = streams[name]["value"]
    if others:
        group.attrs.create("auxiliary_signals", _texts(others))


def _group(parent: h5py.Group, name: str, nx_class: str) -> h5py.Group:
    group = parent.create_group(name, track_order=True)
    group.attrs.create("NX_class", **_text(nx_class))
    return group


def _text(text: str) -> dict[str, Any]:
    data = text.encode()
    return {"data": np.array(data, h5py.string_dtype("utf-8", max(1, len(data))))}


def _texts(texts: Iterable[str]) -> Any:
    data = [text.encode() for text in texts]
    return np.array(data, h5py.string_dtype("utf-8", max(map(len, data))))


def _put(group: h5py.Group, name: str, value: Any, unit: str = "") -> h5py.Dataset:
    if isinstance(value, str):
        dataset = group.create_dataset(name, **_text(value))
    elif np.ndim(value) and np.size(value):
        # Numbers never stand without a checksum; a few of them are not worth packing.
        packed: dict[str, Any] = {"compression": "gzip", "compression_opts": 1} if np.size(value) > 1024 else {}
        dataset = group.create_dataset(name, data=value, shuffle=bool(packed), fletcher32=True, **packed)
    else:
        dataset = group.create_dataset(name, data=value)
    dataset.attrs.create("units", **_text(unit))
    # Of the values as the file gives them back: a list has become an array, a text bytes of fixed width.
    dataset.attrs[checksum.OF_DATA] = np.uint32(checksum.of_data(dataset[()]))
    return dataset


def _verify(recording: Recording, path: Path) -> None:
    """Read ``path`` back and compare every value with the recording in memory."""
    written = open_recording(path)
    problem = difference(recording, written)
    if problem:
        raise RecordingError(f"{path}: what was written does not read back: {problem}")
    if recording.frames is None or written.frames is None:
        return
    if getattr(recording.frames.data, "kept", None) != written.frames.data.kept:
        raise RecordingError(f"{path}: what was written does not read back: the region of the frames differs")
    if isinstance(recording.frames.data, LazyFrames) and not recording.frames.data.packs:
        _verify_chunks(recording.frames.data, path)
        return
    for _ in written.frames.data:  # each frame read is checked against its CRC
        pass


def _verify_chunks(frames: LazyFrames, path: Path) -> None:
    """Compare frames as they are stored, byte by byte: unpacking them again would take ten times as long."""
    with h5py.File(path, "r") as file:
        data = file["entry/frames/data"]
        for index in range(len(frames)):
            mask, content = data.id.read_direct_chunk((index, 0, 0))
            expected = frames.stored(index)
            if content != expected.content or mask != (0 if expected.packed else 1):
                raise RecordingError(f"{path}: what was written does not read back: frame {index} differs")
