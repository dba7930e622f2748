"""Sessions on this computer, for other terminals: every session keeps a file that says so, locked while it lives.

The files lie in the user's runtime folder and are private. A file whose lock is free was left by a program that ended
without a word: it is told as long as a journal of its runs waits to be recovered, and forgotten after that. Not on
Windows, which has no such locks.
"""

from __future__ import annotations

import contextlib
import json
import logging
import os
import secrets
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drivers.claims import hold, runtime_folder, whoami
from drivers.device import DeviceError

if sys.platform != "win32":
    import fcntl

log = logging.getLogger(__name__)

SCHEMA = "status/1"
SILENT = 5.0  # s of wall time without news after which a living program does not respond
_KEPT = 7 * 86400.0  # s for which the file of a program that ended without a word is kept


class StatusFile:
    """This process's file. Where it cannot be kept, that is logged, and nothing else depends on it."""

    def __init__(self) -> None:
        self._descriptor: int | None = None
        self._who = whoami()
        try:
            self._path = runtime_folder() / f"session-{os.getpid()}-{secrets.token_hex(4)}.json"
            if sys.platform != "win32":
                self._descriptor = hold(self._path)
        except (OSError, DeviceError) as error:
            log.warning("no status is shown to other terminals: %s", error)

    def write(self, content: Mapping[str, Any]) -> None:
        """Write the present state."""
        if self._descriptor is None:
            return
        told = {"schema": SCHEMA, **self._who, "heard": time.monotonic(), "at": _wall(), **content}
        data = json.dumps(told, default=str).encode()
        try:
            os.pwrite(self._descriptor, data, 0)
            os.ftruncate(self._descriptor, len(data))
        except OSError as error:
            log.warning("status: %s", error)

    def close(self) -> None:
        """Nothing runs any more. Idempotent."""
        if self._descriptor is not None:
            with contextlib.suppress(OSError):
                self._path.unlink()
            os.close(self._descriptor)
            self._descriptor = None


@dataclass(frozen=True)
class Report:
    """The status of one session: ``content`` as written, whether it lives, for how long (s) it said nothing."""

    content: Mapping[str, Any]
    alive: bool
    silent: float

    @property
    def words(self) -> str:
        """How it is, for a person."""
        if not self.alive:
            return f"ENDED WITHOUT A WORD after {self.content['at']}"
        return f"DOES NOT RESPOND for {self.silent:.0f} s" if self.silent > SILENT else "runs"


def reports() -> list[Report]:
    """Every session of this user on this computer, and those that ended without a word and left a journal.

    The files of others that ended so are removed; nothing else is changed.
    """
    found = []
    for path in sorted(runtime_folder().glob("session-*.json")):
        with contextlib.suppress(OSError):
            content, alive = _read(path)
            if content is not None and not alive and not _left(content):
                path.unlink()
            elif content is not None:
                found.append(Report(content, alive, max(0.0, time.monotonic() - float(content["heard"]))))
    return found


def forget_the_dead(instruments: Mapping[str, str], *, now: float | None = None) -> None:
    """Remove status files of programs that ended without a word: about these instruments (name to address), or old."""
    with contextlib.suppress(OSError, DeviceError):
        for path in runtime_folder().glob("session-*.json"):
            content, alive = _read(path)
            if alive or content is None:
                continue
            theirs = {(row["name"], row["address"]) for row in content["instruments"]}
            if theirs <= set(instruments.items()) or (now or time.time()) - path.stat().st_mtime > _KEPT:
                path.unlink()


def _left(content: Mapping[str, Any]) -> bool:
    """Whether a session that ended left a journal. One whose folder is not named may be anywhere."""
    journals = [Path(row["journal"]) for row in content["instruments"] if row.get("journal")]
    return any(not journal.is_absolute() or journal.exists() for journal in journals)


def _read(path: Path) -> tuple[dict[str, Any] | None, bool]:
    """A file's content (None where it makes no sense), and whether its writer lives."""
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
            alive = False
        except BlockingIOError:
            alive = True
        for _ in range(5):  # its writer may be in the middle of it
            data = os.pread(descriptor, 2**20, 0)
            with contextlib.suppress(ValueError):
                content = json.loads(data)
                if isinstance(content, dict) and content.get("schema") == SCHEMA:
                    return content, alive
            time.sleep(0.01)
        return None, alive
    finally:
        os.close(descriptor)


def _wall() -> str:
    return time.strftime("%Y-%m-%d %H:%M:%S")
