"""Who writes a journal: a lock that the system takes back when the process ends, however it ends.

POSIX locks the file (``flock``), Windows one byte far beyond its end (locks there keep readers out). On a disk without
locks a journal that was written to within `FRESH` seconds counts as being written.
"""

from __future__ import annotations

import contextlib
import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from acquire.recording.model import RecordingError

if sys.platform == "win32":  # pragma: no cover - POSIX machines run the tests
    import msvcrt
else:
    import fcntl

FRESH = 10.0  # s since the last write
_FAR = 2**62  # no journal is as long


class JournalBusy(RecordingError):
    """Another program writes the journal, or makes a recording of it."""


def lock(descriptor: int, path: Path, *, patience: float = 0.3) -> bool:
    """Hold the open journal until ``descriptor`` is closed; False on a disk that has no locks.

    Raises JournalBusy after ``patience`` s.
    """
    deadline = time.monotonic() + patience  # somebody may just be asking `is_live`
    while True:
        try:
            _lock(descriptor)
            return True
        except BlockingIOError:
            if time.monotonic() >= deadline:
                message = "is in use: a run is being recorded into it, or it is being recovered"
                raise JournalBusy(f"{path}: {message}") from None
            time.sleep(0.02)
        except OSError:
            return False


@contextlib.contextmanager
def held(path: Path, *, patience: float = 0.3) -> Iterator[int]:
    """The journal at ``path``, open for reading and locked. Raises JournalBusy, FileNotFoundError, OSError."""
    descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_BINARY", 0))
    try:
        if not lock(descriptor, path, patience=patience) and time.time() - os.fstat(descriptor).st_mtime < FRESH:
            raise JournalBusy(f"{path}: was written to a moment ago: a run may be going on")
        yield descriptor
    finally:
        os.close(descriptor)


def is_live(path: Path) -> bool:
    """Whether some program holds the journal at ``path`` now."""
    try:
        with held(path, patience=0.0):
            return False
    except JournalBusy:
        return True
    except OSError:
        return False


def _lock(descriptor: int) -> None:
    if sys.platform == "win32":  # pragma: no cover
        here = os.lseek(descriptor, 0, os.SEEK_CUR)
        os.lseek(descriptor, _FAR, os.SEEK_SET)
        try:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        except OSError as error:
            raise BlockingIOError(*error.args) from None
        finally:
            os.lseek(descriptor, here, os.SEEK_SET)
    else:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
