"""Camera frames from image files and films, as a lab exports them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acquire.recording.lazy import LazyFrames
from acquire.recording.model import RecordingError

FILMS = (".avi", ".mp4")
IMAGES = (".png", ".tif", ".tiff")
MAX_PIXELS = 2**26
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


def find_frames(folder: Path, pattern: str) -> Any:
    """Frames (n, height, width) of uint8 of the files in ``folder`` that match ``pattern``, in natural order.

    Raises RecordingError: nothing matches, a file outside the folder, of an unknown kind, or not of the first's size.
    """
    if Path(pattern).is_absolute() or ".." in Path(pattern).parts:
        raise RecordingError(f"{folder}: frames {pattern!r} must lie in the bundle")
    paths = sorted((path for path in folder.glob(pattern) if path.is_file()), key=_natural)
    if not paths:
        raise RecordingError(f"{folder}: frames: no file matches {pattern!r}")
    for path in paths:
        if path.suffix.lower() not in FILMS + IMAGES:
            raise RecordingError(f"{path}: frames are {', '.join(IMAGES + FILMS)}, not {path.suffix or 'a bare name'}")
        if not path.resolve().is_relative_to(folder.resolve()):
            raise RecordingError(f"{path}: lies outside the bundle")
    if paths[0].suffix.lower() in FILMS:
        if len(paths) > 1:
            raise RecordingError(f"{folder}: frames {pattern!r} match {len(paths)} films; one is needed")
        return np.stack(list(_film(paths[0])))
    frames = ImageFiles(tuple(paths), (len(paths), *read_image(paths[0]).shape))
    for _ in frames:  # a frame that cannot be read is a fault of the bundle now, not of the analysis later
        pass
    return frames


def read_image(path: Path) -> NDArray[np.uint8]:
    """One image as 8-bit grey (height, width); 16 bit are reduced by their upper byte. Raises RecordingError."""
    import cv2

    raw = np.frombuffer(path.read_bytes(), np.uint8)
    try:
        image = cv2.imdecode(raw, cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH) if len(raw) else None
    except cv2.error as error:
        raise RecordingError(f"{path}: not a readable image: {error}") from error
    if image is None:
        raise RecordingError(f"{path}: not a readable image")
    if image.size > MAX_PIXELS:
        raise RecordingError(f"{path}: {image.size} pixels are more than {MAX_PIXELS}")
    if image.dtype == np.uint16:
        image = np.right_shift(image, 8, dtype=np.uint16).astype(np.uint8)
    if image.dtype != np.uint8:
        raise RecordingError(f"{path}: {image.dtype} pixels; 8 or 16 bit are read")
    return np.asarray(image)


def _film(path: Path) -> Iterator[NDArray[np.uint8]]:
    import cv2

    film = cv2.VideoCapture(str(path))
    size = 0
    try:
        while True:
            there, image = film.read()
            if not there:
                break
            grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if image.ndim == 3 else image
            size += grey.nbytes
            if size > MAX_FILM_BYTES:
                raise RecordingError(f"{path}: unpacks to more than {MAX_FILM_BYTES // 2**30} GB")
            yield np.asarray(grey)
    finally:
        film.release()
    if not size:
        raise RecordingError(f"{path}: not a readable film")


def _natural(path: Path) -> list[Any]:
    """A key that puts ``img_2`` before ``img_10``."""
    return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", str(path))]
