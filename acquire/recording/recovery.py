"""From journal to recording: after a normal end (`finalise`) and after a crash (`recover`) alike."""

from __future__ import annotations

import json
import mmap
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acquire.recording.hdf5 import write_recording
from acquire.recording.hdf5_reader import open_recording
from acquire.recording.journal import BLOCK, CRC, FRAME, HEADER, MAGIC, Kind
from acquire.recording.lazy import LazyFrames
from acquire.recording.model import Event, Frames, Recording, RecordingError, RunInfo, Series

_KINDS = frozenset(int(kind) for kind in Kind)
MAX_PAYLOAD = 2**30  # no record is longer; a damaged length is not believed


@dataclass(frozen=True)
class Damage:
    """Bytes of a journal that belong to no whole record, from ``start``; ``tail`` if no record follows."""

    start: int
    length: int
    tail: bool


def finalise(journal: Path | str, path: Path | str, *, keep: bool = False) -> Path:
    """Write the journal to the recording ``path`` (verified, then renamed) and, unless ``keep``, remove the journal.

    If ``path`` already holds this very run whole (the process died between the rename and the removal), it is left as
    it is. Raises RecordingError if the journal has no readable beginning or ``path`` holds another run.
    """
    journal, path = Path(journal), Path(path)
    recording = read_journal(journal)
    if path.exists():
        there = open_recording(path)
        if there.info.id != recording.info.id:
            raise RecordingError(f"{path}: holds run {there.info.id}, not {recording.info.id}; it is not overwritten")
    else:
        write_recording(_with_contour(recording), path)
    if not keep:
        journal.unlink()
    return path


def _with_contour(recording: Recording) -> Recording:
    """What the frames show is added, but no fault in reading them may cost the recording."""
    if recording.frames is None:
        return recording
    from acquire.analysis.frames import with_contour

    try:
        return with_contour(recording)
    except Exception as error:
        failed = Event(float(recording.frames.time[0]), "error", "contour", f"the frames could not be read: {error}")
        return replace(recording, events=(*recording.events, failed))


def recover(journal: Path | str, path: Path | str | None = None, *, keep: bool = True) -> Path:
    """Make a recording of what a crash left of ``journal``; ``path`` defaults to the journal's name with ``.h5``.

    The same as `finalise`, save that the journal stays by default. A run whose end was not written has status
    ``recovered``.
    """
    return finalise(journal, path or Path(journal).with_suffix(".h5"), keep=keep)


def read_journal(path: Path | str) -> Recording:
    """The recording that ``path`` holds, as far as its records are whole; frames stay on disk.

    Every stretch of damaged bytes is told as an event. Raises RecordingError if it is no journal or its first record is
    damaged.
    """
    path = Path(path)
    content = _Content(path)
    try:
        for record in _records(path):
            if isinstance(record, Damage):
                content.damage(record)
            else:
                content.add(*record)
        return content.recording()
    except RecordingError:
        raise
    except (ValueError, TypeError, KeyError, struct.error) as error:
        raise RecordingError(f"{path}: a record is whole but not understood: {error}") from error


def _records(path: Path) -> Iterator[tuple[Kind, memoryview, int] | Damage]:
    """Every whole record as (type, payload, offset of the payload), and the damage between them."""
    with path.open("rb") as file:
        if path.stat().st_size < HEADER.size:
            raise RecordingError(f"{path}: not a journal, or its first record is damaged")
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data, memoryview(data) as view:
            position, damaged_from = 0, -1
            while position < len(view):
                length = _whole_record(view, position)
                if length < 0:
                    if damaged_from < 0:
                        damaged_from = position
                    following = data.find(MAGIC, position + 1)
                    position = len(view) if following < 0 else following
                    continue
                if damaged_from >= 0:
                    yield Damage(damaged_from, position - damaged_from, tail=False)
                    damaged_from = -1
                start = position + HEADER.size
                kind = view[position + 8]
                with view[start : start + length] as payload:
                    yield Kind(kind), payload, start
                position = start + length + CRC.size
            if damaged_from >= 0:
                yield Damage(damaged_from, len(view) - damaged_from, tail=True)


def _whole_record(view: memoryview, position: int) -> int:
    """Payload length of the record at ``position``, -1 if there is no whole one."""
    end = position + HEADER.size
    if end > len(view):
        return -1
    magic, length, kind, _ = HEADER.unpack_from(view, position)
    end += length
    if magic != MAGIC or length > MAX_PAYLOAD or end + CRC.size > len(view) or kind not in _KINDS:
        return -1
    with view[position:end] as covered:
        return length if zlib.crc32(covered) == CRC.unpack_from(view, end)[0] else -1


@dataclass(frozen=True)
class JournalFrames(LazyFrames):
    """Frames inside a journal: pixels of frame i begin at byte ``offsets[i]``."""

    path: Path
    shape: tuple[int, int, int]
    offsets: NDArray[np.int64]

    def load(self, indices: NDArray[np.intp]) -> NDArray[np.uint8]:
        size = self.shape[1] * self.shape[2]
        frames = np.empty((len(indices), *self.shape[1:]), np.uint8)
        with self.path.open("rb") as file:
            for k, index in enumerate(indices):
                file.seek(self.offsets[index])
                frames[k] = np.frombuffer(file.read(size), np.uint8).reshape(self.shape[1:])
        return frames


class _Content:
    """Collects the records of one journal."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.first: dict[str, Any] = {}
        self.end: dict[str, Any] = {}
        self.layouts: dict[int, tuple[str, ...]] = {}
        self.blocks: dict[int, list[NDArray[np.float64]]] = {}  # per layout: (3 + channels, n), seq as int64 bits
        self.frame_stamps: list[tuple[int, float, float]] = []
        self.frame_shape: tuple[int, int] = (0, 0)
        self.frame_offsets: list[int] = []
        self.events: list[Event] = []
        self.setpoints: list[dict[str, Any]] = []

    def damage(self, damage: Damage) -> None:
        if damage.start == 0:
            raise RecordingError(f"{self.path}: not a journal, or its first record is damaged")
        what = "the last record was not finished" if damage.tail else "records are damaged and were skipped"
        text = f"{what}: {damage.length} bytes at offset {damage.start} of the journal"
        self.events.append(Event(self.last_time(), "warning", "journal_damage", text))

    def add(self, kind: Kind, payload: memoryview, offset: int) -> None:
        if not self.first and kind is not Kind.INFO:
            raise RecordingError(f"{self.path}: not a journal: it does not begin with the run's identity")
        if kind is Kind.BLOCK:
            layout, samples = BLOCK.unpack_from(payload)
            if layout not in self.layouts:
                return  # its layout record is damaged, and told so
            rows = np.frombuffer(payload, "<f8", offset=BLOCK.size).reshape(3 + len(self.layouts[layout]), samples)
            self.blocks.setdefault(layout, []).append(rows.copy())
        elif kind is Kind.FRAME:
            seq, time, host, height, width = FRAME.unpack_from(payload)
            self.frame_shape = self.frame_shape if self.frame_stamps else (height, width)
            if len(payload) != FRAME.size + height * width:
                raise RecordingError(f"{self.path}: frame {seq} has not as many pixels as its size says")
            if (height, width) != self.frame_shape:
                text = f"frame {seq} is {width}x{height}, the first was {self.frame_shape[1]}x{self.frame_shape[0]}"
                self.events.append(Event(time, "error", "frame_size", f"{text}; left out"))
                return
            self.frame_stamps.append((seq, time, host))
            self.frame_offsets.append(offset + FRAME.size)
        else:
            content = json.loads(bytes(payload))
            if kind is Kind.INFO:
                self.first = content
            elif kind is Kind.LAYOUT:
                self.layouts[content["layout"]] = tuple(content["channels"])
            elif kind is Kind.EVENT:
                self.events.append(Event(**content))
            elif kind is Kind.SETPOINTS:
                self.setpoints.append(content)
            elif kind is Kind.END:
                self.end = content

    def last_time(self) -> float:
        times = [float(rows[-1][1, -1]) for rows in self.blocks.values() if rows[-1].shape[1]]
        return max([*times, *(stamp[1] for stamp in self.frame_stamps[-1:])], default=0.0)

    def recording(self) -> Recording:
        if not self.first:
            raise RecordingError(f"{self.path}: not a journal: it is empty")
        info = RunInfo(**self.first["info"])
        info = replace(info, limits={name: (float(a), float(b)) for name, (a, b) in info.limits.items()})
        end = self.end or {"status": "recovered", "trip_reason": "", "end_time": ""}
        streams = self.streams()
        return Recording(
            info=replace(info, **end),
            streams=streams,
            setpoints=self.commanded(streams),
            frames=self.frames(),
            events=tuple(self.events),
        )

    def streams(self) -> dict[str, Series]:
        about = {channel["name"]: channel for channel in self.first["channels"]}
        streams: dict[str, Series] = {}
        for layout, names in self.layouts.items():
            if layout not in self.blocks:
                continue
            rows = np.concatenate(self.blocks[layout], axis=1)
            seq, time, host = rows[0].view("<i8").astype(np.int64), rows[1], rows[2]
            for name, value in zip(names, rows[3:], strict=True):
                channel = about.get(name, {})
                series = Series(
                    value=value,
                    time=time,
                    unit=channel.get("unit", ""),
                    time_host=host,
                    seq=seq,
                    stage=channel.get("stage", ""),
                    range=tuple(channel["range"]) if "range" in channel else None,
                    resolution=channel.get("resolution", 0.0),
                )
                streams[name] = _joined(streams[name], series) if name in streams else series
        # Channels in the order in which the instrument declares them, whatever order their blocks came in.
        order = [name for name in about if name in streams]
        return {name: streams[name] for name in [*order, *(n for n in streams if n not in about)]}

    def frames(self) -> Frames | None:
        if not self.frame_stamps:
            return None
        shape = (len(self.frame_stamps), *self.frame_shape)
        data = JournalFrames(self.path, shape, np.array(self.frame_offsets))
        time = np.array([stamp[1] for stamp in self.frame_stamps])
        seq = np.array([stamp[0] for stamp in self.frame_stamps], np.int64)
        return Frames(data, time, float(self.first["frame_scale"]), seq)

    def commanded(self, streams: dict[str, Series]) -> dict[str, Series]:
        result: dict[str, Series] = {}
        for record in self.setpoints:
            time = np.asarray(record["time"], float)
            for name, values in record["values"].items():
                unit = record["units"].get(name) or (streams[name].unit if name in streams else "")
                earlier = result.get(name, Series(np.empty(0), np.empty(0), unit))
                kept = _until(earlier, record["start"])
                result[name] = Series(np.append(kept[1], values), np.append(kept[0], time), unit)
        return result


def _until(series: Series, end: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Break points of ``series`` before ``end`` and its value at ``end``: what was commanded until it was replaced."""
    before = series.time < end
    time, value = series.time[before], series.value[before]
    if len(time) and len(series.time) > len(time):
        time, value = np.append(time, end), np.append(value, np.interp(end, series.time, series.value))
    return time, value


def _joined(a: Series, b: Series) -> Series:
    """A channel that came in blocks of two layouts, in the order of its device time."""
    order = np.argsort(np.append(a.time, b.time), kind="stable")

    def both(x: Any, y: Any) -> Any:
        return np.append(x, y)[order]

    return replace(
        a,
        value=both(a.value, b.value),
        time=both(a.time, b.time),
        time_host=both(a.time_host, b.time_host),
        seq=both(a.seq, b.seq),
    )
