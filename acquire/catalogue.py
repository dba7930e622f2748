"""The recordings in a folder, as `acquire ls` and the window's browser list them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from acquire.recording.hdf5_reader import open_head
from acquire.recording.lock import is_live
from acquire.recording.model import RecordingError, RunInfo
from acquire.recording.review import left_out

FIELDS = (
    "id",
    "instrument",
    "device",
    "protocol_name",
    "subject",
    "site",
    "repeat",
    "specimen",
    "operator",
    "status",
    "start_time",
)
ALIASES = {"protocol": "protocol_name", "start": "start_time", "date": "start_time"}


@dataclass(frozen=True)
class Entry:
    """One file of the catalogue. ``info`` is None where ``problem`` names its fault.

    ``live`` marks the journal of a run that goes on (or of a recovery): nobody else may touch it now. ``left_out`` says
    why a run does not count with others ('' where it does).
    """

    path: Path
    info: RunInfo | None
    problem: str = ""
    live: bool = False
    left_out: str = ""


def catalogue(folder: Path | str, words: Iterable[str] = ()) -> list[Entry]:
    """Recordings and journals left by crashes under ``folder``, in the order of their start, that match all ``words``.

    A word is ``field=text`` (subject, site, instrument, protocol, status, repeat, …: the field contains the text) or
    any text that the file's name or one of the fields contains; case does not matter. Raises RecordingError for an
    unknown field, FileNotFoundError if there is no such folder.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise FileNotFoundError(f"{folder}: no such folder")
    words = list(words)
    for word in words:
        name, equals, _ = word.partition("=")
        if equals and ALIASES.get(name, name) not in FIELDS:
            raise RecordingError(f"unknown field {name!r} in the filter {word!r}; there is {', '.join(FIELDS)}")
    entries = [_entry(path) for path in sorted([*folder.rglob("*.h5"), *folder.rglob("*.journal")])]
    found = [entry for entry in entries if all(_matches(entry, word) for word in words)]
    return sorted(found, key=lambda entry: (entry.info.start_time if entry.info else "~", entry.path.name))


def _entry(path: Path) -> Entry:
    if path.suffix == ".journal":
        if is_live(path):
            return Entry(path, None, "a run is being recorded into it now", live=True)
        return Entry(path, None, f"left by a crash: acquire recover {path}")
    try:
        head = open_head(path)
        return Entry(path, head.info, left_out=left_out(head))
    except (RecordingError, OSError) as error:
        return Entry(path, None, str(error).removeprefix(f"{path}: "))


def _matches(entry: Entry, word: str) -> bool:
    name, equals, text = word.partition("=")
    if equals:
        return entry.info is not None and text.lower() in str(getattr(entry.info, ALIASES.get(name, name))).lower()
    fields = [str(getattr(entry.info, field)) for field in FIELDS] if entry.info else [entry.problem]
    return any(word.lower() in field.lower() for field in [entry.path.name, *fields])
