"""The append-only journal: the truth of a run while it runs, readable after a crash at any moment.

The file is a row of records, each complete in itself::

    magic 4 B "SRJ1" | length u32 | type u8 | sequence u64 | payload | CRC32 u32 of all before it

Every record is handed to the operating system at once, so a killed process loses nothing it has written; ``fdatasync``
follows within `SYNC_INTERVAL`, so that a power cut loses no more than that. A torn tail is where reading stops, and a
damaged record in the middle is skipped at the next magic. The records that others cannot be read without are repeated
every `REPEAT` seconds. While it is written the file is locked (`acquire.recording.lock`), so that nobody recovers a run
that goes on. `acquire.recording.journal_reader` reads journals.
"""

from __future__ import annotations

import errno
import json
import os
import struct
import time
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import asdict, fields, replace
from datetime import datetime
from enum import IntEnum
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from acquire.files import PRIVATE
from acquire.recording.lazy import Packed, pack
from acquire.recording.lock import lock
from acquire.recording.model import Event, RecordingError, RunInfo
from drivers.contour import Contour
from drivers.signals import Block, Channel, Frame, Region
from protocols.setpoints import Setpoints

MAGIC = b"SRJ1"
HEADER = struct.Struct("<4sIBQ")
CRC = struct.Struct("<I")
BLOCK = struct.Struct("<HI")  # layout, samples; then seq i64, time f8, time_host f8, one f8 row per channel
FRAME = struct.Struct("<qddII")  # seq, time, time_host, height, width; then the pixels
CONTOUR = struct.Struct("<q8d")  # seq, then `CONTOUR_FIELDS` and the band; then the profile, one f8 a column
CONTOUR_FIELDS = ("gvt", "apex_column", "apex_row", "foot_row", "height", "confidence")
SYNC_INTERVAL = 0.05  # s of wall time between two fdatasync at most, while data or `sync` calls arrive
MAX_TEXT = 2000  # characters of an event or of the reason for an end
REPEAT = 10.0  # s of wall time between two copies of the run's identity and the blocks' layouts

_CLOCK = (1577836800.0, 4102444800.0)  # s since 1970: a clock before 2020 or after 2100 is wrong


class Kind(IntEnum):
    """Types of records."""

    INFO = 1  # JSON: format, RunInfo, channels, frame scale, region of frames; the first record, and repeated
    LAYOUT = 2  # JSON: number and channel names of the blocks that follow; repeated
    BLOCK = 3
    FRAME = 4
    EVENT = 5  # JSON
    SETPOINTS = 6  # JSON: from ``start`` on, these break points replace the earlier ones
    PACKED_FRAME = 8  # as FRAME, the pixels' CRC32 and their zlib stream in place of the pixels
    PACKED_PART = 9  # as PACKED_FRAME, with zeros outside the region
    CONTOUR = 10  # read in a frame when it came
    END = 7  # JSON: status, trip reason, end time


class JournalFull(RecordingError):
    """The disk took no more. The recording so far is whole and can be recovered."""


class JournalWriter:
    """Writes one run's journal. One thread at a time; every method is a single write and returns at once.

    ``frame_scale`` is in m/px (0: not known); of frames that are not kept whole only the ``region`` is kept. Raises
    FileExistsError rather than touch an existing journal, and `JournalFull` from any method when the disk is full: the
    torn record is then taken back, no more data are accepted.

    Only the owner of the file may read it, because it names a subject. The lock is held until `close`.
    """

    def __init__(
        self,
        path: Path | str,
        info: RunInfo,
        channels: Iterable[Channel] = (),
        *,
        frame_scale: float = 0.0,
        region: Region | None = None,
        sync_interval: float = SYNC_INTERVAL,
    ) -> None:
        self.path = Path(path)
        self.path.parent.mkdir(parents=True, exist_ok=True)
        flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)
        self._disk = os.stat(self.path.parent).st_dev
        self._file = os.open(self.path, flags, PRIVATE)
        lock(self._file, self.path)
        self._sequence = 0
        self._end = 0
        self._full = False
        self._ended = False
        self._dirty = False
        self._sync_interval = sync_interval
        self._synced = self._repeated = self._began = time.monotonic()
        self._wall = max(time.time(), _seconds(info.start_time))  # the clock may have been set since that was said
        self._layouts: dict[tuple[str, ...], int] = {}
        self._first = {
            "format": "acquire-journal/1",
            "info": {
                **{item.name: getattr(info, item.name) for item in fields(info)},
                "specimen_properties": {key: known.plain() for key, known in info.specimen_properties.items()},
            },
            "channels": [asdict(channel) for channel in channels],
            "frame_scale": frame_scale,
            "region": asdict(region) if region is not None else None,
        }
        self._region = region
        self._json(Kind.INFO, self._first)
        self.sync(force=True)

    def __enter__(self) -> JournalWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close("completed" if error is None else "failed", "" if error is None else str(error))

    @property
    def size(self) -> int:
        """Bytes written so far."""
        return self._end

    @property
    def descriptor(self) -> int:
        """The open file: its contents can be read even when its name is gone."""
        return self._file

    def gone(self) -> str:
        """Why the journal would not be found under its name any more; '' while it would."""
        here = os.fstat(self._file)
        try:
            there = os.stat(self.path)
        except OSError as error:
            return f"{self.path}: the journal is gone: {os.strerror(error.errno or 0)}"
        if os.path.samestat(here, there) and here.st_nlink:
            return ""
        return f"{self.path}: the journal is gone: there is another file in its place"

    def same_disk(self) -> bool:
        """Whether the journal's folder is where it was; not where its disk was taken away."""
        for folder in self.path.absolute().parents:
            try:
                return os.stat(folder).st_dev == self._disk
            except FileNotFoundError:
                continue  # deleted, and made anew by whoever writes there; or its disk is gone: its parent's is another
            except OSError:
                return False
        return False

    def block(self, block: Block) -> None:
        """Append the samples of several channels that share their stamps."""
        names = tuple(block.values)
        if names not in self._layouts:
            self._layouts[names] = len(self._layouts)
            self._layout(names)
        self._append(
            Kind.BLOCK,
            BLOCK.pack(self._layouts[names], len(block)),
            np.ascontiguousarray(block.seq, "<i8").data.cast("B"),
            *(np.ascontiguousarray(stamp, "<f8").data.cast("B") for stamp in (block.time, block.time_host)),
            *(np.ascontiguousarray(value, "<f8").data.cast("B") for value in block.values.values()),
        )

    def frame(self, frame: Frame, *, quickly: bool = False, whole: bool = True) -> Packed:
        """Append one camera frame with its contour, compressed without loss; ``quickly`` as it is.

        Of a frame that need not be ``whole`` only the region is kept. The result is the kept part.
        """
        image = np.ascontiguousarray(frame.image, np.uint8)
        stamps = FRAME.pack(frame.seq, frame.time, frame.time_host, *image.shape)
        part = None if whole else self._region
        packed = None if quickly else pack(image if part is None else part.cut(image))
        if packed is None or not packed.packed:
            pixels = image.tobytes()
            packed = Packed(pixels, zlib.crc32(pixels), False)
            self._append(Kind.FRAME, stamps, pixels)
        else:
            kind = Kind.PACKED_FRAME if part is None else Kind.PACKED_PART
            self._append(kind, stamps, CRC.pack(packed.crc), packed.content)
        if frame.contour is not None:
            self._contour(frame.seq, frame.contour)
        return packed

    def event(self, event: Event) -> None:
        """Append an event."""
        self._json(Kind.EVENT, asdict(replace(event, text=_clean(event.text))))

    def setpoints(self, setpoints: Setpoints, start: float = 0.0, units: Mapping[str, str] | None = None) -> None:
        """Append the set-points from device time ``start`` (s) on; they replace earlier break points after ``start``.

        So a run that pauses or ends a step early (``until``) writes the rest of its set-points anew. ``units`` (SI)
        are those of the channels of the same name where not given.
        """
        times, values = setpoints.table()
        # Durations that were measured add up with errors of an ulp; break points must not go back by it.
        times = np.maximum.accumulate(times + start)
        table = {name: value.tolist() for name, value in values.items()}
        record: dict[str, Any] = {"start": start, "time": times.tolist(), "values": table, "units": dict(units or {})}
        about = [{"phase": s.phase, "step": s.step, "labels": dict(s.labels)} for s in setpoints.segments]
        record["segments"] = about  # each of two break points
        self._json(Kind.SETPOINTS, record)

    def sync(self, *, force: bool = False) -> None:
        """Flush the written records to the disk if `SYNC_INTERVAL` has passed (call it when idle, too)."""
        now = time.monotonic()
        if now - self._repeated >= REPEAT and not self._full:
            self._repeat()
        if self._dirty and (force or now - self._synced >= self._sync_interval):
            getattr(os, "fdatasync", os.fsync)(self._file)
            self._dirty = False
            self._synced = now

    def end(self, status: str = "completed", trip_reason: str = "", end_time: str = "") -> None:
        """Write how the run ended; nothing can be added after it, and the file stays open and locked. Idempotent.

        ``end_time`` is wall clock, ISO 8601; by default the moment of creation and the time since then, so that a
        clock that was set meanwhile does not let a run end before it began. On a full disk the end is not written:
        recovery will call the run ``recovered``.
        """
        if self._ended or self._file < 0:
            return
        moment = end_time or iso_time(self._wall + time.monotonic() - self._began)
        try:
            if not self._full:
                self._repeat()
                self._json(Kind.END, {"status": status, "trip_reason": _clean(trip_reason), "end_time": moment})
            self.sync(force=True)
        except JournalFull:
            pass  # the caller heard of it when data were refused, or hears of it from the status of the recording
        finally:
            self._ended = True

    def close(self, status: str = "completed", trip_reason: str = "", end_time: str = "") -> None:
        """`end` the run unless that is done, close the file and give up its lock. Idempotent."""
        if self._file < 0:
            return
        try:
            self.end(status, trip_reason, end_time)
        finally:
            os.close(self._file)
            self._file = -1

    def _contour(self, seq: int, contour: Contour) -> None:
        numbers = (*(getattr(contour, name) for name in CONTOUR_FIELDS), *contour.band)
        profile = np.ascontiguousarray(contour.profile, "<f8").data.cast("B")
        self._append(Kind.CONTOUR, CONTOUR.pack(seq, *numbers), profile)

    def _layout(self, names: tuple[str, ...]) -> None:
        self._json(Kind.LAYOUT, {"layout": self._layouts[names], "channels": names})

    def _repeat(self) -> None:
        """Write the run's identity and the layouts once more: one damaged record must not cost the others."""
        self._repeated = time.monotonic()
        self._json(Kind.INFO, self._first)
        for names in self._layouts:
            self._layout(names)

    def _json(self, kind: Kind, content: Mapping[str, Any]) -> None:
        self._append(kind, json.dumps(content, default=_plain).encode())

    def _append(self, kind: Kind, *parts: bytes | memoryview) -> None:
        if self._file < 0 or self._ended:
            raise RecordingError(f"{self.path}: the journal is closed")
        if self._full:
            raise JournalFull(f"{self.path}: the disk is full; {self._end} bytes are safe")
        length = sum(len(part) for part in parts)
        header = HEADER.pack(MAGIC, length, kind, self._sequence)
        crc = zlib.crc32(header)
        for part in parts:
            crc = zlib.crc32(part, crc)
        self._write((header, *parts, CRC.pack(crc)), HEADER.size + length + CRC.size)
        self._sequence += 1
        self._dirty = True
        self.sync()

    def _write(self, parts: tuple[bytes | memoryview, ...], size: int) -> None:
        # One write call a record: a signal between two of them cannot tear it.
        record = b"".join(parts)
        written = 0
        try:
            while written < size:
                written += os.write(self._file, record[written:] if written else record)
        except OSError as error:
            if error.errno not in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
                raise
            self._full = True
            os.ftruncate(self._file, self._end)
            os.lseek(self._file, self._end, os.SEEK_SET)
            message = f"{self.path}: the disk is full ({error.strerror}); the {self._end} bytes so far are safe"
            raise JournalFull(message) from error
        self._end += size


def iso_now() -> str:
    """The present moment as ISO 8601 in UTC, to the millisecond.

    Raises RecordingError where this computer's clock cannot be right.
    """
    now = time.time()
    if not _CLOCK[0] <= now < _CLOCK[1]:
        raise RecordingError(f"this computer's clock says {iso_time(now)}: set it before anything is recorded")
    return iso_time(now)


def _seconds(moment: str) -> float:
    """Seconds since 1970 of an ISO 8601 time; 0 where it is none."""
    try:
        return datetime.fromisoformat(moment).timestamp()
    except ValueError:
        return 0.0


def iso_time(seconds: float) -> str:
    """``seconds`` since 1970 as ISO 8601 in UTC, to the millisecond; the year stays within 1970 … 9999."""
    seconds = min(max(seconds, 0.0), 253402300799.0)
    return time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(seconds)) + f".{int(seconds % 1 * 1000):03d}+00:00"


def _clean(text: str) -> str:
    """``text``, which may quote a device, as every file takes it: UTF-8 of bounded length without NUL."""
    return text.encode("utf-8", "replace").decode().replace("\0", "?")[:MAX_TEXT]


def _plain(value: Any) -> Any:
    """Numpy values and mappings as JSON knows them."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    raise TypeError(f"{type(value).__name__} cannot be written into the journal")
