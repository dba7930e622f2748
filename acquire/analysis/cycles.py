"""Where suction begins, is released and ends in a recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from acquire.recording.model import FloatArray, Recording, SegmentRecord, Series


@dataclass(frozen=True)
class Cycle:
    """One suction and its release. Times in s on the recording's clock, ``level`` the strongest suction, Pa (negative).

    ``onset`` is the last moment without suction, ``release`` the last at (nearly) full suction, ``end`` where the next
    cycle or nothing follows. ``rise`` and ``fall`` are how long going to the level and back takes: 0 for a step.
    """

    onset: float
    release: float
    end: float
    level: float
    rise: float
    fall: float


def suction_cycles(recording: Recording) -> tuple[Cycle, ...]:
    """Cycles of suction as commanded: by the recorded segments, else by the set-points, else by the measured pressure.

    Empty without any of them.
    """
    commanded = recording.setpoints.get("pressure")
    if any("pressure" in segment.start for segment in recording.segments):
        cycles = commanded_cycles(recording.segments)
    elif commanded is not None and len(commanded.time):
        cycles = find_cycles(commanded, threshold=0.02)
    elif "pressure" in recording.streams:
        cycles = find_cycles(recording.streams["pressure"], threshold=0.10)
    else:
        return ()
    last = max((float(s.time[-1]) for s in recording.streams.values() if len(s.time)), default=np.inf)
    if cycles and last > cycles[-1].release:
        cycles = (*cycles[:-1], _until(cycles[-1], last))
    return cycles


def onset(recording: Recording) -> float:
    """When the experiment begins on the recording's clock (s): the first suction, else the first commanded motion.

    Repeats are compared from there, because how long a recording idles before it says nothing.
    """
    cycles = suction_cycles(recording)
    if cycles:
        return cycles[0].onset
    moves = [first_move(series) for series in recording.setpoints.values() if np.ptp(series.value) > 0]
    times = [float(series.time[0]) for series in recording.streams.values() if len(series.time)]
    return min(moves or times, default=0.0)


def first_move(commanded: Series) -> float:
    """When a set-point first leaves its initial value, s: forces are tared and gauges zeroed by then."""
    moved = np.flatnonzero(commanded.value != commanded.value[0])
    return float(commanded.time[max(int(moved[0]) - 1, 0)]) if len(moved) else float(commanded.time[-1])


def commanded_cycles(segments: Sequence[SegmentRecord], *, shortest: float = 0.05) -> tuple[Cycle, ...]:
    """Cycles of ``segments``: from where suction is commanded to where none is. Those below ``shortest`` s are none."""
    pieces = [(s.begin, s.end, -s.start.get("pressure", 0.0), -s.finish.get("pressure", 0.0)) for s in segments]
    stretches: list[list[tuple[float, float, float, float]]] = []
    reached = 0.0  # suction at the end of the piece before
    for piece in pieces:
        if max(piece[2:]) > 0:
            if reached > 0 and piece[2] > 0:
                stretches[-1].append(piece)
            else:
                stretches.append([piece])
        reached = piece[3]
    found = [_commanded(stretch) for stretch in stretches]
    found = [cycle for cycle in found if cycle.release + cycle.fall - cycle.onset >= shortest]
    ends = [cycle.onset for cycle in found[1:]] + [segments[-1].end] * bool(found)
    return tuple(_until(cycle, end) for cycle, end in zip(found, ends, strict=True))


def _commanded(stretch: Sequence[tuple[float, float, float, float]]) -> Cycle:
    """The cycle of consecutive pieces (begin, end, suction there and there) that are under suction."""
    onset, end = stretch[0][0], stretch[-1][1]
    level = max(max(piece[2:]) for piece in stretch)
    full = [
        moment
        for begin, finish, first, last in stretch
        for moment, suction in ((begin, first), (finish, last))
        if suction >= level * (1 - 1e-9)
    ]
    return Cycle(onset, full[-1], end, -level, full[0] - onset, end - full[-1])


def find_cycles(pressure: Series, *, threshold: float, shortest: float = 0.05) -> tuple[Cycle, ...]:
    """Stretches of suction above ``threshold`` (a fraction of the strongest); gaps below ``shortest`` s are bridged."""
    time, suction = pressure.time, -pressure.value
    strongest = float(suction.max(initial=0.0))
    if strongest <= 0:
        return ()
    edges = np.flatnonzero(np.diff(np.concatenate([[False], suction > threshold * strongest, [False]])))
    stretches: list[tuple[int, int]] = []
    for first, past in zip(edges[::2], edges[1::2], strict=True):
        if stretches and time[first] - time[stretches[-1][1] - 1] < shortest:
            stretches[-1] = (stretches[-1][0], int(past))
        else:
            stretches.append((int(first), int(past)))
    found = [_cycle(time, suction, first, past) for first, past in stretches]
    found = [cycle for cycle in found if cycle.release + cycle.fall - cycle.onset >= shortest]
    ends = [cycle.onset for cycle in found[1:]] + [float(time[-1])] * bool(found)
    return tuple(_until(cycle, end) for cycle, end in zip(found, ends, strict=True))


def _cycle(time: FloatArray, suction: FloatArray, first: int, past: int) -> Cycle:
    before, after = max(first - 1, 0), min(past, len(time) - 1)
    level = float(suction[first:past].max())
    full = first + np.flatnonzero(suction[first:past] >= 0.98 * level)
    onset, release = float(time[before]), float(time[full[-1]])
    rise, fall = float(time[full[0]]) - onset, float(time[after]) - release
    return Cycle(onset, release, float(time[after]), -level, rise, fall)


def _until(cycle: Cycle, end: float) -> Cycle:
    return Cycle(cycle.onset, cycle.release, max(end, cycle.release), cycle.level, cycle.rise, cycle.fall)
