"""The contour that a camera's frame shows, apart from the way it is read (`drivers.aspiration.contour`)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from drivers.signals import FloatArray, Region

_CLEAR = 8  # px between an edge and the border of the region that it is said to lie in
_SURE = 0.5  # confidence from which an edge is believed to be where it was found


@dataclass(frozen=True)
class Contour:
    """The contour in one frame, in px of the frame.

    ``apex_column``, ``apex_row``, ``foot_row`` (where the bubble stands: the rim plane, or the neck above a needle);
    ``height`` from foot to apex and ``band`` (low, high) of it at GVT ± delta; ``profile`` (width,) the row of the edge
    in each column and ``sides`` (2, height) the columns of its left and right edge in each row, NaN for none.
    ``confidence`` 0 … 1; ``flags`` name findings: ``no_tissue``, ``noise``, ``cut_off``, ``reflections``,
    ``satellites``, ``gaps``, ``low_contrast``, ``border``.
    """

    gvt: float
    apex_column: float = np.nan
    apex_row: float = np.nan
    foot_row: float = np.nan
    height: float = np.nan
    band: tuple[float, float] = (np.nan, np.nan)
    profile: FloatArray = field(default_factory=lambda: np.empty(0), repr=False)
    sides: FloatArray = field(default_factory=lambda: np.empty((2, 0)), repr=False)
    confidence: float = 0.0
    flags: tuple[str, ...] = ()

    def outline(self) -> FloatArray:
        """The whole contour as points (n, 2) of column and row, from the left of the foot over the apex to its right.

        Overhanging and steep parts come from ``sides``, the cap from ``profile``.
        """
        if not np.isfinite(self.height):
            return np.empty((0, 2))
        rows = np.arange(self.sides.shape[1])
        below = (rows - self.apex_row) * np.sign(self.foot_row - self.apex_row)
        flank = (below > 0.3 * self.height) & (below <= self.height)
        order = np.argsort(-below[flank])
        left, right = (np.column_stack([side[flank], rows[flank]])[order] for side in self.sides)
        columns = np.arange(len(self.profile), dtype=float)
        on_cap = np.abs(self.profile - self.apex_row) <= 0.3 * self.height
        cap = np.column_stack([columns[on_cap], self.profile[on_cap]])
        points = np.vstack([left, cap, right[::-1]])
        known: FloatArray = points[np.isfinite(points).all(axis=1)]
        return known

    def within(self, region: Region) -> bool:
        """Whether the whole edge surely lies inside ``region``."""
        columns = np.flatnonzero(np.isfinite(self.profile))
        if self.confidence < _SURE or not len(columns):
            return False
        rows = self.profile[columns]
        return bool(
            region.left <= columns[0]
            and columns[-1] < region.left + region.width
            and region.top + _CLEAR <= rows.min()
            and rows.max() < region.top + region.height - _CLEAR
        )
