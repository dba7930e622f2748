"""Recordings: the journal written while running, the verified HDF5 file, reading, importing and exporting them."""

from dataclasses import replace
from pathlib import Path

from acquire.recording.bundle import read_bundle
from acquire.recording.bundle_export import write_bundle
from acquire.recording.hdf5 import write_recording
from acquire.recording.hdf5_reader import faults, open_head, open_info, open_recording, salvage
from acquire.recording.journal import JournalFull, JournalWriter
from acquire.recording.journal_reader import read_journal
from acquire.recording.lock import JournalBusy
from acquire.recording.model import Decision, Event, Frames, Recording, RecordingError, RunInfo, SegmentRecord, Series
from acquire.recording.recovery import finalise, put_by, recover, settle
from acquire.recording.review import counted, decide, decisions, left_out

__all__ = [
    "Decision",
    "Event",
    "Frames",
    "JournalBusy",
    "JournalFull",
    "JournalWriter",
    "Recording",
    "RecordingError",
    "RunInfo",
    "SegmentRecord",
    "Series",
    "counted",
    "decide",
    "faults",
    "finalise",
    "left_out",
    "load",
    "open_head",
    "open_info",
    "open_recording",
    "put_by",
    "read_bundle",
    "read_journal",
    "recover",
    "salvage",
    "settle",
    "write_bundle",
    "write_recording",
]


def load(path: Path | str) -> Recording:
    """The recording at ``path``: a recording file, a bundle's folder or its recording.yaml, or a journal.

    Raises RecordingError or FileNotFoundError.
    """
    path = Path(path)
    if path.is_dir() or path.suffix in (".yaml", ".yml"):
        bundle = read_bundle(path)
        folder = path if path.is_dir() else path.parent
        return replace(bundle, decisions=decisions(folder, bundle.info.id))
    return read_journal(path) if path.suffix == ".journal" else open_recording(path)
