"""Reading a journal: whatever is whole in it, and a word about every byte that is not."""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acquire.recording.journal import BLOCK, CONTOUR, CONTOUR_FIELDS, CRC, FRAME, HEADER, MAGIC, Kind
from acquire.recording.journal_bytes import JournalBytes, Window
from acquire.recording.lazy import LazyFrames, Packed, unpack
from acquire.recording.model import Event, FloatArray, Frames, Recording, RecordingError, RunInfo, SegmentRecord, Series
from acquire.recording.order import ordered, ordered_frames
from acquire.recording.region import Kept
from acquire.recording.segments import before
from drivers.contour import Contour
from drivers.signals import Region
from protocols.files import refusing
from protocols.specimens import stated

MAX_PAYLOAD = 2**30  # no record is longer; a damaged length is not believed

_KINDS = frozenset(int(kind) for kind in Kind)


def read_journal(path: Path | str) -> Recording:
    """The recording that ``path`` holds, as far as its records are whole; frames stay on disk.

    Every stretch of damaged bytes is told as an event. Raises RecordingError if it is no journal or no copy of its
    first record is whole.
    """
    return read_content(JournalBytes(Path(path)))[0]


def read_content(data: JournalBytes) -> tuple[Recording, bool]:
    """The recording in ``data``, and whether every byte of the journal is in it. Raises as `read_journal`."""
    content = _Content(data)
    with refusing(data.path, RecordingError, "a record is whole but not understood"):
        for record in _records(data):
            if isinstance(record, Damage):
                content.damage(record)
            else:
                content.add(*record)
        return content.recording(), content.whole


@dataclass(frozen=True)
class Damage:
    """Bytes of a journal that belong to no whole record, from ``start``; ``tail`` if no record follows."""

    start: int
    length: int
    tail: bool


def _records(data: JournalBytes) -> Iterator[tuple[Kind, memoryview, int] | Damage]:
    """Every whole record as (type, payload, offset of the payload), and the damage between them."""
    window = Window(data)
    position, damaged_from = 0, -1
    while position < data.size:
        record = _whole_record(window, position)
        if record is None:
            damaged_from = position if damaged_from < 0 else damaged_from
            position = window.find(MAGIC, position + 1)
            continue
        if damaged_from >= 0:
            yield Damage(damaged_from, position - damaged_from, tail=False)
            damaged_from = -1
        yield record[0], record[1], position + HEADER.size
        position += HEADER.size + len(record[1]) + CRC.size
    if damaged_from >= 0:
        yield Damage(damaged_from, data.size - damaged_from, tail=True)


def _whole_record(window: Window, position: int) -> tuple[Kind, memoryview] | None:
    """Type and payload of the record at ``position``, None if there is no whole one."""
    head = window.view(position, HEADER.size)
    if len(head) < HEADER.size:
        return None
    magic, length, kind, _ = HEADER.unpack(head)
    if magic != MAGIC or length > MAX_PAYLOAD or kind not in _KINDS:
        return None
    whole = window.view(position, HEADER.size + length + CRC.size)
    end = HEADER.size + length
    if len(whole) < end + CRC.size or zlib.crc32(whole[:end]) != CRC.unpack_from(whole, end)[0]:
        return None
    return Kind(kind), whole[HEADER.size : end]


@dataclass(frozen=True)
class JournalFrames(LazyFrames):
    """Frames inside a journal: frame i is ``lengths[i]`` bytes from ``offsets[i]`` on; ``crcs[i]`` is -1 for pixels,
    else the CRC32 of those that are packed there.
    """

    data: JournalBytes
    shape: tuple[int, int, int]
    offsets: NDArray[np.int64]
    lengths: NDArray[np.int64]
    crcs: NDArray[np.int64]
    kept: Kept | None = None
    contours: Mapping[int, bytes] = field(default_factory=dict)  # record of the contour in frame i, where there is one
    packs = False

    def stored(self, index: int) -> Packed:
        content = self.data.read(int(self.offsets[index]), int(self.lengths[index]))
        crc = int(self.crcs[index])
        return Packed(content, crc, True) if crc >= 0 else Packed(content, zlib.crc32(content), False)

    def load(self, indices: NDArray[np.intp]) -> NDArray[np.uint8]:
        frames = np.empty((len(indices), *self.shape[1:]), np.uint8)
        for k, index in enumerate(indices.tolist()):
            stored = self.stored(index)
            pixels = unpack(stored.content, frames[k].size) if stored.packed else stored.content
            if zlib.crc32(pixels) != stored.crc:
                raise RecordingError(f"{self.data.path}: frame {index} does not match its CRC: the journal is damaged")
            frames[k] = np.frombuffer(pixels, np.uint8).reshape(self.shape[1:])
        return frames

    def contour(self, index: int) -> Contour | None:
        if index not in self.contours:
            return None
        record = self.contours[index]
        _, *numbers, low, high = CONTOUR.unpack_from(record)
        profile = np.frombuffer(record, "<f8", offset=CONTOUR.size)
        return Contour(**dict(zip(CONTOUR_FIELDS, numbers, strict=True)), band=(low, high), profile=profile)


class _Content:
    """Collects the records of one journal. ``whole`` is whether nothing in it was left out."""

    def __init__(self, data: JournalBytes) -> None:
        self.data = data
        self.path = data.path
        self.whole = True
        self.first: dict[str, Any] = {}
        self.info: RunInfo | None = None
        self.end: dict[str, Any] = {}
        self.layouts: dict[int, tuple[str, ...]] = {}
        self.blocks: dict[int, list[NDArray[np.float64]]] = {}  # per layout: (3 + channels, n), seq as int64 bits
        self.homeless: list[tuple[int, int, bytes]] = []  # blocks that came before their layout: layout, samples, data
        self.frame_stamps: list[tuple[int, float, float]] = []
        self.frame_shape: tuple[int, int] = (0, 0)
        self.frame_places: list[tuple[int, int, int]] = []  # offset, length, CRC32 (-1: not packed)
        self.frame_whole: list[bool] = []
        self.contours: dict[int, bytes] = {}  # by the index of their frame
        self.events: list[Event] = []
        self.setpoints: list[_Commanded] = []

    def damage(self, damage: Damage) -> None:
        what = "the last record was not finished" if damage.tail else "records are damaged and were skipped"
        text = f"{what}: {damage.length} bytes at offset {damage.start} of the journal"
        self._left_out("warning", "journal_damage", text + (f" ({self.data.fault})" if self.data.fault else ""))

    def add(self, kind: Kind, payload: memoryview, offset: int) -> None:
        """Take in one whole record; one that makes no sense all the same is told and left out."""
        try:
            if kind is Kind.BLOCK:
                layout, samples = BLOCK.unpack_from(payload)
                self._block(layout, samples, bytes(payload[BLOCK.size :]))
            elif kind in (Kind.FRAME, Kind.PACKED_FRAME, Kind.PACKED_PART):
                self._frame(payload, offset, packed=kind is not Kind.FRAME, whole=kind is not Kind.PACKED_PART)
            elif kind is Kind.CONTOUR:
                self._contour(bytes(payload))
            else:
                self._text(kind, json.loads(bytes(payload)))
        except (ValueError, TypeError, LookupError, AttributeError, struct.error, RecursionError) as error:
            text = f"the record at offset {offset - HEADER.size} of the journal is whole but not understood: {error}"
            self._left_out("error", "journal_record", text)

    def _block(self, layout: int, samples: int, data: bytes) -> None:
        if layout not in self.layouts:
            self.homeless.append((layout, samples, data))
            return
        rows = np.frombuffer(data, "<f8").reshape(3 + len(self.layouts[layout]), samples)
        self.blocks.setdefault(layout, []).append(rows)

    def _contour(self, record: bytes) -> None:
        """It follows its frame; one whose frame is damaged or left out is of no use."""
        seq = CONTOUR.unpack_from(record)[0]
        if (len(record) - CONTOUR.size) % 8:
            raise ValueError(f"the contour of frame {seq} is cut")
        if self.frame_stamps and self.frame_stamps[-1][0] == seq:
            self.contours[len(self.frame_stamps) - 1] = record

    def _frame(self, payload: memoryview, offset: int, *, packed: bool, whole: bool) -> None:
        seq, time, host, height, width = FRAME.unpack_from(payload)
        crc = CRC.unpack_from(payload, FRAME.size)[0] if packed else -1
        begin = FRAME.size + (CRC.size if packed else 0)
        if not packed and len(payload) != FRAME.size + height * width:
            raise ValueError(f"frame {seq} has not as many pixels as its size says")
        self.frame_shape = self.frame_shape if self.frame_stamps else (height, width)
        if (height, width) != self.frame_shape:
            text = f"frame {seq} is {width}x{height}, the first was {self.frame_shape[1]}x{self.frame_shape[0]}"
            self._left_out("error", "frame_size", f"{text}; left out", time)
            return
        self.frame_stamps.append((seq, time, host))
        self.frame_places.append((offset + begin, len(payload) - begin, crc))
        self.frame_whole.append(whole)

    def _text(self, kind: Kind, content: Any) -> None:
        if kind is Kind.INFO and self.info is None:
            info = RunInfo(**content["info"])
            limits = {name: (float(a), float(b)) for name, (a, b) in info.limits.items()}
            properties = stated(info.specimen, info.specimen_properties)
            self.first, self.info = content, replace(info, limits=limits, specimen_properties=properties)
        elif kind is Kind.LAYOUT:
            self.layouts[content["layout"]] = tuple(content["channels"])
        elif kind is Kind.EVENT:
            self.events.append(Event(**content))
        elif kind is Kind.SETPOINTS:
            self.setpoints.append(_Commanded.of(content))
        elif kind is Kind.END:
            self.end = {name: str(content[name]) for name in ("status", "trip_reason", "end_time")}

    def _left_out(self, level: str, code: str, text: str, time: float | None = None) -> None:
        self.whole = False
        self.events.append(Event(self.last_time() if time is None else time, level, code, text))

    def last_time(self) -> float:
        times = [float(rows[-1][1, -1]) for rows in self.blocks.values() if rows[-1].shape[1]]
        return max([*times, *(stamp[1] for stamp in self.frame_stamps[-1:])], default=0.0)

    def recording(self) -> Recording:
        if self.info is None:
            raise RecordingError(f"{self.path}: not a journal, or its first record is damaged")
        self._settle()
        streams, told, all_kept = ordered(self.streams())
        self._note(told, all_kept)
        frames = self.frames()
        if frames is not None:
            frames, told, all_kept = ordered_frames(frames)
            self._note(told, all_kept)
            if frames.data.kept is not None:
                self.events.append(Event(float(frames.time[0]), "info", "region", frames.data.kept.words))
        return Recording(
            info=replace(self.info, **(self.end or {"status": "recovered", "trip_reason": "", "end_time": ""})),
            streams=streams,
            setpoints=self.commanded(streams),
            segments=self.segments(),
            frames=frames,
            events=tuple(self.events),
        )

    def _note(self, events: list[Event], all_kept: bool) -> None:
        self.whole &= all_kept
        self.events += events

    def _settle(self) -> None:
        """Place the blocks whose layout was damaged where they came, by a later copy of it."""
        lost = sum(layout not in self.layouts for layout, *_ in self.homeless)
        found = [block for block in self.homeless if block[0] in self.layouts]
        later, self.blocks, self.homeless = self.blocks, {}, []
        for layout, samples, data in found:
            self._block(layout, samples, data)
        for layout, blocks in later.items():
            self.blocks.setdefault(layout, []).extend(blocks)
        if lost:
            text = f"{lost} blocks of samples cannot be read: the record that names their channels is damaged"
            self._left_out("error", "journal_damage", text)

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
        places = np.array(self.frame_places, np.int64).T
        data = JournalFrames(self.data, shape, places[0], places[1], places[2], self.kept(), self.contours)
        time = np.array([stamp[1] for stamp in self.frame_stamps])
        seq = np.array([stamp[0] for stamp in self.frame_stamps], np.int64)
        return Frames(data, time, float(self.first["frame_scale"]), seq)

    def kept(self) -> Kept | None:
        region = self.first.get("region")  # earlier versions kept whole frames
        return Kept(Region(**region), np.array(self.frame_whole)) if region else None

    def segments(self) -> tuple[SegmentRecord, ...]:
        result: list[SegmentRecord] = []
        for record in self.setpoints:
            if record.segments is None:  # a journal of an earlier version
                return ()
            result = [*before(result, record.start), *record.segments]
        return tuple(result)

    def commanded(self, streams: dict[str, Series]) -> dict[str, Series]:
        result: dict[str, Series] = {}
        for record in self.setpoints:
            for name, values in record.values.items():
                unit = record.units.get(name) or (streams[name].unit if name in streams else "")
                earlier = result.get(name, Series(np.empty(0), np.empty(0), unit))
                kept = _until(earlier, record.start)
                result[name] = Series(np.append(kept[1], values), np.append(kept[0], record.time), unit)
        return result


@dataclass(frozen=True)
class _Commanded:
    """One record of set-points: from ``start`` (s) on they replace earlier records."""

    start: float
    time: FloatArray
    values: Mapping[str, FloatArray]
    units: Mapping[str, str]
    segments: tuple[SegmentRecord, ...] | None

    @classmethod
    def of(cls, content: Mapping[str, Any]) -> _Commanded:
        """The record that ``content`` (JSON) spells. Raises ValueError, TypeError, KeyError, IndexError."""
        time = np.asarray(content["time"], float)
        values = {str(name): np.asarray(value, float) for name, value in content["values"].items()}
        if any(value.shape != time.shape for value in values.values()):
            raise ValueError("set-points and their times differ in number")
        segments = None
        if "segments" in content:  # each of two break points
            segments = tuple(
                SegmentRecord(
                    float(time[2 * k]),
                    float(time[2 * k + 1]),
                    about["phase"],
                    about["step"],
                    {q: float(value[2 * k]) for q, value in values.items()},
                    {q: float(value[2 * k + 1]) for q, value in values.items()},
                    about["labels"],
                )
                for k, about in enumerate(content["segments"])
            )
        return cls(float(content["start"]), time, values, content["units"], segments)


def _until(series: Series, end: float) -> tuple[FloatArray, FloatArray]:
    """Break points of ``series`` before ``end`` and its value at ``end``: the set-points until they were replaced."""
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
