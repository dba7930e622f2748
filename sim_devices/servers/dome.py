"""A plain picture of the tissue bubble from the side: a bright dome above a bright base, before a dark background."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


class Dome:
    """Renders (height, width) images of 8 bit at ``scale`` m per pixel; the base is ``margin`` px above the lower edge."""

    def __init__(self, size: tuple[int, int] = (640, 480), scale: float = 2e-5, opening: float = 8e-3) -> None:
        width, self._rows = size[0], size[1]
        self._scale = scale
        x = (np.arange(width) - (width - 1) / 2) * scale / (opening / 2)
        self._shape = np.clip(1 - x**2, 0, None)
        self._base = round(0.9 * size[1])
        self._row = np.arange(size[1])[:, None]

    def __call__(self, apex_height: float, time: float = 0.0) -> NDArray[np.uint8]:
        """The image for an apex ``apex_height`` m above the base."""
        top = self._base - apex_height / self._scale * self._shape
        covered = np.clip(self._row - top + 0.5, 0, 1)
        return (30 + 180 * covered).astype(np.uint8)
