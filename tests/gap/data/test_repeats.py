"""Values that come again, against chance."""

from __future__ import annotations

import numpy as np
import pytest

from acquire.recording.model import Series
from gap.data.repeats import held_values


def suction(step: float, stuck: bool) -> Series:
    """Suction in levels, Pa, with noise of 25 Pa on a grid of ``step`` Pa; ``stuck`` for .6 s before some changes."""
    rng = np.random.default_rng(0)
    time = np.arange(0.0, 300.0, 0.01)
    level = 2e3 * np.sin(np.floor(time / 2.0))
    value = np.round((level + 25.0 * rng.normal(size=len(time))) / step) * step
    if stuck:
        for change in np.flatnonzero(np.diff(level))[::10]:
            value[change - 60 : change + 1] = value[change - 60]
    return Series(time=time, value=value, unit="Pa")


@pytest.mark.parametrize(("step", "stuck", "told"), [(100.0, False, False), (1.0, False, False), (1.0, True, True)])
def test_a_coarse_channel_stands_until_its_command_goes_on(step: float, stuck: bool, told: bool) -> None:
    """A sound height beside a gauge of 1 mbar was told dropped samples for certain (seed 670154)."""
    runs, nats = held_values([suction(step, stuck)])
    assert bool(runs > 3 and nats > 20.0) is told
    assert runs == 0 or told
