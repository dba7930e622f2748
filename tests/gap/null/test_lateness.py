"""How late the robot's axes answer their set-points."""

from __future__ import annotations

import numpy as np
import pytest

from acquire.recording.model import Recording
from gap.data.rhythms import looks
from gap.design import simulated as own
from gap.design.simulated import Leg
from gap.inference.least_squares import fit
from gap.null.groups import GroupedSession
from gap.null.robot_axes import AXES, QUANTITIES, AxesBlock
from gap.search.starts import AGREED
from sim_devices.stages.axes import AxisLoop

NOISE = 4e-6  # m


def stepped(seed: int) -> Leg:
    """A set-point that jumps along z now and then."""
    rng = np.random.default_rng(seed)
    moments = 0.5 + np.cumsum(rng.uniform(0.45, 0.75, 24))
    levels = 2e-4 * np.resize([1.0, -0.5, 0.5, -1.0], 24)
    time = np.concatenate([[0.0], np.repeat(moments, 2), [moments[-1] + 1.0]])
    value = np.concatenate([[0.0, 0.0], np.repeat(levels, 2)])
    return Leg({q: (time, value * (q == "probe_z")) for q in QUANTITIES}, float(time[-1]))


def look_at(recording: Recording, interval: float, rng: np.random.Generator) -> None:
    """Move the axes of a recording by what its controllers find that look at the set-point each ``interval`` s from the
    recording's start, along z, where all of them do the same."""
    table, stamps = recording.setpoints["probe_z"], recording.streams[AXES[0]].time
    fine = np.arange(0.0, stamps[-1] + 1e-3, 2.5e-4)
    seen = table.time[0] + interval * np.floor((fine - table.time[0]) / interval) if interval else fine
    asked = table.value[np.searchsorted(table.time, seen + 1e-9, side="right") - 1]
    loop = AxisLoop("axes", "actuator", ("target_1", "load_1"), ("axis_1",))
    signals = {"target_1": np.asarray(asked, dtype=float)}
    loop.advance(loop.fresh(), fine, signals)
    for name in AXES:
        position = np.interp(stamps, fine, signals["axis_1"])
        recording.streams[name].value[:] = position + NOISE * rng.normal(size=len(stamps))


def axes(interval: float) -> AxesBlock:
    recordings = own.robot_session(np.random.default_rng(3), legs=[stepped(k) for k in range(2)])
    for k, r in enumerate(recordings):
        look_at(r, interval, np.random.default_rng(k))
        for name in r.streams.keys() - set(AXES):  # nothing is touched
            r.streams[name].value[:] = 1e-3 * np.random.default_rng(k).normal(size=len(r.streams[name].value))
    return AxesBlock(GroupedSession(recordings, QUANTITIES), {})


def test_looks_at_the_set_points_are_told_by_how_late_each_is_answered() -> None:
    """Looks each 9 ms from the start of each recording were told lost samples: no ripple of the axes is as quick."""
    block = axes(0.009)
    late = block.lateness(fit(block))
    assert late is not None
    assert np.sum(late.steps & (late.sd < 1e-3)) > 30
    found, _, share = looks(late)[0]
    assert found == pytest.approx(0.009, rel=2e-4)
    assert share > AGREED


def test_sound_axes_show_no_looks() -> None:
    block = axes(0.0)
    late = block.lateness(fit(block))
    assert late is None or all(share < AGREED for _, _, share in looks(late))
