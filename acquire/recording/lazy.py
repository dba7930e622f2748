"""Camera frames that stay on disk until they are asked for."""

from __future__ import annotations

import abc
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from acquire.recording.model import RecordingError
from protocols.files import refusing


class LazyFrames(abc.ABC):
    """An array of frames (n, height, width) of uint8, read frame by frame: index, slice, iterate or ``np.asarray``."""

    shape: tuple[int, int, int]
    dtype = np.dtype(np.uint8)

    @abc.abstractmethod
    def load(self, indices: NDArray[np.intp]) -> NDArray[np.uint8]:
        """Frames at ``indices`` (k,), as (k, height, width). Raises RecordingError on a damaged frame."""

    def take(self, indices: NDArray[np.intp]) -> LazyFrames:
        """The frames at ``indices`` (k,), in that order, as lazy as these."""
        return PickedFrames(self, (len(indices), *self.shape[1:]), np.asarray(indices))

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, key: Any) -> NDArray[np.uint8]:
        first, *rest = key if isinstance(key, tuple) else (key,)
        picked = np.arange(len(self))[first]
        frames = self.load(np.atleast_1d(picked))
        if np.ndim(picked) == 0:
            frames = frames[0]
            return frames[tuple(rest)]
        return frames[(slice(None), *rest)]

    def __iter__(self) -> Iterator[NDArray[np.uint8]]:
        for start in range(0, len(self), 32):
            yield from self[start : start + 32]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return np.asarray(self[:], dtype=dtype)


@dataclass(frozen=True)
class PickedFrames(LazyFrames):
    """Some of ``frames``: frame i is their frame ``chosen[i]``."""

    frames: LazyFrames
    shape: tuple[int, int, int]
    chosen: NDArray[np.intp]

    def load(self, indices: NDArray[np.intp]) -> NDArray[np.uint8]:
        return self.frames.load(self.chosen[indices])


@dataclass(frozen=True)
class Hdf5Frames(LazyFrames):
    """Frames of the dataset ``/entry/frames/data`` in ``path``; the file is open only while frames are read.

    ``crc`` (n,) are the CRC32 of the frames as recorded; every frame read is checked against its own.
    """

    path: Path
    shape: tuple[int, int, int]
    crc: NDArray[np.uint32] | None = None

    def load(self, indices: NDArray[np.intp]) -> NDArray[np.uint8]:
        frames = np.empty((len(indices), *self.shape[1:]), np.uint8)
        with refusing(self.path, RecordingError, "its frames are damaged"), h5py.File(self.path, "r") as file:
            dataset = file["entry/frames/data"]
            for k, index in enumerate(indices):
                frames[k] = dataset[index]
                if self.crc is not None and zlib.crc32(frames[k]) != self.crc[index]:
                    raise RecordingError(f"{self.path}: frame {index} does not match its CRC: the file is damaged")
        return frames
