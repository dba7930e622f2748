"""Which pixels of a camera's frames are kept: those of a region in most of them, all of them now and then.

Most of a recording would be noise on the wall behind the tissue. So a run may name the region in which the tissue's
edge can be. That is kept of every frame, without loss; the rest of the picture is kept in whole frames: the first, one
in every `WHOLE_EVERY` seconds, and each in which the edge does not surely lie inside.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.signals import Frame, Region

WHOLE_EVERY = 10.0  # s of device time


class Keeper:
    """Says of each frame of a run, in the order of their coming, how much of it is kept."""

    def __init__(self, region: Region | None) -> None:
        self._region = region
        self._whole = math.nan  # device time of the last frame that was due to be whole

    def whole(self, frame: Frame) -> bool:
        """Whether all of ``frame`` is to be kept, not only its region."""
        if self._region is None:
            return True
        if not 0 <= frame.time - self._whole < WHOLE_EVERY:
            self._whole = frame.time
            return True
        inside = frame.contour is not None and frame.contour.within(self._region)
        return not inside or not self._region.fits(frame.image.shape)


@dataclass(frozen=True, eq=False)
class Kept:
    """The kept part of a recording's frames: the ``region`` of each, and all of those that are ``whole`` (n,)."""

    region: Region
    whole: NDArray[np.bool_]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Kept) and self.region == other.region and np.array_equal(self.whole, other.whole)

    __hash__ = None  # type: ignore[assignment]

    @property
    def words(self) -> str:
        """The same in words."""
        r = self.region
        return (
            f"columns {r.left} to {r.left + r.width - 1} and rows {r.top} to {r.top + r.height - 1} of every frame are "
            f"kept without loss, and all of {np.count_nonzero(self.whole)} of {len(self.whole)} frames; elsewhere the "
            "pixels shown are those of the last whole frame"
        )

    def take(self, indices: NDArray[np.intp]) -> Kept:
        """The same of the frames at ``indices``."""
        return Kept(self.region, self.whole[indices])

    def around(self, index: int) -> int:
        """The whole frame that shows the part of frame ``index`` that is not kept; -1 where there is none."""
        wholes = np.flatnonzero(self.whole)
        before = int(np.searchsorted(wholes, index, side="right")) - 1
        return int(wholes[max(before, 0)]) if len(wholes) else -1
