"""Camera frames from image files and films, as a lab exports them."""

from __future__ import annotations

import re
import struct
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acquire.recording.lazy import LazyFrames
from acquire.recording.model import RecordingError
from protocols.files import contents, inside, is_file, refusing

FILMS = (".avi", ".mp4")
IMAGES = (".png", ".tif", ".tiff")
MAX_PIXELS = 2**24
MAX_IMAGE_BYTES = 2**27
_TIFF_WIDTH, _TIFF_HEIGHT, _TIFF_SHORT = 256, 257, 3
MAX_FILM_BYTES = 2**32


@dataclass(frozen=True)
class ImageFiles(LazyFrames):
    """One grey frame per image file, read when asked for."""

    paths: tuple[Path, ...]
    shape: tuple[int, int, int]

    def load(self, indices: NDArray[np.intp]) -> NDArray[np.uint8]:
        frames = np.empty((len(indices), *self.shape[1:]), np.uint8)
        for k, index in enumerate(indices):
            image = read_image(self.paths[index])
            if image.shape != self.shape[1:]:
                height, width = self.shape[1:]
                size = f"{image.shape[1]}x{image.shape[0]} pixels; the first frame has {width}x{height}"
                raise RecordingError(f"{self.paths[index]}: {size}")
            frames[k] = image
        return frames


@dataclass
class Film(LazyFrames):
    """The frames of a film, decoded when asked for: one after the other quickly, earlier ones from the beginning on."""

    path: Path
    shape: tuple[int, int, int]
    _frames: Iterator[NDArray[np.uint8]] = field(default_factory=lambda: iter(()), repr=False)
    _next: int = sys.maxsize  # index of the frame that `_frames` gives next

    def load(self, indices: NDArray[np.intp]) -> NDArray[np.uint8]:
        frames = np.empty((len(indices), *self.shape[1:]), np.uint8)
        for k, index in enumerate(indices):
            if index < self._next:
                self._frames, self._next = _film(self.path), 0
            for image in self._frames:
                self._next += 1
                if self._next > index:
                    frames[k] = image
                    break
            else:
                raise RecordingError(f"{self.path}: frame {index} is no longer there")
        return frames


def find_frames(folder: Path, pattern: str) -> Any:
    """Frames (n, height, width) of uint8 of the files in ``folder`` that match ``pattern``, in natural order.

    Raises RecordingError: nothing matches, a file outside the folder, of an unknown kind, or not of the first's size.
    """
    if Path(pattern).is_absolute() or ".." in Path(pattern).parts:
        raise RecordingError(f"{folder}: frames {pattern!r} must lie in the bundle")
    with refusing(folder, RecordingError, f"frames {pattern!r}"):
        paths = sorted((path for path in folder.glob(pattern) if is_file(path)), key=_natural)
    if not paths:
        raise RecordingError(f"{folder}: frames: no file matches {pattern!r}")
    for path in paths:
        if path.suffix.lower() not in FILMS + IMAGES:
            raise RecordingError(f"{path}: frames are {', '.join(IMAGES + FILMS)}, not {path.suffix or 'a bare name'}")
        with refusing(folder, RecordingError, "frames"):
            inside(folder, str(path.relative_to(folder)))
    frames: LazyFrames
    if paths[0].suffix.lower() in FILMS:
        if len(paths) > 1:
            raise RecordingError(f"{folder}: frames {pattern!r} match {len(paths)} films; one is needed")
        sizes = [image.shape for image in _film(paths[0])]
        frames = Film(paths[0], (len(sizes), *sizes[0]))
    else:
        frames = ImageFiles(tuple(paths), (len(paths), *read_image(paths[0]).shape))
        for _ in frames:  # a frame that cannot be read is a fault of the bundle now, not of the analysis later
            pass
    return frames


def read_image(path: Path) -> NDArray[np.uint8]:
    """One image as 8-bit grey (height, width); 16 bit are reduced by their upper byte. Raises RecordingError."""
    import cv2

    with refusing(path, RecordingError, "not a readable image"):
        raw = contents(path, MAX_IMAGE_BYTES)
        pixels = _claimed(raw)
        if pixels > MAX_PIXELS:
            raise RecordingError(f"{path}: {pixels} pixels are more than {MAX_PIXELS}")
        image = cv2.imdecode(np.frombuffer(raw, np.uint8), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH)
    if image is None:
        raise RecordingError(f"{path}: not a readable image")
    if image.dtype == np.uint16:
        image = np.right_shift(image, 8, dtype=np.uint16).astype(np.uint8)
    if image.dtype != np.uint8:
        raise RecordingError(f"{path}: {image.dtype} pixels; 8 or 16 bit are read")
    return np.asarray(image)


def _claimed(raw: bytes) -> int:
    """Pixels that a PNG or TIFF says it has: known before anything is unpacked. Raises ValueError, struct.error."""
    if raw.startswith(b"\x89PNG\r\n\x1a\n"):
        width, height = struct.unpack_from(">II", raw, 16)
        return int(width * height)
    if raw[:4] not in (b"II*\0", b"MM\0*"):
        raise ValueError("neither PNG nor TIFF")
    order = "<" if raw[:2] == b"II" else ">"
    (at,) = struct.unpack_from(order + "I", raw, 4)
    (count,) = struct.unpack_from(order + "H", raw, at)
    size = {_TIFF_WIDTH: 0, _TIFF_HEIGHT: 0}
    for entry in range(at + 2, at + 2 + 12 * count, 12):
        tag, kind = struct.unpack_from(order + "HH", raw, entry)
        if tag in size:
            size[tag] = struct.unpack_from(order + ("H" if kind == _TIFF_SHORT else "I"), raw, entry + 8)[0]
    return size[_TIFF_WIDTH] * size[_TIFF_HEIGHT]


def _film(path: Path) -> Iterator[NDArray[np.uint8]]:
    import cv2

    with path.open("rb") as file:
        head = file.read(12)
    # By its first bytes alone a decoder would also take a play list, which names other files and hosts.
    if not (head.startswith(b"RIFF") and head.endswith(b"AVI ")) and head[4:8] != b"ftyp":
        raise RecordingError(f"{path}: neither AVI nor MP4")
    film = cv2.VideoCapture(str(path))
    shape: tuple[int, ...] = ()
    size = 0
    try:
        while True:
            with refusing(path, RecordingError, "not a readable film"):
                there, image = film.read()
                if not there:
                    break
                grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if image.ndim == 3 else image
            shape = shape or grey.shape
            size += grey.nbytes
            if size > MAX_FILM_BYTES or grey.size > MAX_PIXELS:
                raise RecordingError(f"{path}: unpacks to more than {MAX_FILM_BYTES // 2**30} GB")
            if grey.shape != shape:
                raise RecordingError(f"{path}: its frames are not of one size")
            yield np.asarray(grey)
    finally:
        film.release()
    if not size:
        raise RecordingError(f"{path}: not a readable film")


def _natural(path: Path) -> list[Any]:
    """A key that puts ``img_2`` before ``img_10``."""
    return [int(part) if k % 2 else part for k, part in enumerate(re.split(r"([0-9]+)", str(path)))]
