"""Plan, progress and outcome of a run."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from acquire.engine.rules import Trip
from acquire.engine.state import State
from acquire.recording import RunInfo
from acquire.recording.identity import check_identity
from drivers.signals import Region
from protocols.limits import Limits
from protocols.setpoints import Setpoints


@dataclass(frozen=True)
class RunPlan:
    """A run, ready to be armed.

    ``limits`` are those of hardware, station, protocol and subject, intersected. ``path`` is the recording to be made
    (HDF5; its journal lies beside it). ``rest`` is the vented or centred value of each quantity (default 0).
    ``baseline`` and ``tail`` are how long (s of device time) is recorded before the first set-point and after the end.
    ``frame_scale`` is in m/px; ``region`` is that of which most frames are kept, None for whole frames.
    """

    setpoints: Setpoints
    limits: Limits
    info: RunInfo
    path: Path
    rest: Mapping[str, float] = field(default_factory=dict)
    baseline: float = 0.2
    tail: float = 0.5
    frame_scale: float = 0.0
    region: Region | None = None

    def __post_init__(self) -> None:
        """Raises ValueError for a text or number that could not be recorded: before anybody is touched."""
        check_identity(self.info)
        for name in ("baseline", "tail", "frame_scale"):
            value = getattr(self, name)
            if not 0 <= value < math.inf:
                raise ValueError(f"{name} must be a number from 0 on, not {value!r}")


@dataclass(frozen=True)
class Progress:
    """Where a run stands. ``elapsed`` and ``duration`` are protocol time in s; ``segment`` counts from 0.

    ``written`` is how many bytes the run takes on the disk so far. ``dwell`` maps a quantity with such a limit to for
    how long it is away from rest, and may be, in s.
    """

    state: State
    segment: int = 0
    segments: int = 0
    phase: str = ""
    step: str = ""
    labels: Mapping[str, str] = field(default_factory=dict)
    elapsed: float = 0.0
    duration: float = 0.0
    segment_left: float = math.nan
    device_time: float = math.nan
    lost: int = 0
    recorder_fill: float = 0.0
    written: int = 0
    trip: Trip | None = None
    dwell: Mapping[str, tuple[float, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class Outcome:
    """How a run ended. ``recording`` is the finished file; None if it could not be made (then ``journal`` is kept).
    ``safe`` is whether the device confirmed that it vented and stopped; the ``reason`` says so where it did not."""

    status: State
    reason: str
    recording: Path | None
    journal: Path | None = None
    trip: Trip | None = None
    lost: int = 0
    safe: bool = True
