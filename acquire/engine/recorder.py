"""The recorder: one thread that writes all a run delivers, first into the journal, in the end into the recording."""

from __future__ import annotations

import logging
import os
import tempfile
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from platformdirs import user_data_dir

from acquire.engine.queues import Overflow, RecordQueue
from acquire.files import CannotWrite, told
from acquire.recording import Event, RunInfo
from acquire.recording.draft import Drafting
from acquire.recording.hdf5 import rehearse
from acquire.recording.journal import JournalWriter
from acquire.recording.lock import is_live
from acquire.recording.order import Missing
from acquire.recording.recovery import finalise
from acquire.recording.region import Keeper
from drivers.signals import Block, Channel, Frame, IntArray, Region
from protocols.setpoints import Setpoints

log = logging.getLogger(__name__)

BEHIND = 0.25  # of the queue filled: frames are then not compressed, so that none is lost
LOOK = 1.0  # s of wall time between two looks whether the journal is still there


@dataclass(frozen=True)
class Commanded:
    """Set-points from device time ``start`` s on; they replace those written for later times."""

    setpoints: Setpoints
    start: float


@dataclass(frozen=True)
class _End:
    status: str
    reason: str


Item = Block | Frame | Event | Commanded | _End


class Recorder(threading.Thread):
    """Writes one run. ``on_failure`` is called once, in whichever thread finds out, when data can no longer be kept."""

    def __init__(
        self,
        path: Path,
        info: RunInfo,
        channels: tuple[Channel, ...],
        on_failure: Callable[[str], None],
        frame_scale: float = 0.0,
        capacity: int = 256 << 20,
        region: Region | None = None,
    ) -> None:
        """Creates the journal beside ``path``; of most frames only the ``region`` is kept, where there is one.

        Raises FileExistsError if ``path`` or its journal exists, RecordingError if ``info`` cannot be recorded,
        CannotWrite.
        """
        super().__init__(name=f"recorder-{path.stem}", daemon=True)
        if os.path.lexists(path):
            raise FileExistsError(f"{path}: there is a recording already; it is not overwritten")
        rehearse(info, channels)
        self.path = path
        self.journal = path.with_suffix(".journal")
        self.lost = 0  # samples and frames missing in the sequence numbers so far
        self.result: Future[Path] = Future()
        self._units = {channel.name: channel.unit for channel in channels}
        self._writer = _journal(self.journal, info, channels, frame_scale, region)
        self._keeper = Keeper(region)
        self._drafting = Drafting(path.parent)
        self._queue: RecordQueue[Item] = RecordQueue(capacity)
        self._on_failure = on_failure
        self._failed = False  # nothing more can be kept
        self._told = False
        self._looked = time.monotonic()
        self._missing: dict[tuple[str, ...], Missing] = {}

    # Called by others -------------------------------------------------------------------------------------------------

    @property
    def fill(self) -> float:
        """How full the queue is, 0 … 1."""
        return self._queue.fill

    @property
    def written(self) -> int:
        """Bytes that the run takes on the disk so far: the journal, and the frames in the recording's draft."""
        draft = self._drafting.draft
        return self._writer.size + (draft.size if draft is not None else 0)

    def put(self, item: Block | Frame | Event | Commanded) -> None:
        """Record ``item``. A block that does not fit ends the run: nothing is dropped in silence."""
        try:
            self._queue.put(item)
        except Overflow as error:
            self._fail(str(error))

    def finish(self, status: str, reason: str) -> Future[Path]:
        """Write the end and the recording; the result is its path. The journal goes only when that is verified."""
        self._queue.put_always(_End(status, reason))
        return self.result

    # In this thread ---------------------------------------------------------------------------------------------------

    def run(self) -> None:
        """Write until finished."""
        end: _End | None = None
        while end is None:
            items = self._queue.take(0.05)
            end = next((item for item in items if isinstance(item, _End)), None)
            try:
                for item in items:
                    if not self._failed:
                        self._write(item)
                if not self._failed:
                    self._writer.sync()
                self._look_after()
            except Exception as error:
                self._fail(str(error))
        try:
            self._writer.end(end.status, end.reason)
        except OSError as error:  # the disk fails: the end is missing, the part before may be readable
            log.error("%s: %s", self.journal, error)
        try:
            self.result.set_result(self._save())
        except Exception as error:
            log.error("%s: %s", self.path, error)
            self.result.set_exception(error)
        finally:
            self._drafting.close()
            self._writer.close()

    def _save(self) -> Path:
        """Make the recording: beside its journal, or where the journal is gone, wherever there is room."""
        name, folders = self.path.name, [self.path.parent]
        if gone := self._writer.gone():
            log.error("%s", gone)
            folders = [*(folders if self._writer.same_disk() else []), *_shelters()]
        *first, last = folders
        for folder in first:
            try:
                return finalise(self._writer, folder / name, draft=self._drafting.draft)
            except CannotWrite as error:
                log.error("%s; trying elsewhere", error)
        return finalise(self._writer, last / name, draft=self._drafting.draft)

    def _look_after(self) -> None:
        """Whether the journal can still be found; a person is told while there is time to act."""
        now = time.monotonic()
        if now - self._looked >= LOOK:
            self._looked = now
            if gone := self._writer.gone():
                self._tell(gone)  # later data are kept all the same, in the open file

    def _write(self, item: Item) -> None:
        if isinstance(item, Block):
            self._count(tuple(item.values), item.seq)
            self._writer.block(item)
        elif isinstance(item, Frame):
            self._count(("frames",), np.array([item.seq]))
            kept = self._writer.frame(item, quickly=self._queue.fill > BEHIND, whole=self._keeper.whole(item))
            self._drafting.add(item.image.shape, kept)
        elif isinstance(item, Event):
            self._writer.event(item)
        elif isinstance(item, Commanded):
            self._writer.setpoints(item.setpoints, item.start, self._units)

    def _count(self, key: tuple[str, ...], seq: IntArray) -> None:
        self._missing.setdefault(key, Missing()).take(seq)
        self.lost = sum(missing.count for missing in self._missing.values())

    def _fail(self, reason: str) -> None:
        """Nothing more can be kept."""
        self._failed = True
        self._tell(reason)

    def _tell(self, reason: str) -> None:
        if not self._told:
            self._told = True
            self._on_failure(reason)


def _journal(
    path: Path, info: RunInfo, channels: tuple[Channel, ...], frame_scale: float, region: Region | None
) -> JournalWriter:
    try:
        with told(path):
            return JournalWriter(path, info, channels, frame_scale=frame_scale, region=region)
    except FileExistsError:
        why = "another run is being recorded there" if is_live(path) else f"left by a crash: acquire recover {path}"
        raise FileExistsError(f"{path}: exists already; {why}") from None


def _shelters() -> tuple[Path, ...]:
    """Folders of this computer for recordings whose own disk has gone."""
    return Path(user_data_dir("skinrig")) / "rescued", Path(tempfile.gettempdir()) / "skinrig-rescued"
