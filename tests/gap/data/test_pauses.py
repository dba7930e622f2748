"""A paused run is two: what was commanded around a pause is known to some tens of milliseconds only."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from acquire.recording.model import Event
from gap.data.pauses import SETTLED, continues, without_pauses
from gap.data.session import Session

TIME = np.arange(0.0, 30.0, 0.01)
TABLE = ([0.0, 2.0, 2.0, 8.0, 8.0, 14.0, 14.0, 24.0, 24.0], [0, 0, -3e4, -3e4, 0, 0, -3e4, -3e4, 0])
LOG = (Event(8.02, "info", "pause", "vented and held"), Event(14.01, "info", "resume", "resumed"))


def paused(recording, log=LOG):
    return replace(recording({"pressure": np.sin(TIME)}, TIME, {"pressure": TABLE}), events=log)


def test_a_paused_run_is_read_as_two(recording) -> None:
    first, second = without_pauses([paused(recording)])
    assert first.streams["pressure"].time[-1] < 8.02
    assert second.streams["pressure"].time[0] >= 14.01 + SETTLED
    assert first.info.id != second.info.id
    assert not continues(first)
    assert continues(second)  # nothing was zeroed anew


def test_the_command_rests_in_a_pause_and_is_itself_before_and_after(recording) -> None:
    session = Session(without_pauses([paused(recording)]))
    c = session.command("pressure", (0, 1))
    assert np.interp([5.0, 11.0, 20.0, 29.0], c.time, c.value).tolist() == [-3e4, 0.0, -3e4, 0.0]


def test_a_run_that_was_never_resumed_ends_at_its_pause(recording) -> None:
    (only,) = without_pauses([paused(recording, LOG[:1])])
    assert only.streams["pressure"].time[-1] < 8.02


def test_a_run_without_a_pause_is_left_as_it_is(recording) -> None:
    r = paused(recording, ())
    assert without_pauses([r]) == [r]
