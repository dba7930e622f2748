"""Recordings of the robot that begin away from the centre: skin has crept by then."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from acquire.recording.model import Recording
from gap.data.session import HELD
from gap.design import simulated as own
from gap.inference.least_squares import fit
from gap.null.groups import GroupedSession
from gap.null.robot_axes import QUANTITIES, AxesBlock
from gap.null.robot_force import ForceBlock

BEGIN = 0.5  # s at which the legs' probe arrives where it stands
LATER = 13.0  # s of rest behind them, so that half of what is not recorded is longer than `HELD`


def standing(size: float) -> own.Leg:
    """The probe goes aside by ``size`` m, stands there for `HELD`, cycles about there, and is at rest for `LATER`."""
    cycles = BEGIN + HELD + np.arange(0.0, 9.0)
    time = np.r_[0.0, BEGIN, BEGIN, cycles, cycles[-1] + 0.1, cycles[-1] + LATER]
    path = size * np.r_[0.0, 0.0, 1.0, 1.0, np.tile([0.4, 1.0], 4), 0.0, 0.0]
    still = np.zeros(len(time))
    return own.Leg({"probe_x": (time, path), "probe_y": (time, 0.5 * path), "probe_z": (time, still)}, float(time[-1]))


def cut(recording: Recording, begin: float) -> Recording:
    """10 s of a recording from ``begin`` s after its first sample on, with the command's rows there."""
    first = min(float(s.time[0]) for s in recording.streams.values()) + begin
    streams = {}
    for name, s in recording.streams.items():
        kept = (s.time >= first) & (s.time < first + 10.0)
        streams[name] = replace(s, time=s.time[kept], value=s.value[kept], seq=None)
    rows = {}
    for name, s in recording.setpoints.items():
        kept = (s.time > first) & (s.time < first + 10.0)
        level = float(np.interp(first, s.time, s.value))
        rows[name] = replace(s, time=np.r_[first, s.time[kept]], value=np.r_[level, s.value[kept]], seq=None)
    return replace(recording, streams=streams, setpoints=rows, segments=())


def test_skin_has_crept_where_a_recording_begins_aside() -> None:
    """An outside author's circles, begun after 10 s away from the centre, left a gap of 50 on sound skin: the skin was
    simulated from the first sample on, and between recordings as if the probe went slowly from one to the next."""
    whole = own.robot_session(np.random.default_rng(5), [], legs=[standing(1e-3), standing(-0.8e-3), standing(1e-3)])
    recordings = [cut(recording, BEGIN + HELD - 1e-9) for recording in whole]
    session = GroupedSession(recordings, QUANTITIES)
    block = ForceBlock(session, {}, AxesBlock(session, {}))
    time, height = block._axes[0]["axis_1"]
    begin, end, again = session.span(0)[0], session.span(0)[1], session.span(1)[0]
    there, centre, before = np.interp([begin, end + 3.0, begin - 0.9 * HELD], time, height)
    assert abs(there) > 0.5e-3
    assert before == pytest.approx(there, abs=1e-5)
    assert np.interp(begin - 1.1 * HELD, time, height) == pytest.approx(centre, abs=1e-5)
    assert abs(centre) < 1e-5
    assert np.interp(again - 0.9 * HELD, time, height) == pytest.approx(np.interp(again, time, height), abs=1e-5)
    found = fit(block, nuisance=block.start())
    assert found.chi2 < 1.3 * len(found.residual)
