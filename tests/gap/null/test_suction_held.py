"""Recordings that begin under suction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from acquire.recording.model import Recording, Series
from gap.inference.least_squares import fit
from gap.null.groups import GroupedSession
from tests.gap.null.test_suction_blocks import blocks, session


def begun_later(recording: Recording, begin: float) -> Recording:
    """A recording from ``begin`` s after its first sample on, whose height counts from then."""
    first = min(float(s.time[0]) for s in recording.streams.values()) + begin

    def cut(name: str, series: Series) -> Series:
        kept = series.time >= first
        value = series.value[kept]
        return replace(series, time=series.time[kept], value=value - (value[0] if name == "apex_height" else 0.0))

    command = recording.setpoints["pressure"]
    kept = command.time > first
    level = np.interp(first, command.time, command.value)
    table = replace(command, time=np.r_[first, command.time[kept]], value=np.r_[level, command.value[kept]])
    streams = {name: cut(name, series) for name, series in recording.streams.items()}
    return replace(recording, streams=streams, setpoints={"pressure": table})


def test_suction_that_acts_before_the_first_sample_has_acted_for_a_while() -> None:
    """The regulator was simulated from the air's pressure, and the height's zero taken under suction was told an offset
    of .75 mm."""
    whole = session()
    for cut in (0, 1):
        recordings = [begun_later(r, 6.0) if k == cut else r for k, r in enumerate(whole)]
        grouped = GroupedSession(recordings, ("pressure",))
        assert [grouped.begins_under_suction(k) for k in range(3)] == [k == cut for k in range(3)]
        for block in blocks(recordings):
            null = fit(block, iterations=40)
            assert null.chi2 / len(null.residual) < 1.25
            assert null.penalty < 60.0


def test_suction_before_the_first_sample_may_begin_from_the_air() -> None:
    """A table that tells when the suction began, before the first sample: its first row is nought, and the zero of the
    height that was taken under suction was told an offset of .11 mm."""
    whole = session()
    cut = begun_later(whole[0], 6.0)
    command = replace(cut, setpoints=whole[0].setpoints)
    grouped = GroupedSession([command, *whole[1:]], ("pressure",))
    assert [grouped.begins_under_suction(k) for k in range(3)] == [True, False, False]


def test_a_zero_that_is_taken_once_leaves_what_earlier_suction_left() -> None:
    """Readings of 10 to 25 um before each recording's first suction strained the zeroes by 900."""
    off = (0.0, 12e-6, 20e-6)
    recordings = [
        replace(r, streams=r.streams | {"apex_height": replace(h, value=h.value + more)})
        for r, more in zip(session(), off, strict=True)
        for h in [r.streams["apex_height"]]
    ]
    *_, height = blocks(recordings)
    for k, more in enumerate(off):
        assert max(more - 1.1e-5, 0.0) <= height.read_at_rest(k) <= more + 1e-6
    null = fit(height, iterations=40)
    assert null.chi2 / len(null.residual) < 1.25
    assert null.penalty < 60.0
