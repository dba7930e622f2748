"""The apex height while frames come: one contour a frame, all at the threshold that is in use."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from drivers.aspiration.contour import Image, Pipeline, Settings, compile_kernels
from drivers.contour import Contour
from drivers.signals import Region

_SURE = 0.5  # confidence from which a proposed GVT is used live, and a contour shows where the rim is
_AROUND = 24  # px kept above and below all that the edge can reach: beyond the band, so that other GVTs can be tried
_WORTH = 0.85  # of a frame: a region larger than that saves nothing


class LiveApex:
    """Measures frames as they come: call it with an image to get the displacement of the apex in m.

    The first frame with a sure GVT gives the light and the initial height; before that, and where there is no contour,
    the result is NaN. ``latest`` is the last contour, for the overlay; `reset` begins anew. ``scale`` is in m/px.
    `use` and `rest` may be called from any thread; they take effect at the next frame.
    """

    def __init__(self, scale: float, settings: Settings | None = None) -> None:
        if not scale > 0:
            raise ValueError(f"the scale must be positive, not {scale}")
        self._scale = scale
        self._own = self._asked = self._used = settings or Settings()
        self._rests = self._rested = 0
        compile_kernels()
        self.reset()

    @property
    def settings(self) -> Settings:
        """How frames are read, with the GVT in use; it is None while no proposal is sure."""
        asked, pipeline = self._asked, self.pipeline
        if asked.gvt is None and asked is self._used and pipeline is not None and pipeline.gvt_confidence >= _SURE:
            return replace(asked, gvt=pipeline.gvt)
        return asked

    @property
    def proposes(self) -> bool:
        """Whether the GVT is proposed, not set."""
        return self._asked.gvt is None

    @property
    def looked(self) -> bool:
        """Whether a frame was read with the latest settings."""
        return self._used is self._asked and self.latest is not None

    def region(self, highest: float) -> Region | None:
        """Where in a frame the edge can be while the apex is at most ``highest`` m above the rim, by the last contour.

        It has every column, because the rim on both sides shows where the tissue stands. None where no contour is sure
        yet, and where little would be outside.
        """
        contour = self.latest
        if contour is None or contour.confidence < _SURE or not self.looked:
            return None
        shape = contour.sides.shape[1], len(contour.profile)
        up = self._used.apex == "up"
        reached = contour.foot_row - (highest if up else -highest) / self._scale
        top = max(0, math.floor(min(reached, np.nanmin(contour.profile))) - _AROUND)
        bottom = min(shape[0], math.ceil(max(reached, np.nanmax(contour.profile))) + _AROUND + 1)
        return Region(0, top, shape[1], bottom - top) if bottom - top < _WORTH * shape[0] else None

    def use(self, gvt: float | None) -> None:
        """Read the frames that follow at another GVT, None for that of the settings, and take their heights anew."""
        asked = self._own if gvt is None else replace(self._own, gvt=gvt)
        if asked.gvt != self._asked.gvt:
            self._asked = asked

    def rest(self) -> None:
        """The next frame shows the tissue at rest: heights count from there."""
        self._rests += 1

    def reset(self) -> None:
        """Forget light, GVT and initial height (the tissue or the lamp was moved)."""
        self.pipeline: Pipeline | None = None
        self.latest: Contour | None = None
        self._rest_row = np.nan

    def __call__(self, image: Image) -> float:
        if self._used is not self._asked:
            self._used = self._asked
            self.reset()
        if self._rested != self._rests:
            self._rested, self._rest_row = self._rests, np.nan
        if self.pipeline is None or self.pipeline.gvt_confidence < _SURE:
            self.pipeline = Pipeline.prepare([image], self._used)
        self.latest = self.pipeline.measure(image)
        if self.pipeline.gvt_confidence < _SURE:
            return np.nan
        if np.isnan(self._rest_row):
            self._rest_row = self.latest.apex_row
        sign = 1.0 if self._used.apex == "up" else -1.0
        return float(sign * (self._rest_row - self.latest.apex_row) * self._scale)
