"""Reading a recording file: with suspicion, because it may come from anywhere."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import h5py
import numpy as np

from acquire.recording.checksum import OF_ALL, OF_DATA, of_data, of_structure
from acquire.recording.guard import check_file, check_readable_whole
from acquire.recording.lazy import Hdf5Frames
from acquire.recording.model import Event, Frames, Recording, RecordingError, RunInfo, SegmentRecord, Series
from acquire.recording.order import ordered
from acquire.recording.region import Kept
from acquire.recording.review import decisions
from acquire.recording.segments import from_columns
from drivers.signals import Region
from protocols.files import is_file, refusing, shortened
from protocols.specimens import Stated

T = TypeVar("T")

SCHEMA = "acquire-recording/1"
ENTRY_FIELDS = ("start_time", "end_time", "status", "trip_reason")
EVENT_COLUMNS = ("time", "level", "code", "text", "count")  # earlier versions wrote no count
TEXTS = ("level", "code", "text", "phase", "step")  # columns of tables that are texts, as are all labels
DAMAGE, STRUCTURE = "damage", "checksum"  # codes of events
RUN_FIELDS = ("id", "subject", "site", "operator", "specimen", "notes", "protocol", "protocol_name")
ADDED_FIELDS = ("consent", "experiment")  # which the first recordings do not have


def open_recording(path: Path | str) -> Recording:
    """Read a recording; streams are in memory, frames stay on disk until they are sliced.

    Raises RecordingError that names the file and the object for anything that is not a sound recording (external links
    or storage, virtual datasets, shapes without data, another schema, missing or unequal arrays); FileNotFoundError if
    there is no such file.
    """
    return _reviewed(_read(Path(path), _Reader.recording), path)


def open_head(path: Path | str) -> Recording:
    """Only who, what, when and the events of a recording: quick, however long it is. Raises as `open_recording`."""
    return _reviewed(_read(Path(path), _Reader.head), path)


def open_info(path: Path | str) -> RunInfo:
    """Only who, what and when of a recording: quick, however long it is. Raises as `open_recording`."""
    return _read(Path(path), _Reader.info)


def _reviewed(recording: Recording, path: Path | str) -> Recording:
    return replace(recording, decisions=decisions(path, recording.info.id))


def salvage(path: Path | str) -> Recording:
    """The undamaged part of a damaged recording; an event of code ``damage`` names everything that is not.

    Raises as `open_recording` where too little is left to be a recording.
    """
    return _read(Path(path), _Reader.salvaged)


def faults(path: Path | str) -> list[str]:
    """The damage in a recording, every value and every frame read: nothing in a sound one.

    Raises as `open_recording` where too little is left to be a recording.
    """
    recording = salvage(path)
    found = [event.text for event in recording.events if event.code in (DAMAGE, STRUCTURE)]
    if recording.frames is not None:
        for index in range(len(recording.frames.time)):
            try:
                recording.frames.data[index]
            except (RecordingError, OSError) as error:
                found.append(str(error))
    return found


def read_open(file: h5py.File, path: Path) -> Recording:
    """The recording in an open ``file``; ``path`` is named in errors. Raises as `open_recording`."""
    check_file(file, path)
    return _Reader(file, path).recording()


def _read(path: Path, what: Callable[[_Reader], T]) -> T:
    if not is_file(path):
        raise FileNotFoundError(f"{shortened(str(path))}: no such file")
    with refusing(path, RecordingError, "not a readable recording"), h5py.File(path, "r") as file:
        check_file(file, path)
        return what(_Reader(file, path))


class _Reader:
    """Reads one open file; ``cache`` gives channels that share a dataset on disk the same array."""

    def __init__(self, file: h5py.File, path: Path) -> None:
        self.path = path
        self.cache: dict[int, Any] = {}
        self.damage: list[str] | None = None  # damaged parts, where these are to be left out
        self.entry = self.group(file, "entry")
        schema = self.attr(self.entry, "schema", "")
        if schema != SCHEMA:
            raise RecordingError(f"{path}: /entry has schema {schema!r}, expected {SCHEMA!r}")

    def salvaged(self) -> Recording:
        self.damage = []
        recording = self.recording()
        told = (Event(0.0, "error", DAMAGE, text) for text in dict.fromkeys(self.damage))
        return replace(recording, events=(*recording.events, *told))

    def sound(self, read: Callable[[], T], otherwise: T) -> T:
        """The result of ``read``; ``otherwise`` where it is damaged and may be left out."""
        if self.damage is None:
            return read()
        try:
            with refusing(self.path, RecordingError, "damaged"):
                return read()
        except RecordingError as error:
            self.damage.append(str(error).removeprefix(f"{self.path}: "))
            return otherwise

    def recording(self) -> Recording:
        plot = ""
        if "plot" in self.entry:
            plot = self.attr(self.group(self.entry, "plot"), "signal", "")
        # Earlier versions recorded samples in the order in which they came.
        streams, told, _ = ordered(self.series("streams"), tell=False)
        none: tuple[Event, ...] = ()
        events = self.sound(self.events, none)
        if OF_ALL in self.entry.attrs and int(self.entry.attrs[OF_ALL]) != of_structure(self.entry):
            text = "names or attributes differ from those written: the file was edited, or is damaged"
            told.append(Event(0.0, "warning", STRUCTURE, text))
        return Recording(
            info=self.info(),
            streams=streams,
            setpoints=self.sound(self.setpoints, {}),
            segments=self.sound(self.segments, ()),
            frames=self.sound(self.frames, None),
            events=(*events, *told),
            derived=self.series("derived"),
            plot=plot,
        )

    def head(self) -> Recording:
        return Recording(info=self.info(), streams={}, events=self.events())

    def info(self) -> RunInfo:
        run, instrument = self.group(self.entry, "run"), self.group(self.entry, "instrument")
        calibration: dict[str, dict[str, Any]] = {}
        for name, dataset in self.datasets(instrument, "calibration"):
            value = self.text(dataset) if dataset.dtype.kind == "S" else self.array(dataset)
            facts = {"value": value.item() if np.ndim(value) == 0 and not isinstance(value, str) else value}
            facts |= {"unit" if k == "units" else k: self.attr(dataset, k, "") for k in dataset.attrs if k != OF_DATA}
            calibration[name] = facts
        properties = {}
        for name, dataset in self.datasets(run, "specimen_properties"):
            value = tuple(float(v) for v in np.atleast_1d(self.numbers(dataset)))
            properties[name] = Stated(value, float(dataset.attrs.get("se", 0.0)), self.attr(dataset, "units", ""))
        limits = {}
        for name, dataset in self.datasets(instrument, "limits"):
            low, high = self.numbers(dataset)
            limits[name] = (float(low), float(high))
        return RunInfo(
            instrument=self.text(self.dataset(instrument, "name")),
            station=self.text(self.dataset(instrument, "station")),
            device=self.text(self.dataset(instrument, "device")) if "device" in instrument else "",
            repeat=int(self.array(self.dataset(run, "repeat"))),
            versions={name: self.text(dataset) for name, dataset in self.datasets(run, "versions")},
            limits=limits,
            calibration=calibration,
            specimen_properties=properties,
            **{name: self.text(self.dataset(run, name)) if name in run else "" for name in ADDED_FIELDS},
            **{name: self.text(self.dataset(run, name)) for name in RUN_FIELDS},
            **{name: self.text(self.dataset(self.entry, name)) for name in ENTRY_FIELDS},
        )

    def series(self, kind: str) -> dict[str, Series]:
        result = {}
        for name, group in self.members(self.entry, kind):
            series = self.sound(partial(self.one, group), None)
            if series is not None:
                result[name] = series
        return result

    def one(self, group: h5py.Group) -> Series | None:
        if not isinstance(group, h5py.Group):
            raise RecordingError(f"{self.path}: {group.name} is not a group")
        value = np.asarray(self.numbers(self.dataset(group, "value")), float)
        axes = {axis: self.numbers(self.dataset(group, axis)) for axis in ("time", "time_host", "seq") if axis in group}
        for axis, array in {"time": None, **axes}.items():
            if array is None or np.shape(array) != np.shape(value)[:1]:
                have = "missing" if array is None else f"of shape {np.shape(array)}"
                raise RecordingError(f"{self.path}: {group.name}/{axis} is {have}, but value is of shape {value.shape}")
        limits = group.attrs.get("range")
        return Series(
            value=value,
            time=axes["time"],
            unit=self.attr(group, "units", ""),
            time_host=axes.get("time_host"),
            seq=axes.get("seq"),
            stage=self.attr(group, "stage", ""),
            range=None if limits is None else (float(limits[0]), float(limits[1])),
            resolution=float(group.attrs.get("resolution", 0.0)),
            noise=float(group.attrs.get("noise", 0.0)),
        )

    def setpoints(self) -> dict[str, Series]:
        result = {}
        for name, dataset in self.datasets(self.entry, "setpoints"):
            axis = self.attr(dataset, "axes", "")
            if not axis:
                continue
            value, time = self.numbers(dataset), self.numbers(self.dataset(dataset.parent, axis))
            if np.shape(value) != np.shape(time):
                raise RecordingError(
                    f"{self.path}: {dataset.name} is of shape {np.shape(value)}, its time of {np.shape(time)}"
                )
            result[name] = Series(value=value, time=time, unit=self.attr(dataset, "units", ""))
        return result

    def frames(self) -> Frames | None:
        if "frames" not in self.entry:
            return None
        group = self.group(self.entry, "frames")
        data = self.dataset(group, "data")
        time, seq, crc = (self.numbers(self.dataset(group, name)) for name in ("time", "seq", "crc"))
        if data.ndim != 3 or data.dtype != np.uint8 or not len(data) == len(time) == len(seq) == len(crc):
            raise RecordingError(
                f"{self.path}: {data.name} of shape {data.shape} ({data.dtype}) does not fit its time, seq and crc"
            )
        lazy = Hdf5Frames(self.path, data.shape, crc, self.kept(group, data.shape))
        return Frames(data=lazy, time=time, scale=float(group.attrs.get("scale", 0.0)), seq=seq)

    def kept(self, group: h5py.Group, shape: tuple[int, int, int]) -> Kept | None:
        """None where all of every frame was kept."""
        if "region" not in group.attrs:
            return None
        region = Region(*(int(x) for x in group.attrs["region"]))
        whole = self.numbers(self.dataset(group, "whole"))
        if not region.fits(shape[1:]) or np.shape(whole) != shape[:1]:
            raise RecordingError(f"{self.path}: {group.name}: {region} and its {np.shape(whole)} do not fit {shape}")
        return Kept(region, whole != 0)

    def events(self) -> tuple[Event, ...]:
        if "events" not in self.entry:
            return ()
        columns = self.table(self.dataset(self.entry, "events"))
        if tuple(columns) not in (EVENT_COLUMNS, EVENT_COLUMNS[:-1]):
            raise RecordingError(f"{self.path}: /entry/events has the columns {tuple(columns)}")
        return tuple(Event(*row) for row in zip(*columns.values(), strict=True))

    def segments(self) -> tuple[SegmentRecord, ...]:
        """None in a recording of an earlier version."""
        if "setpoints" not in self.entry or "segments" not in self.group(self.entry, "setpoints"):
            return ()
        dataset = self.dataset(self.group(self.entry, "setpoints"), "segments")
        try:
            return from_columns(self.table(dataset))
        except ValueError as error:
            raise RecordingError(f"{self.path}: {dataset.name}: {error}") from error

    def table(self, dataset: h5py.Dataset) -> dict[str, list[Any]]:
        """The columns of a compound dataset."""
        array = self.array(dataset)
        if array.dtype.names is None or array.ndim != 1:
            raise RecordingError(f"{self.path}: {dataset.name} is not a table")
        columns = {name: array[name].tolist() for name in array.dtype.names}
        return {name: [x.decode() if isinstance(x, bytes) else x for x in column] for name, column in columns.items()}

    def datasets(self, parent: h5py.Group, name: str) -> Iterable[tuple[str, h5py.Dataset]]:
        return [(member, self.dataset(self.group(parent, name), member)) for member, _ in self.members(parent, name)]

    def members(self, parent: h5py.Group, name: str) -> Iterable[tuple[str, Any]]:
        return list(self.group(parent, name).items()) if name in parent else []

    def group(self, parent: h5py.Group, name: str) -> h5py.Group:
        item = parent.get(name)
        if not isinstance(item, h5py.Group):
            raise RecordingError(
                f"{self.path}: {parent.name.rstrip('/')}/{name} is missing or not a group: not a recording"
            )
        return item

    def dataset(self, parent: h5py.Group, name: str) -> h5py.Dataset:
        item = parent.get(name)
        if not isinstance(item, h5py.Dataset):
            raise RecordingError(f"{self.path}: {parent.name.rstrip('/')}/{name} is missing or not a dataset")
        return item

    def numbers(self, dataset: h5py.Dataset) -> Any:
        """An array of real numbers: nothing else is measured, commanded or counted."""
        if dataset.dtype.kind not in "fiu":
            raise RecordingError(f"{self.path}: {dataset.name} holds {dataset.dtype}, not numbers")
        return self.array(dataset)

    def array(self, dataset: h5py.Dataset) -> Any:
        address = h5py.h5o.get_info(dataset.id).addr
        if address not in self.cache:
            check_readable_whole(dataset, self.path)
            try:
                value = dataset[()]
            except OSError as error:  # a filter found damage
                raise RecordingError(f"{self.path}: {dataset.name} is damaged: {error}") from error
            if OF_DATA in dataset.attrs and int(dataset.attrs[OF_DATA]) != of_data(value):
                raise RecordingError(f"{self.path}: {dataset.name} is damaged: it does not match its checksum")
            self.cache[address] = value
        return self.cache[address]

    def text(self, dataset: h5py.Dataset) -> str:
        if dataset.dtype.kind != "S" or dataset.shape != ():
            raise RecordingError(f"{self.path}: {dataset.name} is not a text")
        return self.sound(lambda: bytes(self.array(dataset)).decode(), "")

    @staticmethod
    def attr(item: Any, name: str, default: Any) -> Any:
        value = item.attrs.get(name, default)
        return value.decode() if isinstance(value, bytes) else value
