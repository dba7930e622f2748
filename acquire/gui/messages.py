"""Messages between the window and its worker process. Plain data only, so that it goes through a pipe."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.signals import FloatArray

WINDOW = "window"  # the name under which the window's liveness is watched
# Words on the safety pipe, which carries nothing else and is read by a thread that does nothing else.
ALIVE, STOP = b".", b"!"

#: Channels of a tip's position and the force on it, in the order of `View.path`.
PATH = ("probe_x", "probe_y", "probe_z", "force_x", "force_y", "force_z")
FROM_FILE = "from a file"  # the title of a protocol that a person opened
LIVE = frozenset({"armed", "running", "paused"})
NEEDS_RESET = frozenset({"tripped", "failed"})


@dataclass(frozen=True)
class BenchSettings:
    """The bench that the worker opens: a station file, or the simulated bench where there is none."""

    station: Path | None = None
    out: Path = Path("runs")
    speed: float = 1.0
    tissue: str = "forearm"
    seed: int | None = None
    frame_size: tuple[int, int] = (640, 480)
    notify: tuple[str, ...] = ()  # who is told of ends, trips and stalls, as `acquire.notify.hooks` reads it


@dataclass(frozen=True)
class Command:
    """Something a person wants; ``number`` comes back in the `Reply`."""

    number: int
    action: str
    instrument: str = ""
    arguments: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Fault:
    """A fault of a protocol, and where it is; ``line`` counts from 1, 0 where it is not known."""

    message: str
    field: str = ""
    line: int = 0


@dataclass(frozen=True)
class Reply:
    """The answer to a command: ``value``, or the ``error`` in plain words, with its ``faults`` in a protocol."""

    number: int
    value: Any = None
    error: str = ""
    faults: tuple[Fault, ...] = ()


@dataclass(frozen=True)
class ProtocolEntry:
    """A protocol of the library or a file, as the list shows it."""

    name: str
    title: str
    instrument: str
    path: Path


@dataclass(frozen=True)
class Preview:
    """A compiled protocol: break points (``time`` in s; SI values), limits (SI), phases as (begin, end, name).

    ``headline`` and ``rows``, each a name and a text, describe it in words.
    """

    name: str
    instrument: str
    text: str
    headline: str
    rows: Sequence[tuple[str, str]]
    duration: float
    time: FloatArray
    values: Mapping[str, FloatArray]
    limits: Mapping[str, tuple[float, float]]
    phases: tuple[tuple[float, float, str], ...]


@dataclass(frozen=True)
class ChannelInfo:
    """A channel for the plots: SI unit, and the limits that hold in this run."""

    name: str
    unit: str


@dataclass(frozen=True)
class InstrumentInfo:
    """An instrument of the station before it is opened."""

    name: str
    kind: str
    title: str
    simulated: bool
    channels: tuple[ChannelInfo, ...]
    camera: bool

    @property
    def label(self) -> str:
        """How it is called everywhere: by the station's name, and by its kind where the name does not tell it."""
        return self.title if self.name == self.kind else f"{self.name} – {self.title}"


@dataclass(frozen=True)
class Picture:
    """A camera frame made small for the screen, and its contour (n, 2; column and row of ``image``; empty for none).

    ``gvt`` is the grey-value threshold used (NaN: none found), ``confidence`` that of the contour, 0 … 1.
    """

    image: NDArray[np.uint8]
    outline: FloatArray
    gvt: float = math.nan
    confidence: float = math.nan
    flags: tuple[str, ...] = ()


@dataclass(frozen=True)
class View:
    """One instrument as the worker sees it now, and the data since the last view.

    ``points`` maps channel to (time, value), thinned by extremes, ``latest`` to its newest value (NaN: not measurable);
    ``plan`` are the set-points in device time, break points as in `Preview`, where they changed since the last view;
    ``path`` (n, 6) is tip position (m) and force (N); ``origin`` the device time at which the protocol began (NaN: not
    yet). ``run`` counts runs: another one clears the plots. Times are in s; ``left`` is the rest of the running
    segment, ``disk`` how long the disk lasts at the present rate (NaN: none); ``dwell`` maps a quantity to how
    long it is away from rest, and how long it may be.
    """

    name: str
    state: str
    error: str = ""
    identity: str = ""
    trip: str = ""
    run: int = 0
    origin: float = math.nan
    device_time: float = math.nan
    phase: str = ""
    labels: Mapping[str, str] = field(default_factory=dict)
    segment: int = 0
    segments: int = 0
    elapsed: float = 0.0
    duration: float = 0.0
    left: float = math.nan
    lost: int = 0
    fill: float = 0.0
    disk: float = math.nan
    dwell: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    points: Mapping[str, tuple[FloatArray, FloatArray]] = field(default_factory=dict)
    plan: tuple[FloatArray, Mapping[str, FloatArray]] | None = None
    latest: Mapping[str, float] = field(default_factory=dict)
    path: FloatArray | None = None
    picture: Picture | None = None


@dataclass(frozen=True)
class Measurement:
    """The key under which repeats are counted: a protocol on a site of a subject."""

    subject: str
    site: str
    protocol: str


@dataclass(frozen=True)
class Finished:
    """A run ended: repeat ``repeat`` of ``what``.

    ``recording`` is None if it could not be written; ``journal`` then holds the data.
    """

    instrument: str
    what: Measurement
    repeat: int
    status: str
    reason: str
    recording: Path | None
    journal: Path | None
    lost: int


@dataclass(frozen=True)
class Ready:
    """The worker is up: the station's instruments."""

    station: str
    instruments: tuple[InstrumentInfo, ...]


@dataclass(frozen=True)
class Refused:
    """The station cannot be used, and the worker has ended: ``fault`` names file, line and field."""

    fault: str


Update = Ready | Refused | Reply | Finished | tuple[View, ...]
