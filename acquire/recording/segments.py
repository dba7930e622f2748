"""Commanded segments as a table of columns: how HDF5 and bundles carry them."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from acquire.recording.model import FloatArray, RecordingError, SegmentRecord
from acquire.recording.tables import text_in_csv, title_in_csv
from protocols.files import contents, refusing
from protocols.setpoints import Setpoints

START, FINISH, LABEL = "start_", "finish_", "label_"  # before the name of a quantity or label
_FIXED = ("begin", "end", "phase", "step")
MAX_BYTES = 64 << 20  # of a bundle's table of segments; a protocol has at most 100 000


def of_setpoints(setpoints: Setpoints, start: float = 0.0) -> tuple[SegmentRecord, ...]:
    """The segments of a compiled protocol that begins at ``start`` s."""
    edges = np.maximum.accumulate(setpoints.edges + start).tolist()
    return tuple(
        SegmentRecord(begin, end, s.phase, s.step, dict(s.start), dict(s.end), dict(s.labels))
        for s, begin, end in zip(setpoints.segments, edges[:-1], edges[1:], strict=True)
    )


def before(segments: Sequence[SegmentRecord], moment: float) -> list[SegmentRecord]:
    """``segments`` as far as they began before ``moment`` (s); the one under way then ends there, where it had got."""
    kept = [s for s in segments if s.begin < moment]
    return [s if s.end <= moment else s.until(moment) for s in kept]


def to_columns(segments: Sequence[SegmentRecord]) -> dict[str, list[Any]]:
    """One list per column: ``begin``, ``end`` (s), ``phase``, ``step``, ``start_<quantity>`` … ``label_<name>``."""
    quantities = list(dict.fromkeys(q for s in segments for q in (*s.start, *s.finish)))
    labels = list(dict.fromkeys(name for s in segments for name in s.labels))
    columns: dict[str, list[Any]] = {name: [getattr(s, name) for s in segments] for name in _FIXED}
    columns |= {START + q: [float(s.start.get(q, math.nan)) for s in segments] for q in quantities}
    columns |= {FINISH + q: [float(s.finish.get(q, math.nan)) for s in segments] for q in quantities}
    return columns | {LABEL + name: [s.labels.get(name, "") for s in segments] for name in labels}


def from_columns(columns: Mapping[str, Sequence[Any]]) -> tuple[SegmentRecord, ...]:
    """The segments of a table; numbers may be text. Raises ValueError that names the column, or the row from 1 on."""
    if missing := [name for name in _FIXED if name not in columns]:
        raise ValueError(f"the table of segments has no column {missing[0]!r}")
    rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    segments: list[SegmentRecord] = []
    for number, row in enumerate(rows, 1):
        try:
            segment = SegmentRecord(
                float(row["begin"]),
                float(row["end"]),
                row["phase"],
                row["step"],
                {name: float(value) for name, value in _prefixed(row, START)},
                {name: float(value) for name, value in _prefixed(row, FINISH)},
                {name: value for name, value in _prefixed(row, LABEL) if value},
            )
        except ValueError as error:
            raise ValueError(f"segment {number}: {error}") from None
        if not (math.isfinite(segment.begin) and segment.begin <= segment.end < math.inf):
            raise ValueError(f"segment {number}: from {segment.begin:g} to {segment.end:g} s")
        if segments and segment.begin < segments[-1].begin:
            raise ValueError(f"segment {number}: time goes back to {segment.begin:g} s")
        segments.append(segment)
    return tuple(segments)


def write_csv(segments: Sequence[SegmentRecord], path: Path) -> None:
    """A bundle's table of segments; texts are escaped as titles are, see `title_in_csv`."""
    columns = to_columns(segments)
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        for row in zip(*columns.values(), strict=True):
            writer.writerow(title_in_csv(cell) if isinstance(cell, str) else repr(cell) for cell in row)


def read_csv(path: Path) -> tuple[SegmentRecord, ...]:
    """The segments in a bundle's table. Raises RecordingError that names the file."""
    with refusing(path, RecordingError):
        text = io.StringIO(contents(path, MAX_BYTES).decode(), newline="")
        header, *rows = csv.reader(text, strict=True)
        return from_columns({name: [text_in_csv(row[k]) for row in rows] for k, name in enumerate(header)})


def kinks(segments: Sequence[SegmentRecord]) -> FloatArray:
    """Times (s, ascending) at which the set-point steps or changes its slope: every boundary that is not smooth."""
    edges: list[float] = []
    for a, b in pairwise(segments):
        smooth = a.end == b.begin and all(
            a.finish[q] == b.start.get(q) and math.isclose(slope, b.slopes[q], rel_tol=1e-6)
            for q, slope in a.slopes.items()
        )
        edges += [] if smooth else [a.end, b.begin]
    return np.unique(edges)


def _prefixed(row: Mapping[str, Any], prefix: str) -> list[tuple[str, Any]]:
    return [(name.removeprefix(prefix), value) for name, value in row.items() if name.startswith(prefix)]
