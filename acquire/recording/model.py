"""A recording in memory: what was commanded, what was measured, and everything needed to read it years later."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Series:
    """One channel: ``value`` (n,) in SI ``unit`` at device time ``time`` (n,) s.

    ``time_host`` (n,) s is the host's monotonic clock at arrival, ``seq`` (n,) the device's sample counter (for imported data: the
    row number). ``stage`` is the stage of the forward chain that the channel observes.
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
    """Camera frames: ``data`` (n, height, width) of uint8 (an array or a lazy HDF5 dataset), ``time`` (n,) s, ``scale`` m/px."""

    data: Any
    time: FloatArray
    scale: float
    seq: NDArray[np.int64] | None = None


@dataclass(frozen=True)
class Event:
    """Something that happened: ``time`` s (device clock), level ``info|warning|error|trip``, a short code, plain words."""

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
    """One run. ``streams`` and ``setpoints`` map channel or quantity to its series; ``derived`` holds analysis results."""

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
