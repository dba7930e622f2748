"""Paused runs: what was commanded around a pause is known to some tens of milliseconds only, so such a run is read as
two, without what lies about the pause."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from acquire.recording.model import Recording, Series
from sim_devices.chain import FloatArray

PAUSE, RESUME = "pause", "resume"
"""Codes of the events that a log has of it."""
GUARD = 0.1
"""s before a pause that are left out: events are as late as the host that writes them."""
SETTLED = 1.0
"""s after a run was resumed that are left out: the step's moment, off by 30 ms, still moves a creeping channel."""
FEWEST = 20
"""Samples of a channel below which a part of a run says nothing."""


def without_pauses(recordings: Sequence[Recording]) -> list[Recording]:
    """The recordings in their order, those with a pause in their log as one for each part between pauses."""
    return [part for r in recordings for part in _parts(r)]


def continues(recording: Recording) -> bool:
    """Whether a recording is what followed a pause: nothing was armed or zeroed anew at its beginning."""
    begin = min((float(s.time[0]) for s in recording.streams.values() if len(s.time)), default=-np.inf)
    return any(RESUME in e.code.lower() and e.time < begin for e in recording.events)


def _parts(recording: Recording) -> Iterator[Recording]:
    pauses = list(_pauses(recording))
    if not pauses:
        yield recording
        return
    begin, first = -np.inf, -np.inf
    number = 1
    for stop, again in [*pauses, (np.inf, np.inf)]:
        part = _cut(recording, begin, stop - GUARD, first, number)
        if any(len(s.time) >= FEWEST for s in part.streams.values()):
            yield part
            number += 1
        first, begin = stop + GUARD, again + SETTLED


def _pauses(recording: Recording) -> Iterator[tuple[float, float]]:
    """When the run was paused and resumed, s; never, where it was not resumed."""
    stop: float | None = None
    for event in sorted(recording.events, key=lambda e: e.time):
        code = event.code.lower()
        if PAUSE in code and stop is None:
            stop = event.time
        elif RESUME in code and stop is not None:
            yield stop, event.time
            stop = None
    if stop is not None:
        yield stop, np.inf


def _cut(recording: Recording, begin: float, end: float, first: float, number: int) -> Recording:
    """A part of a recording: samples from ``begin`` to ``end`` s, set-points from ``first`` on."""
    streams = {}
    for name, s in recording.streams.items():
        inside = (s.time >= begin) & (s.time <= end)
        if np.any(inside):
            host = None if s.time_host is None else s.time_host[inside]
            seq = None if s.seq is None else s.seq[inside]
            streams[name] = replace(s, value=s.value[inside], time=s.time[inside], time_host=host, seq=seq)
    info = replace(recording.info, id=f"{recording.info.id} part {number}" if number > 1 else recording.info.id)
    segments = tuple(s for s in recording.segments if s.end > first and s.begin < end)
    setpoints = {name: _between(s, first, end, GUARD) for name, s in recording.setpoints.items()}
    return replace(
        recording, info=info, streams=streams, setpoints=setpoints, segments=segments, frames=None, derived={}
    )


def _between(table: Series, first: float, last: float, beyond: float) -> Series:
    """The rows of a table of set-points from ``first`` to ``last`` s, with a row at each end: the last one ``beyond`` s
    later, on the same straight line. A line to what follows the pause would begin before it, and a record whose stamps
    are late would show it."""
    time, value = np.asarray(table.time, dtype=float), np.asarray(table.value, dtype=float)
    if not len(time):
        return table
    inside = (time > first) & (time < last)
    times, values = [time[inside]], [value[inside]]
    if time[0] < first < time[-1]:
        times, values = [np.array([first]), *times], [np.interp([first], time, value), *values]
    if time[0] < last < time[-1]:
        k = int(np.searchsorted(time, last))
        slope = (value[k] - value[k - 1]) / (time[k] - time[k - 1])
        times.append(np.array([last + beyond]))
        values.append(np.array([value[k - 1] + slope * (last + beyond - time[k - 1])]))
    at: FloatArray = np.concatenate(times)
    return replace(table, time=at, value=np.concatenate(values), time_host=None, seq=None)
