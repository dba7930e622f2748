"""The recording's file while the run goes on: frames go into it as they come, so that little is left to be written.

A draft is a help, never the truth: that is the journal. The file has no name before it is complete and verified, so
that nothing of it is left where a process is killed; where the disk refuses, or cannot have such files (Linux can),
there is no draft, and the recording is written from the journal as a whole.
"""

from __future__ import annotations

import contextlib
import logging
from pathlib import Path

import h5py
import numpy as np

from acquire.files import nameless
from acquire.recording.hdf5_sink import Sink
from acquire.recording.lazy import LEVEL, Packed

log = logging.getLogger(__name__)

_ROOM = 512  # frames by which the dataset grows
_DRAFT = "draft"


class Draft:
    """Takes the frames of one run. One thread at a time. Use `complete` of `acquire.recording.hdf5` at its end."""

    def __init__(self, folder: Path) -> None:
        """A nameless file in ``folder``. Raises OSError."""
        self.folder = folder
        self.crc: list[int] = []  # of each frame's pixels as stored
        self._shape: tuple[int, ...] = ()
        self.raw = nameless(folder)
        self.sink = Sink(self.raw)
        self.file = h5py.File(self.sink, "w", track_order=True)

    @property
    def size(self) -> int:
        """Bytes written so far."""
        return self.sink.size

    def __len__(self) -> int:
        return len(self.crc)

    def add(self, shape: tuple[int, ...], frame: Packed) -> None:
        """One more frame of ``shape`` (height, width), left out where the first had another. Raises OSError."""
        if not self._shape:
            self._shape = shape
            self.file.create_dataset(
                _DRAFT, (0, *shape), np.uint8, maxshape=(None, *shape), chunks=(1, *shape), compression="gzip",
                compression_opts=LEVEL,
            )  # fmt: skip
        if shape != self._shape:
            return
        data = self.file[_DRAFT]
        if len(self) == len(data):
            data.resize(len(data) + _ROOM, axis=0)
        data.id.write_direct_chunk((len(self), 0, 0), frame.content, filter_mask=0 if frame.packed else 1)
        self.crc.append(frame.crc)
        self.sink.check()

    def frames(self, group: h5py.Group) -> h5py.Dataset:
        """The dataset of all frames, moved to ``group``."""
        data = self.file[_DRAFT]
        data.resize(len(self), axis=0)
        group["data"] = data
        del self.file[_DRAFT]
        return data

    def close(self) -> None:
        """Close the file; without a name it is gone. Idempotent."""
        with contextlib.suppress(RuntimeError, OSError):  # the sink tells what HDF5 could not write
            self.file.close()
        self.raw.close()


class Drafting:
    """Keeps a draft as long as that is possible, and never a run from going on."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._given_up = False
        self.draft: Draft | None = None

    def add(self, shape: tuple[int, ...], frame: Packed) -> None:
        """One more frame, as the journal has it."""
        if self._given_up:
            return
        try:
            self.draft = self.draft or Draft(self._folder)
            self.draft.add(shape, frame)
        except Exception as error:
            log.info("frames are written at the end of the run: %s", error)
            self.close()

    def close(self) -> None:
        """No draft any more. Idempotent."""
        self._given_up = True
        if self.draft is not None:
            self.draft.close()
            self.draft = None
