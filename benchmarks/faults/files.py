"""Journals and recordings damaged at any byte: whole records are recovered, damaged ones named."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from acquire.recording import Recording, RecordingError, open_recording, read_journal
from benchmarks.faults.inputs import Samples
from benchmarks.faults.mutate import HEADER
from benchmarks.faults.table import Campaign, Part, Row

FULL = 2000
BLOCK = 3  # kind of a record of samples (ten each in the sound journal)


def rows(campaign: Campaign) -> Iterator[Row]:
    """Journals cut or changed at any byte; recordings changed at any byte."""
    with tempfile.TemporaryDirectory(prefix="faults-") as name:
        folder = Path(name)
        samples = Samples(folder)
        yield _cut(campaign, samples.journal, folder)
        yield _changed(campaign, samples.journal, folder)
        yield _recording(campaign, samples.hdf5, folder)


def _ends(data: bytes) -> list[int]:
    """Where each record of a sound journal ends."""
    ends, position = [], 0
    while position + HEADER.size <= len(data):
        position += HEADER.size + HEADER.unpack_from(data, position)[1] + 4
        ends.append(position)
    return ends


def _samples(recording: Recording) -> int:
    series = recording.streams.get("pressure")
    return 0 if series is None else len(series.value)


def _cut(campaign: Campaign, data: bytes, folder: Path) -> Row:
    row = Row("journal cut at any byte", "every record before the cut is recovered, the rest is named")
    random = campaign.random("cut")
    ends = _ends(data)
    path = folder / "cut.journal"
    for _ in range(campaign.count(FULL)):
        cut = int(random.integers(len(data)))
        path.write_bytes(data[:cut])
        whole = [end for end in ends if end <= cut]
        expected = 10 * sum(
            1 for start, end in zip([0, *ends], ends, strict=False) if end <= cut and data[start + 8] == 3
        )
        try:
            recording = read_journal(path)
        except RecordingError as error:
            row.trial(problem="" if not whole and path.name in str(error) else f"cut at {cut}: {error}")
            continue
        problem = ""
        if _samples(recording) != expected:
            problem = f"cut at {cut}: {_samples(recording)} of {expected} samples"
        elif cut not in ends and not any(event.code == "journal_damage" for event in recording.events):
            problem = f"cut at {cut}: the end that is lost is not told"
        row.trial(problem=problem)
    return row


def _changed(campaign: Campaign, data: bytes, folder: Path) -> Row:
    row = Row("journal changed at any byte", "one record is lost at most, and named; what remains is as written")
    random = campaign.random("changed")
    path = folder / "changed.journal"
    path.write_bytes(data)
    sound = read_journal(path).streams["pressure"]
    for _ in range(campaign.count(FULL)):
        spot = int(random.integers(len(data)))
        change = bytes((data[spot] ^ int(random.integers(1, 256)),))
        path.write_bytes(data[:spot] + change + data[spot + 1 :])
        try:
            recording = read_journal(path)
        except RecordingError as error:
            # Only the first record, the run's identity, cannot be missed.
            row.trial(problem="" if path.name in str(error) and spot < _ends(data)[0] else f"byte {spot}: {error}")
            continue
        found = recording.streams["pressure"]
        problem = ""
        if not np.isin(found.value, sound.value).all() or len(sound.value) - len(found.value) > 10:
            problem = f"byte {spot}: {len(found.value)} of {len(sound.value)} samples, or false ones"
        elif recording.info.status != "completed" and spot < _ends(data)[-2]:
            problem = f"byte {spot}: status {recording.info.status}"
        elif not any(event.code == "journal_damage" for event in recording.events):
            problem = f"byte {spot}: not told"
        row.trial(problem=problem)
    return row


def _recording(campaign: Campaign, data: bytes, folder: Path) -> Row:
    row = Row(
        "recording (HDF5) changed at any byte",
        "refused with its name, or read with every number as it was written",
        exception="texts (notes, attributes such as units) carry no checksum: a changed letter in them is not noticed",
    )
    random = campaign.random("recording")
    path = folder / "changed.h5"
    path.write_bytes(data)
    sound = open_recording(path)
    for _ in range(campaign.count(FULL)):
        spot = int(random.integers(len(data)))
        change = bytes((data[spot] ^ (1 << int(random.integers(8))),))
        path.write_bytes(data[:spot] + change + data[spot + 1 :])
        try:
            recording = open_recording(path)
            problem = _different(recording, sound)
        except RecordingError as error:
            problem = "" if path.name in str(error) else f"does not name the file: {error}"
        except Exception as error:  # anything else is a crash
            problem = f"{type(error).__name__}: {error}"
        row.trial(problem=problem and f"byte {spot}: {problem}")
    return row


def _different(recording: Recording, sound: Recording) -> str:
    if recording.streams.keys() != sound.streams.keys():
        return f"channels {', '.join(recording.streams)}"
    for name, series in sound.streams.items():
        for part in ("value", "time", "seq"):
            if not np.array_equal(getattr(series, part), getattr(recording.streams[name], part), equal_nan=True):
                return f"{name}: {part} differs and nothing says so"
    if (recording.frames is None) != (sound.frames is None):
        return "its frames are gone"
    if recording.frames is None or sound.frames is None:
        return ""
    same = np.array_equal(np.asarray(recording.frames.data), np.asarray(sound.frames.data))
    return "" if same else "frames differ and nothing says so"


CLOCKED = False
PARTS: dict[str, Part] = {"damaged": rows}
