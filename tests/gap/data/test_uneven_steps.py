"""Converters whose steps are of two sizes, in channels with hardly any noise."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from acquire.recording.model import Recording
from gap.data.signatures import find


@pytest.mark.parametrize(("sizes", "certain"), [((13.28, 27.58), True), ((13.28, 13.28), False)])
def test_two_sizes_that_come_again_are_the_converters(
    recording: Callable[..., Recording], sizes: tuple[float, float], certain: bool
) -> None:
    """Of six blind cases of uneven steps three were undetectable: no noise visited their levels, which a command might
    have chosen."""
    time = np.arange(0.0, 40.0, 0.02)
    height = 2000.0 * np.interp(time, [0, 2, 8, 20, 26, 40], [0, 0, 1.0, 1.05, 0, 0])
    levels = np.r_[0.0, np.cumsum(np.tile(sizes, 60))]
    coarse = levels[np.searchsorted(levels, height, side="right") - 1]
    read = np.round(coarse + 0.001 * np.random.default_rng(1).normal(size=len(time)), 2)
    found = find([recording({"apex_height": 1e-6 * read}, time)])
    assert any(s.effect == "sensor_quantisation" and s.certain for s in found) is certain
