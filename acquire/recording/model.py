"""A recording in memory: set-points, measured channels, and everything needed to read it years later."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from protocols.specimens import Stated

FloatArray = NDArray[np.float64]
AXIS_LOOP = {"loop_proportional": "N/m", "loop_integral": "N/(m s)", "loop_derivative": "N s/m", "axis_mass": "kg"}
"""Calibrations by which a recording of the micro-robot states the controller of its axes, all of them or none, and
their units."""


class RecordingError(ValueError):
    """A recording, bundle, journal or export that cannot be read or written; the message says which and where."""


@dataclass(frozen=True)
class Series:
    """One channel: ``value`` (n,) in SI ``unit`` at device time ``time`` (n,) s; a derived profile is (n, width).

    ``time_host`` (n,) s is the host's monotonic clock at arrival, ``seq`` (n,) the device's sample counter (for
    imported data: the row number). ``stage`` is the stage of the forward chain that the channel observes. ``noise`` is
    the standard deviation of a sample as the laboratory states it, 0 where it does not.
    """

    value: FloatArray
    time: FloatArray
    unit: str
    time_host: FloatArray | None = None
    seq: NDArray[np.int64] | None = None
    stage: str = ""
    range: tuple[float, float] | None = None
    resolution: float = 0.0
    noise: float = 0.0


@dataclass(frozen=True)
class Frames:
    """Camera frames: ``data`` (n, height, width) of uint8 (an array or lazy: slice it), ``time`` (n,) s.

    ``scale`` is in m/px; 0 means that it is not known.
    """

    data: Any
    time: FloatArray
    scale: float
    seq: NDArray[np.int64] | None = None


@dataclass(frozen=True)
class Event:
    """Something that happened: ``time`` s (device clock), level ``info|warning|error|trip``, a code, plain words.

    ``count`` is how many samples, frames or bytes it is about, 0 where nothing was counted.
    """

    time: float
    level: str
    code: str
    text: str
    count: int = 0


@dataclass(frozen=True)
class SegmentRecord:
    """One linear piece of the set-points, from ``begin`` to ``end`` s on the recording's clock.

    These are the segments that the protocol's compiler made, as the instrument executed them: an ``until`` that was met
    or a pause ends one early, inserted pieces (rest before and after, the way back after a pause) have the step
    ``""`` or ``resume``. ``phase`` is ``load``, ``hold``, ``unload`` or ``rest``; ``step`` is the index path of the
    protocol's step. ``start`` and ``finish`` map each commanded quantity to its value (SI) at ``begin`` and ``end``.
    ``labels`` are the compiler's names for it, as text: ``level`` (``300 mbar`` of suction, ``1.3 mm``), ``direction``
    (``theta=0 phi=90``, degrees), ``cycle``, ``repeat``, ``rate``, and how a group counts itself.
    """

    begin: float
    end: float
    phase: str
    step: str
    start: Mapping[str, float]
    finish: Mapping[str, float]
    labels: Mapping[str, str] = field(default_factory=dict)

    @property
    def duration(self) -> float:
        """Its length in s; 0 for a step."""
        return self.end - self.begin

    @property
    def slopes(self) -> dict[str, float]:
        """Rate of change of each quantity, SI/s; infinite (with its sign) for a step, 0 for a hold."""
        changes = {q: self.finish[q] - value for q, value in self.start.items()}
        if self.duration > 0:
            return {q: change / self.duration for q, change in changes.items()}
        return {q: math.copysign(math.inf, change) if change else 0.0 for q, change in changes.items()}

    @property
    def rate(self) -> float:
        """How fast the command moves, SI/s, along its way: at least 0, infinite for a step."""
        return math.hypot(*self.slopes.values())

    @property
    def level(self) -> float:
        """The level its step goes to: Pa (suction negative) or m from the centre; NaN where the step has none."""
        words = re.fullmatch(r"(-?[\d.]+(?:e[-+]?\d+)?) (mbar|mm)", self.labels.get("level", ""))
        return float(words[1]) * _LEVELS[words[2]] if words else math.nan

    @property
    def direction(self) -> tuple[float, float, float] | None:
        """Unit vector of the trajectory it belongs to; None where there is none."""
        angles = re.fullmatch(r"theta=(-?[\d.]+) phi=(-?[\d.]+)", self.labels.get("direction", ""))
        if angles is None:
            return None
        theta, phi = (math.radians(float(angle)) for angle in angles.groups())
        return math.cos(phi) * math.cos(theta), math.cos(phi) * math.sin(theta), math.sin(phi)

    @property
    def cycle(self) -> int:
        """Which cycle of its step it belongs to, from 1; 0 where the step does not cycle."""
        number = self.labels.get("cycle", "")
        return int(number) if number.isdecimal() else 0

    def until(self, moment: float) -> SegmentRecord:
        """Its part before ``moment`` (s, within it): where it had got by then."""
        part = (moment - self.begin) / self.duration
        finish = {q: value + part * (self.finish[q] - value) for q, value in self.start.items()}
        return replace(self, end=moment, finish=finish)


_LEVELS = {"mbar": -100.0, "mm": 1e-3}  # factor to SI of the units that the compiler labels levels in


@dataclass(frozen=True)
class RunInfo:
    """Who, what, where: the run's identity. ``protocol`` is the YAML text verbatim."""

    id: str
    instrument: str
    start_time: str
    end_time: str = ""
    status: str = "completed"  # completed | aborted | tripped | failed | recovered | imported
    trip_reason: str = ""
    protocol: str = ""
    protocol_name: str = ""
    subject: str = ""
    site: str = ""
    operator: str = ""
    repeat: int = 1
    specimen: str = "skin"
    specimen_properties: Mapping[str, Stated] = field(default_factory=dict)
    notes: str = ""
    consent: str = ""  # which consent of the subject covers this; empty: nobody said
    experiment: str = ""  # id of the experiment (gap-experiment/1) that this answers; empty: of none
    versions: Mapping[str, str] = field(default_factory=dict)
    station: str = ""  # the station file verbatim (YAML)
    device: str = ""  # the station's name of the instrument
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    calibration: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)  # name -> value, unit, provenance


@dataclass(frozen=True)
class Decision:
    """A person's verdict on a finished run: whether it counts with others (``include``), why, who, when."""

    include: bool
    reason: str
    by: str = ""
    time: str = ""


@dataclass(frozen=True)
class Recording:
    """One run. ``streams`` and ``setpoints`` map channel or quantity to its series; ``derived`` holds results.

    ``segments`` are the pieces of the set-points, in order: phase, level, direction, cycle, rate. It is empty for
    recordings of earlier versions and for bundles without it. ``decisions`` are those of persons about the run
    (`acquire.recording.review`); they stand beside the file, not in it.
    """

    info: RunInfo
    streams: Mapping[str, Series]
    setpoints: Mapping[str, Series] = field(default_factory=dict)
    frames: Frames | None = None
    events: tuple[Event, ...] = ()
    derived: Mapping[str, Series] = field(default_factory=dict)
    plot: str = ""  # name of the default stream
    segments: tuple[SegmentRecord, ...] = ()
    decisions: tuple[Decision, ...] = ()

    def stream(self, name: str) -> Series:
        """The named channel. Raises KeyError that names the run, the channel and those that exist."""
        try:
            return self.streams[name]
        except KeyError:
            have = ", ".join(self.streams) or "none"
            raise KeyError(f"recording {self.info.id} has no channel {name!r}; it has {have}") from None

    @property
    def default_plot(self) -> str:
        """Name of the stream to draw first: the recording's own choice, else by custom; '' without streams."""
        names = (self.plot, "apex_height", "force_x", "pressure", *self.streams)
        return next((name for name in names if name in self.streams), "")


def difference(a: Recording, b: Recording) -> str:
    """The first difference between two recordings in words (of frames all but the pixels); '' if there is none."""
    for item in fields(RunInfo):
        x, y = getattr(a.info, item.name), getattr(b.info, item.name)
        if not isinstance(x, Mapping) and x != y:
            return f"{item.name}: {x!r} became {y!r}"
    if dict(a.info.specimen_properties) != dict(b.info.specimen_properties):
        return "specimen_properties differ"
    for kind in ("streams", "setpoints", "derived"):
        axes = ("value", "time") if kind == "setpoints" else ("value", "time", "time_host", "seq")
        problem = _series_difference(getattr(a, kind), getattr(b, kind), axes)
        if problem:
            return f"{kind}: {problem}"
    if (a.frames is None) != (b.frames is None):
        return "frames: present in only one"
    if a.frames is not None and b.frames is not None:
        for what in ("time", "seq", "scale"):
            if not np.array_equal(getattr(a.frames, what), getattr(b.frames, what)):
                return f"frames: {what} differs"
    if a.segments != b.segments:
        return "segments differ"
    return "" if a.events == b.events else "events differ"


def missing_in(there: Recording, recording: Recording) -> str:
    """The parts of ``recording`` that ``there`` lacks, in words (of frames all but the pixels); '' if none.

    ``there`` may hold more: a recording has results of an analysis besides the contents of the journal.
    """
    identity = replace(recording.info, calibration={}, versions={}, limits={})
    kept = Recording(
        info=replace(there.info, calibration={}, versions={}, limits={}),
        streams={name: there.streams[name] for name in recording.streams if name in there.streams},
        setpoints=there.setpoints,
        segments=there.segments,
        frames=there.frames,
        events=tuple(event for event in there.events if event in set(recording.events)),
    )
    return difference(replace(recording, info=identity, derived={}), kept)


def _series_difference(a: Mapping[str, Series], b: Mapping[str, Series], axes: tuple[str, ...]) -> str:
    if list(a) != list(b):
        return f"{list(a)} became {list(b)}"
    for name in a:
        for item in axes:
            x, y = getattr(a[name], item), getattr(b[name], item)
            if (x is None) != (y is None) or (x is not None and not np.array_equal(x, y, equal_nan=True)):
                return f"{name}: {item} differs"
        if a[name].unit != b[name].unit:
            return f"{name}: unit {a[name].unit!r} became {b[name].unit!r}"
        if a[name].noise != b[name].noise:
            return f"{name}: noise {a[name].noise!r} became {b[name].noise!r}"
    return ""
