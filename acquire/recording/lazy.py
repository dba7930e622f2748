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
from acquire.recording.region import Kept
from drivers.contour import Contour
from protocols.files import refusing

LEVEL = 1  # of deflate, the one filter that every HDF5 reader has; higher ones cost time and gain 2 %


@dataclass(frozen=True)
class Packed:
    """One frame as HDF5 stores it: ``content`` is a zlib stream (``packed``) or the pixels, ``crc`` their CRC32."""

    content: bytes
    crc: int
    packed: bool


def pack(image: NDArray[np.uint8]) -> Packed:
    """A frame (height, width), compressed without loss; as it is where that would make it longer."""
    pixels = np.ascontiguousarray(image, np.uint8).tobytes()
    packed = zlib.compress(pixels, LEVEL)
    crc = zlib.crc32(pixels)
    return Packed(packed, crc, True) if len(packed) < len(pixels) else Packed(pixels, crc, False)


def unpack(content: bytes, size: int) -> bytes:
    """The ``size`` bytes of pixels in a zlib stream. Raises ValueError if it does not hold exactly so many."""
    try:
        stream = zlib.decompressobj()
        pixels = stream.decompress(content, size + 1)
    except zlib.error as error:
        raise ValueError(str(error)) from error
    if len(pixels) != size or not stream.eof:
        raise ValueError("the stream does not hold one frame")
    return pixels


class LazyFrames(abc.ABC):
    """An array of frames (n, height, width) of uint8, read frame by frame: index, slice, iterate or ``np.asarray``.

    Where only a region of most frames was ``kept``, the pixels around it are those of the last whole frame before.
    """

    shape: tuple[int, int, int]
    dtype = np.dtype(np.uint8)
    packs = True  # whether `stored` has to compress; if not, it costs no more than reading
    kept: Kept | None = None

    @abc.abstractmethod
    def load(self, indices: NDArray[np.intp]) -> NDArray[np.uint8]:
        """Frames at ``indices`` (k,) as they are stored, (k, height, width): zeros where nothing was kept.

        Raises RecordingError on a damaged frame.
        """

    def stored(self, index: int) -> Packed:
        """Frame ``index`` as HDF5 is to store it; frames that are packed already are not packed anew."""
        return pack(self.load(np.array([index]))[0])

    def contour(self, index: int) -> Contour | None:
        """The contour that was read in frame ``index`` when it came; None where nobody looked."""
        return None

    def take(self, indices: NDArray[np.intp]) -> LazyFrames:
        """The frames at ``indices`` (k,), in that order, as lazy as these."""
        return PickedFrames(self, (len(indices), *self.shape[1:]), np.asarray(indices))

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, key: Any) -> NDArray[np.uint8]:
        first, *rest = key if isinstance(key, tuple) else (key,)
        picked = np.arange(len(self))[first]
        frames = self._filled(np.atleast_1d(picked))
        if np.ndim(picked) == 0:
            frames = frames[0]
            chosen: NDArray[np.uint8] = frames[tuple(rest)]
            return chosen
        return frames[(slice(None), *rest)]

    def __iter__(self) -> Iterator[NDArray[np.uint8]]:
        for start in range(0, len(self), 32):
            yield from self[start : start + 32]

    def _filled(self, indices: NDArray[np.intp]) -> NDArray[np.uint8]:
        frames = self.load(indices)
        if self.kept is None:
            return frames
        around: dict[int, NDArray[np.uint8]] = {}
        place = self.kept.region.place
        for k, index in enumerate(indices.tolist()):
            whole = self.kept.around(index)
            if self.kept.whole[index] or whole < 0:
                continue
            if whole not in around:
                around = {whole: self.load(np.array([whole]))[0]}
            inside = frames[k][place].copy()
            frames[k] = around[whole]
            frames[k][place] = inside
        return frames

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

    @property
    def packs(self) -> bool:  # type: ignore[override]
        return self.frames.packs

    @property
    def kept(self) -> Kept | None:  # type: ignore[override]
        return None if self.frames.kept is None else self.frames.kept.take(self.chosen)

    def stored(self, index: int) -> Packed:
        return self.frames.stored(int(self.chosen[index]))

    def contour(self, index: int) -> Contour | None:
        return self.frames.contour(int(self.chosen[index]))


@dataclass(frozen=True)
class Hdf5Frames(LazyFrames):
    """Frames of the dataset ``/entry/frames/data`` in ``path``; the file is open only while frames are read.

    ``crc`` (n,) are the CRC32 of the frames as stored; every frame read is checked against its own.
    """

    path: Path
    shape: tuple[int, int, int]
    crc: NDArray[np.uint32] | None = None
    kept: Kept | None = None

    def load(self, indices: NDArray[np.intp]) -> NDArray[np.uint8]:
        frames = np.empty((len(indices), *self.shape[1:]), np.uint8)
        with refusing(self.path, RecordingError, "its frames are damaged"), h5py.File(self.path, "r") as file:
            dataset = file["entry/frames/data"]
            for k, index in enumerate(indices):
                frames[k] = dataset[index]
                if self.crc is not None and zlib.crc32(frames[k]) != self.crc[index]:
                    raise RecordingError(f"{self.path}: frame {index} does not match its CRC: the file is damaged")
        return frames
