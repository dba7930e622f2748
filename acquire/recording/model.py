"""A recording in memory: what was commanded, what was measured, and everything needed to read it years later."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


class RecordingError(ValueError):
    """A recording, bundle, journal or export that cannot be read or written; the message says which and where."""


@dataclass(frozen=True)
class Series:
    """One channel: ``value`` (n,) in SI ``unit`` at device time ``time`` (n,) s; a derived profile is (n, width).

    ``time_host`` (n,) s is the host's monotonic clock at arrival, ``seq`` (n,) the device's sample counter (for
    imported data: the row number). ``stage`` is the stage of the forward chain that the channel observes.
    """

    value: FloatArray
    time: FloatArray
    unit: str
    time_host: FloatArray | None = None
    seq: NDArray[np.int64] | None = None
    stage: str = ""
    range: tuple[float, float] | None = None
    resolution: float = 0.0


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
    """Something that happened: ``time`` s (device clock), level ``info|warning|error|trip``, a code, plain words."""

    time: float
    level: str
    code: str
    text: str


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
    notes: str = ""
    versions: Mapping[str, str] = field(default_factory=dict)
    station: str = ""  # the station file verbatim (YAML)
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    calibration: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)  # name -> value, unit, provenance


@dataclass(frozen=True)
class Recording:
    """One run. ``streams`` and ``setpoints`` map channel or quantity to its series; ``derived`` holds results."""

    info: RunInfo
    streams: Mapping[str, Series]
    setpoints: Mapping[str, Series] = field(default_factory=dict)
    frames: Frames | None = None
    events: tuple[Event, ...] = ()
    derived: Mapping[str, Series] = field(default_factory=dict)
    plot: str = ""  # name of the default stream

    def stream(self, name: str) -> Series:
        """The named channel. Raises KeyError that names the run, the channel and what there is."""
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
    return "" if a.events == b.events else "events differ"


def missing_in(there: Recording, recording: Recording) -> str:
    """What of ``recording`` is not in ``there``, in words (of frames all but the pixels); '' if all of it is.

    ``there`` may hold more: a recording has what an analysis found besides what the journal holds.
    """
    identity = replace(recording.info, calibration={}, versions={}, limits={})
    kept = Recording(
        info=replace(there.info, calibration={}, versions={}, limits={}),
        streams={name: there.streams[name] for name in recording.streams if name in there.streams},
        setpoints=there.setpoints,
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
    return ""
