"""The worker's messages about one instrument: its state, and its data thinned for a screen."""

from __future__ import annotations

import math
import shutil
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from acquire.gui.messages import PATH, Picture, View
from acquire.gui.thinning import extremes
from drivers.device import Status
from drivers.signals import Block, FloatArray, Frame

if TYPE_CHECKING:
    from acquire.engine import Course, RunEngine
    from protocols import Setpoints

FINE = 0.05  # s of device time that one pair of points stands for
WIDEST = 400  # px of a picture on the screen


class Feed:
    """Empties one engine's display queue. Used by the publisher's thread; `begin` by any."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.error = ""
        self.opening = False  # its links are being opened
        self._run = 0
        self._edges: FloatArray = np.zeros(1)
        self._origin = math.nan
        self._course: Course | None = None  # the last one that was told
        self._disk = Disk()

    def begin(self, setpoints: Setpoints) -> None:
        """A run of ``setpoints`` begins."""
        self._edges = setpoints.edges
        self._origin = math.nan
        self._run += 1

    def view(self, engine: RunEngine | None, out: Path) -> View:
        """The instrument now, with everything that arrived since the last call; None while it was never opened."""
        if engine is None:
            return View(self.name, "connecting" if self.opening else "idle", self.error)
        items = engine.display.take()
        blocks = [item for item in items if isinstance(item, Block) and len(item)]
        frames = [item for item in items if isinstance(item, Frame)]
        progress, trip, status = engine.progress, engine.trip, engine.status
        if math.isnan(self._origin) and status is not None and status.state == "running":
            self._origin = self._origin_by(status)
        state = str(progress.state)
        return View(
            name=self.name,
            state="connecting" if self.opening and state in ("idle", "failed") else state,
            error=self.error,
            identity=_identity(engine),
            trip=trip.message if trip else "",
            run=self._run,
            origin=self._origin,
            device_time=progress.device_time,
            phase=progress.phase,
            labels=dict(progress.labels),
            segment=progress.segment,
            segments=progress.segments,
            elapsed=progress.elapsed,
            duration=progress.duration,
            left=progress.segment_left,
            lost=progress.lost,
            fill=progress.recorder_fill,
            dwell=dict(progress.dwell),
            disk=self._disk.left(progress.written, out),
            points=_points(blocks),
            plan=self._plan(engine.course),
            latest={name: float(value[-1]) for block in blocks for name, value in block.values.items()},
            path=_path(blocks),
            picture=_picture(frames[-1]) if frames else None,
        )

    def _plan(self, course: Course | None) -> tuple[FloatArray, dict[str, FloatArray]] | None:
        """The set-points, where they are others than at the last view."""
        if course is self._course:
            return None
        self._course = course
        return course.table() if course is not None else None

    def _origin_by(self, status: Status) -> float:
        """Device time at which the protocol began, by the segment that the device says it executes."""
        known = math.isfinite(status.began) and status.executed < len(self._edges)
        return status.began - float(self._edges[status.executed]) if known else math.nan


def _identity(engine: RunEngine) -> str:
    """Model and serial number of the first device; '' before it said so."""
    identity = next(iter(engine.identities.values()), None)
    return f"{identity.model}, {identity.serial}" if identity else ""


def _picture(frame: Frame) -> Picture:
    """A frame made small, with the contour that the recorded height is read from."""
    contour = frame.contour
    step = -(-frame.image.shape[1] // WIDEST)
    small = np.ascontiguousarray(frame.image[::step, ::step])
    if contour is None:
        return Picture(small, np.empty((0, 2)))
    return Picture(small, contour.outline() / step, contour.gvt, contour.confidence, contour.flags)


class Disk:
    """How long the disk lasts at the rate at which the run is written."""

    def __init__(self) -> None:
        self._looked = time.monotonic()
        self._written = 0
        self._left = math.nan

    def left(self, written: int, folder: Path) -> float:
        """Seconds until the disk is full, ``written`` being the bytes of the run so far; NaN while nothing is added."""
        now = time.monotonic()
        if now - self._looked >= 1.0:
            rate = (written - self._written) / (now - self._looked)
            there = next(parent for parent in (folder, *folder.resolve().parents) if parent.exists())
            self._left = shutil.disk_usage(there).free / rate if rate > 0 else math.nan
            self._looked, self._written = now, written
        return self._left


def _points(blocks: list[Block]) -> dict[str, tuple[FloatArray, FloatArray]]:
    parts: dict[str, list[tuple[FloatArray, FloatArray]]] = {}
    for block in blocks:
        for name, value in block.values.items():
            parts.setdefault(name, []).append((block.time, value))
    joined = {n: (np.concatenate([t for t, _ in p]), np.concatenate([v for _, v in p])) for n, p in parts.items()}
    return {name: extremes(*curve, FINE) for name, curve in joined.items()}


def _path(blocks: list[Block]) -> FloatArray | None:
    """Tip position and force, at most one row for each `FINE`."""
    whole = [b for b in blocks if all(name in b.values for name in PATH)]
    if not whole:
        return None
    rows = np.concatenate([np.column_stack([b.values[name] for name in PATH]) for b in whole])
    when = np.concatenate([b.time for b in whole])
    stretch = np.floor(when / FINE)
    last: FloatArray | None = rows[np.append(np.flatnonzero(np.diff(stretch)), len(rows) - 1)]
    return last
