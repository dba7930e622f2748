"""Quality flags of one recording, for an operator to read before using it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from acquire.analysis.cycles import Cycle, first_move, suction_cycles
from acquire.recording.model import FloatArray, Recording, Series
from acquire.recording.possible import impossible
from acquire.words import number, shown, span
from acquire.words import share as in_percent
from protocols import ProtocolError, load
from protocols.schema import QUANTITIES


@dataclass(frozen=True)
class Flag:
    """One check: ``level`` ``ok``, ``warning`` or ``bad``, the number behind it, and plain words."""

    name: str
    level: str
    value: float
    text: str


def quality(recording: Recording) -> tuple[Flag, ...]:
    """Every check that applies, in the order in which an operator wants to know."""
    checks = (_lost, _rates, _possible, _saturation, _following, _drift, _first_curve, _contour, _pauses, _ending)
    return tuple(flag for check in checks for flag in check(recording))


def lost_samples(series: Series) -> int:
    """Samples missing in the device's counter (0 if it did not count)."""
    if series.seq is None or len(series.seq) < 2:
        return 0
    return int(np.sum(np.maximum(np.diff(series.seq) - 1, 0)))


def _lost(recording: Recording) -> list[Flag]:
    lost = {name: lost_samples(series) for name, series in recording.streams.items()}
    if recording.frames is not None and recording.frames.seq is not None:
        lost["frames"] = int(np.sum(np.maximum(np.diff(recording.frames.seq) - 1, 0)))
    worst = max(lost.values(), default=0)
    if not worst:
        return [Flag("lost samples", "ok", 0.0, "no sample is missing")]
    names = ", ".join(f"{name} {count}" for name, count in lost.items() if count)
    return [Flag("lost samples", "bad", float(worst), f"samples are missing: {names}")]


def _saturation(recording: Recording) -> list[Flag]:
    """Values at the end of the channel's range, or the flat top that a sensor at an unknown limit leaves."""
    flags = []
    for name, series in recording.streams.items():
        value = series.value[np.isfinite(series.value)]
        if not len(value):
            continue
        if series.range is None:
            share, what = 0.0 if name in recording.setpoints else _flat_top(value), "stays at its extreme"
        else:
            share, what = _at_end(value, series.range, series.resolution), "is at the end of its range"
        if share > 0.001:
            text = f"{name} {what} in {in_percent(share)} of the samples"
            flags.append(Flag("saturation", "bad" if share > 0.01 else "warning", share, text))
    return flags or [Flag("saturation", "ok", 0.0, "no channel is saturated")]


def _at_end(value: FloatArray, limits: tuple[float, float], resolution: float) -> float:
    """Share of samples at an end of the range, save at one that is rest itself (0 Pa, 0 m)."""
    slack = max(resolution, 1e-9 * (limits[1] - limits[0]) if np.isfinite(limits).all() else 0.0)
    ends = [end for end in limits if np.isfinite(end) and end != 0]
    return max((float(np.mean(np.abs(value - end) <= slack)) for end in ends), default=0.0)


def _flat_top(value: FloatArray) -> float:
    """Share of samples equal to the greatest or least one, if they stay there far longer than at any value between."""
    starts = np.flatnonzero(np.concatenate([[True], np.diff(value) != 0]))
    lengths = np.diff(np.append(starts, len(value)))
    usual = int(lengths[(value[starts] < value.max()) & (value[starts] > value.min())].max(initial=1))
    share = 0.0
    for extreme in (value.min(), value.max()):
        longest = int(lengths[value[starts] == extreme].max(initial=0))
        if extreme != 0 and longest >= 5 and longest > 3 * usual:
            share = max(share, float(np.mean(value == extreme)))
    return share


def _possible(recording: Recording) -> list[Flag]:
    """Values that the channel cannot have: its unit is wrong, or its sensor."""
    flags = []
    for name, series in recording.streams.items():
        if series.value.ndim != 1:
            continue
        worst, reason = impossible(name, series.value, ours=recording.info.instrument in QUANTITIES)
        if reason:
            value = float(series.value[worst])
            flags.append(Flag("impossible", "bad", value, f"{name} is {shown(value, series.unit)}: {reason}"))
    return flags


def _rates(recording: Recording) -> list[Flag]:
    """Sampling that is not as the protocol states it: the instrument was set up otherwise."""
    try:
        setup = load(recording.info.protocol).setup
    except ProtocolError:  # none, or a bundle's words on it
        return []
    frames = [recording.frames] if recording.frames is not None else []
    sampled = (("sampling", setup.sampling, [*recording.streams.values()]), ("frame_rate", setup.frame_rate, frames))
    flags = []
    for name, stated, sources in sampled:
        taken = [(len(s.time) - 1) / float(np.ptp(s.time)) for s in sources if len(s.time) > 10 and np.ptp(s.time) > 0]
        if stated is None or not taken:
            continue
        rate = max(taken, key=lambda rate: abs(rate - stated))
        if abs(rate / stated - 1) > 0.1:
            text = f"the protocol states {stated:g} Hz ({name}); the instrument took {number(rate)} Hz"
            flags.append(Flag("rate", "warning", rate / stated, text))
    return flags


def _following(recording: Recording) -> list[Flag]:
    """How far each commanded quantity stayed from its set-point: in the worst hold, or all along where none is held."""
    found = []
    for name, commanded in recording.setpoints.items():
        measured = recording.streams.get(name)
        if measured is None or len(measured.time) < 5 or not len(commanded.value) or not np.ptp(commanded.value):
            continue
        off = list(_off_in_holds(commanded, measured)) or _off_on_the_way(commanded, measured)
        found += [(abs(by) / float(np.ptp(commanded.value)), f"{name} {text}") for by, text in off]
    if not found:
        return []
    share, text = max(found)
    level = "ok" if share < 0.05 else "warning" if share < 0.2 else "bad"
    return [Flag("command", level, share, text if level != "ok" else "the set-points were followed")]


def _off_in_holds(commanded: Series, measured: Series) -> Iterator[tuple[float, str]]:
    """By how much the second half of each hold away from rest is off its set-point (SI, median), and in words."""
    for begin, end, level in _holds(commanded):
        inside = (measured.time > begin + 0.5 * (end - begin)) & (measured.time <= end)
        if level != commanded.value[0] and inside.sum() >= 5:
            value = float(np.nanmedian(measured.value[inside]))
            there = f"{shown(value, measured.unit)} at {begin:.1f} s, where {shown(level, measured.unit)}"
            yield value - level, f"was {there} was held"


def _off_on_the_way(commanded: Series, measured: Series) -> list[tuple[float, str]]:
    """By how much (SI, median) it is off while the set-point moves, with the delay that fits best, 0.3 s at most."""
    inside = (measured.time >= first_move(commanded)) & (measured.time <= commanded.time[-1])
    if inside.sum() < 20:
        return []
    time, value = measured.time[inside], measured.value[inside]
    delays = np.linspace(0.0, 0.3, 13)
    off = min(float(np.nanmedian(np.abs(value - np.interp(time - d, commanded.time, commanded.value)))) for d in delays)
    return [(off, f"was {shown(off, measured.unit)} off its set-point (median)")]


def _holds(commanded: Series, shortest: float = 0.5) -> Iterator[tuple[float, float, float]]:
    """Begin and end (s) and value of each stretch in which the set-point stays; from ``shortest`` s on."""
    starts = np.flatnonzero(np.concatenate([[True], np.diff(commanded.value) != 0]))
    ends = np.append(starts[1:], len(commanded.value)) - 1
    for begin, end in zip(starts, ends, strict=True):
        if commanded.time[end] - commanded.time[begin] >= shortest:
            yield float(commanded.time[begin]), float(commanded.time[end]), float(commanded.value[begin])


def _drift(recording: Recording) -> list[Flag]:
    """The pressure gauge's zero, or the forces' at the centre, before and after the run."""
    zeros = [name for name in ("pressure", "force_x", "force_y", "force_z") if name in recording.streams]
    worst, text, warn = 0.0, "", 0.0
    for name in zeros:
        series = recording.streams[name]
        commanded = recording.setpoints.get("pressure" if name == "pressure" else "probe_x")
        if commanded is None or len(series.time) < 40:
            continue
        before = series.value[series.time <= first_move(commanded)][-20:]
        after = series.value[-20:]
        span = float(np.ptp(series.value))
        if len(before) < 3 or span <= 0:
            continue
        shift = float(np.mean(after) - np.mean(before))
        if abs(shift) / span > worst:
            worst = abs(shift) / span
            warn = 0.02 if name == "pressure" else 0.1  # skin goes on relaxing after the probe is back at its centre
            text = f"{name} ends {shown(shift, series.unit)} from where it began, {in_percent(worst)} of its span"
    if not text:
        return []
    level = "ok" if worst < warn else "warning" if worst < 5 * warn else "bad"
    return [Flag("drift", level, worst, text)]


def _first_curve(recording: Recording) -> list[Flag]:
    """The first curve of a series differs from its repeats (preconditioning): how far."""
    cycles = suction_cycles(recording)
    cycles = tuple(cycle for cycle in cycles if _alike(cycle, cycles[0]))
    if len(cycles) < 2 or "apex_height" not in recording.streams:
        return []
    height = recording.streams["apex_height"]
    tops = []
    for cycle in cycles:
        inside = (height.time >= cycle.onset) & (height.time <= cycle.release + 0.1)
        if inside.any():
            tops.append(float(height.value[inside].max()) - _before(height, cycle.onset))
    if len(tops) < 2 or not np.mean(tops[1:]):
        return []
    change = tops[0] / float(np.mean(tops[1:])) - 1
    sign = "+" if change > 0 else ""
    text = f"the first curve rises {sign}{in_percent(change)} compared with the {len(tops) - 1} after it"
    return [Flag("first curve", "ok" if abs(change) < 0.1 else "warning", change, text)]


def _before(height: Series, onset: float) -> float:
    """The height at an onset of suction; where heights come before it (lost frames), that of 0.4 s before."""
    earlier = height.value[(height.time > onset - 0.6) & (height.time < onset - 0.2)]
    there = float(np.interp(onset, height.time, height.value))
    return min(there, float(np.median(earlier))) if len(earlier) else there


def _alike(a: Cycle, b: Cycle) -> bool:
    """Whether two cycles repeat the same suction: level within 5 %, loading and holding within 5 % or 0.2 s."""
    return (
        abs(a.level - b.level) <= 0.05 * abs(b.level)
        and abs(a.rise - b.rise) <= max(0.05 * b.rise, 0.2)
        and abs((a.release - a.onset) - (b.release - b.onset)) <= max(0.05 * (b.release - b.onset), 0.2)
    )


def _contour(recording: Recording) -> list[Flag]:
    if "contour_confidence" not in recording.derived:
        return []
    confidence = recording.derived["contour_confidence"].value
    if not len(confidence):
        return []
    poor = float(np.mean(~(confidence >= 0.5)))
    text = f"contour confidence {np.nanmedian(confidence):.2f} (median); below 0.5 in {in_percent(poor)} of the frames"
    return [Flag("contour", "ok" if poor < 0.05 else "warning" if poor < 0.3 else "bad", poor, text)]


def _pauses(recording: Recording) -> list[Flag]:
    """The protocol was interrupted: vented in between, and the interrupted segment repeated."""
    begun = [event.time for event in recording.events if event.code == "pause"]
    if not begun:
        return []
    ended = [event.time for event in recording.events if event.code == "resume"]
    last = max((float(series.time[-1]) for series in recording.streams.values() if len(series.time)), default=begun[-1])
    lengths = [min((end for end in ended if end >= begin), default=last) - begin for begin in begun]
    often = "once" if len(begun) == 1 else f"{len(begun)} times"
    text = f"paused {often}, {span(sum(lengths))} in all: vented meanwhile, the interrupted segment repeated"
    return [Flag("pause", "warning", sum(lengths), text)]


def _ending(recording: Recording) -> list[Flag]:
    status = recording.info.status
    if status in ("completed", "imported"):
        return []
    why = f": {recording.info.trip_reason}" if recording.info.trip_reason else ""
    return [Flag("ending", "warning" if status in ("recovered", "aborted") else "bad", 1.0, f"the run {status}{why}")]
