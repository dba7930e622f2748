"""Recordings: the journal written while running, the verified HDF5 file, reading, importing and exporting them."""

from acquire.recording.hdf5 import write_recording
from acquire.recording.hdf5_reader import open_recording
from acquire.recording.journal import JournalFull, JournalWriter
from acquire.recording.model import Event, Frames, Recording, RecordingError, RunInfo, Series
from acquire.recording.recovery import finalise, read_journal, recover

__all__ = [
    "Event",
    "Frames",
    "JournalFull",
    "JournalWriter",
    "Recording",
    "RecordingError",
    "RunInfo",
    "Series",
    "finalise",
    "open_recording",
    "read_journal",
    "recover",
    "write_recording",
]
