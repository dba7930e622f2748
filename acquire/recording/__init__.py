"""Recordings: the journal written while running, the verified HDF5 file, reading, importing and exporting them."""

from acquire.recording.hdf5 import open_recording, write_recording
from acquire.recording.model import Event, Frames, Recording, RecordingError, RunInfo, Series

__all__ = [
    "Event",
    "Frames",
    "Recording",
    "RecordingError",
    "RunInfo",
    "Series",
    "open_recording",
    "write_recording",
]
