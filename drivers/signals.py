"""What an instrument delivers: named channels, blocks of samples and camera frames.

Every sample carries three stamps: the device's sequence number, the device's own time and the host's monotonic time.
Values are SI; pressures are gauge pascals with suction negative.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


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
    """

    values: Mapping[str, FloatArray]
    seq: IntArray
    time: FloatArray
    time_host: FloatArray

    def __len__(self) -> int:
        return len(self.seq)


@dataclass(frozen=True)
class Frame:
    """One camera image (height, width) of 8 bit grey, with the same three stamps as a sample."""

    image: NDArray[np.uint8]
    seq: int
    time: float
    time_host: float
