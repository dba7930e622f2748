"""The data of an instrument: named channels, blocks of samples and camera frames.

Every sample carries three stamps: the device's sequence number, the device's own time and the host's monotonic time.
Values are SI; pressures are gauge pascals with suction negative.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from drivers.contour import Contour

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
#: Appended to the first gauge's name for the second one.
REFERENCE = "_reference"


@dataclass(frozen=True)
class Channel:
    """One measured quantity. ``stage`` names the stage of the forward chain that it observes.

    ``range`` and ``resolution`` are in ``unit`` (always SI: ``Pa``, ``m``, ``N``, ``V``).
    """

    name: str
    unit: str
    stage: str
    range: tuple[float, float] = (-np.inf, np.inf)
    resolution: float = 0.0


@dataclass(frozen=True)
class Block:
    """Consecutive samples of several channels that share their time stamps.

    ``values`` maps channel name to an array of shape (n,); ``seq`` (n,) counts samples on the device, so that a
    gap in it is a lost sample; ``time`` (n,) is device time in s; ``time_host`` (n,) is ``time.monotonic()`` in s.

    Samples are handed on as they arrived. One is *new* if its ``seq`` and its ``time`` are both higher than those of
    every sample before it; any other is a repeated or late one (`new_samples`): it may be kept, but it is no sign of
    life, and nothing may be concluded from its value.
    """

    values: Mapping[str, FloatArray]
    seq: IntArray
    time: FloatArray
    time_host: FloatArray

    def __len__(self) -> int:
        return len(self.seq)

    def new_samples(self, seq: int, time: float) -> NDArray[np.bool_]:
        """Which samples (n,) are new after one numbered ``seq`` at device time ``time`` (s)."""
        seqs = np.maximum.accumulate(np.append(np.int64(seq), self.seq))[:-1]
        times = np.maximum.accumulate(np.append(float(time), self.time))[:-1]
        return (self.seq > seqs) & (self.time > times)

    def where(self, chosen: NDArray[np.bool_]) -> Block:
        """The ``chosen`` (n,) samples only."""
        values = {name: v[chosen] for name, v in self.values.items()}
        return Block(values, self.seq[chosen], self.time[chosen], self.time_host[chosen])


@dataclass(frozen=True)
class Region:
    """A rectangle of an image in px: columns from ``left``, rows from ``top``. Raises ValueError for an empty one."""

    left: int
    top: int
    width: int
    height: int

    def __post_init__(self) -> None:
        if min(self.left, self.top) < 0 or min(self.width, self.height) < 1:
            raise ValueError(f"{self} is no region of an image")

    @property
    def place(self) -> tuple[slice, slice]:
        """Its rows and columns, to index an image with."""
        return slice(self.top, self.top + self.height), slice(self.left, self.left + self.width)

    def fits(self, shape: tuple[int, ...]) -> bool:
        """Whether it lies inside an image of ``shape`` (height, width)."""
        return self.top + self.height <= shape[0] and self.left + self.width <= shape[1]

    def cut(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """``image`` (height, width) with zeros outside."""
        cut = np.zeros_like(image)
        cut[self.place] = image[self.place]
        return cut


@dataclass(frozen=True)
class Frame:
    """One camera image (height, width) of 8 bit grey, with the same three stamps as a sample.

    ``contour`` was read in it when it came; None where nobody looked.
    """

    image: NDArray[np.uint8]
    seq: int
    time: float
    time_host: float
    contour: Contour | None = None
