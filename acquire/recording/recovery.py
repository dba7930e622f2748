"""From journal to recording: after a normal end (`finalise`) and after a crash (`recover`) alike."""

from __future__ import annotations

import contextlib
import logging
import os
import time
from dataclasses import replace
from itertools import count
from pathlib import Path

from acquire.files import sync_folder, told
from acquire.recording.draft import Draft
from acquire.recording.hdf5 import complete, write_recording
from acquire.recording.hdf5_reader import faults, open_info, open_recording
from acquire.recording.journal import JournalWriter
from acquire.recording.journal_bytes import JournalBytes
from acquire.recording.journal_reader import JournalFrames, read_content
from acquire.recording.lock import held
from acquire.recording.model import Event, Recording, RecordingError, missing_in

log = logging.getLogger(__name__)
RECOVERED = ".journal.recovered"  # how a journal ends that was recovered with damage
KEPT = 30  # days for which it stays beside its recording


def finalise(
    journal: JournalWriter | Path | str, path: Path | str, *, keep: bool = False, draft: Draft | None = None
) -> Path:
    """Write a run's ``journal`` to the recording ``path`` (verified, then renamed); the result is its path.

    The journal is closed, and removed if all of it is in the recording (unless ``keep``). If there is a file at
    ``path`` by now, it stays, and the recording is named ``<path>-2`` and so on. Data are read through the writer's
    open file, so that a run is saved whose journal was deleted meanwhile. A journal given by its path is recovered. A
    ``draft`` that has the frames already saves most of the time.

    Raises RecordingError, CannotWrite: the journal then stays, and stays open.
    """
    if not isinstance(journal, JournalWriter):
        return recover(journal, path, keep=keep)
    journal.end()
    data = JournalBytes(journal.path, journal.descriptor)
    try:
        recording, whole = read_content(data)
        target = _free(Path(path))
        _write(_with_contour(recording), target, draft)
    finally:
        data.close()
    remove = whole and not keep and not journal.gone()
    journal.close()
    if remove:
        _remove(journal.path)
    return target


def _write(recording: Recording, path: Path, draft: Draft | None) -> None:
    """Write by the draft if that is of use, else as a whole."""
    frames = recording.frames
    if draft is not None and frames is not None and isinstance(frames.data, JournalFrames):
        same = len(draft) == len(frames.data) and draft.folder == path.parent  # in the order in which they came
        try:
            if same:
                complete(draft, recording, path)
                return
        except (OSError, RuntimeError, ValueError) as error:
            log.warning("%s: the draft is of no use: %s", path, error)
    write_recording(recording, path)


def recover(journal: Path | str, path: Path | str | None = None, *, keep: bool = True) -> Path:
    """Make a recording of a ``journal`` that a crash left; ``path`` defaults to the journal's name with ``.h5``.

    A run whose end was not written has status ``recovered``. If ``path`` holds all of this very run already (the
    process died between the rename and the removal), it is left as it is. The journal stays unless ``keep`` is False
    and all of it is in the recording.

    Raises JournalBusy while the run goes on; RecordingError if the journal has no readable beginning, or ``path`` holds
    something else; CannotWrite, FileNotFoundError.
    """
    journal = Path(journal)
    if journal.suffix != ".journal":
        raise RecordingError(f"{journal}: not a journal (.journal)")
    path = journal.with_suffix(".h5") if path is None else Path(path)
    with held(journal, patience=1.0) as descriptor:
        data = JournalBytes(journal, descriptor)
        try:
            recording, whole = read_content(data)
            if os.path.lexists(path):
                _check_same(path, recording)
            else:
                write_recording(_with_contour(recording), path)
        finally:
            data.close()
        if whole and not keep:
            _remove(journal)
    return path


def settle(journal: Path | str, path: Path | str | None = None) -> Path:
    """Make a recording of a ``journal`` that a crash left, as `recover` does, so that it waits for nobody any more.

    It is removed if the verified recording holds all of it. One with damaged bytes gets the recording's name and the
    ending `RECOVERED`, and stays for `KEPT` days, in which an expert may look at them. Raises as `recover`.
    """
    journal = Path(journal)
    path = recover(journal, path, keep=False)
    if journal.exists():
        put_by(journal, path.stem)
    _tidy(journal.parent)
    return path


def put_by(journal: Path, name: str) -> None:
    """Keep a ``journal`` that nothing more can be had from beside its recording ``name``, out of the way of runs."""
    with told(journal):
        journal.touch()
        journal.rename(_free(journal.with_name(name + RECOVERED), RECOVERED))


def _tidy(folder: Path) -> None:
    """Remove the journals that were recovered more than `KEPT` days ago and have a recording that can be read."""
    for journal in folder.glob(f"*{RECOVERED}"):
        recording = journal.with_name(journal.name.removesuffix(RECOVERED) + ".h5")
        with contextlib.suppress(OSError, RecordingError):
            if time.time() - journal.stat().st_mtime > KEPT * 86400 and open_info(recording):
                journal.unlink()


def _check_same(path: Path, recording: Recording) -> None:
    there = open_recording(path)
    if there.info.id != recording.info.id:
        raise RecordingError(f"{path}: holds run {there.info.id}, not {recording.info.id}; it is not overwritten")
    if problem := missing_in(there, recording):
        raise RecordingError(f"{path}: does not hold all of the journal ({problem}); name another file")
    if found := faults(path):
        raise RecordingError(f"{path}: is damaged ({found[0].removeprefix(f'{path}: ')}); name another file")


def _free(path: Path, ending: str = "") -> Path:
    """``path``, or the first of ``<path>-2``, ``<path>-3`` … that is free; the number is put before its ``ending``."""
    ending = ending or path.suffix
    stem = path.name.removesuffix(ending)
    names = (path if number == 1 else path.with_name(f"{stem}-{number}{ending}") for number in count(1))
    return next(name for name in names if not os.path.lexists(name))


def _remove(journal: Path) -> None:
    with told(journal):
        journal.unlink()
        sync_folder(journal.parent)


def _with_contour(recording: Recording) -> Recording:
    """Contours from the frames are added, but no fault in reading them may cost the recording."""
    if recording.frames is None:
        return recording
    from acquire.analysis.frames import with_contour

    try:
        return with_contour(recording)
    except Exception as error:
        failed = Event(float(recording.frames.time[0]), "error", "contour", f"the frames could not be read: {error}")
        return replace(recording, events=(*recording.events, failed))
