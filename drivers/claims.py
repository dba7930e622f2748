"""One program per instrument: a claim on a link, which the system takes back when its process ends, however it ends.

Claims are locked files in the user's runtime folder and say who holds them. A serial port is locked by the system too,
and a simulated instrument turns a second host away by itself: that also holds between users, but names nobody.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import stat
import sys
import time
import warnings
from pathlib import Path
from typing import Any

from drivers.device import DeviceError, LinkLost

if sys.platform != "win32":
    import fcntl


def runtime_folder() -> Path:
    """The folder, this user's alone, for files of running processes. Raises DeviceError where it is not."""
    import platformdirs

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that it falls back to the folder for temporary files: checked here
        folder = Path(platformdirs.user_runtime_dir("skinrig"))
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if sys.platform != "win32":
        found = folder.lstat()
        if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.geteuid():
            raise DeviceError(f"{folder}: belongs to somebody else; set XDG_RUNTIME_DIR to a folder of yours")
        if stat.S_IMODE(found.st_mode) & 0o077:
            folder.chmod(0o700)
    return folder


def whoami() -> dict[str, Any]:
    """This process for others to read: its id, program, and when it claimed something."""
    name = Path(sys.argv[0]).name if sys.argv else ""
    program = " ".join(["python" if name in ("", "-c") else name, *sys.argv[1:2]])
    return {"pid": os.getpid(), "program": program[:80], "since": time.strftime("%Y-%m-%d %H:%M:%S")}


def hold(path: Path, *, create: bool = True) -> int | None:
    """A descriptor that holds the lock of the file at ``path``; None while another one does. Raises OSError."""
    flags = os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW | (os.O_CREAT if create else 0)
    while True:
        descriptor = os.open(path, flags, 0o600)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.fstat(descriptor).st_nlink:  # not removed by who held it, between our opening and our locking
                return descriptor
        except BlockingIOError:
            os.close(descriptor)
            return None
        os.close(descriptor)


class Claim:
    """The right to drive the instrument behind one address. `release` gives it back."""

    def __init__(self, address: str) -> None:
        """Raises LinkLost that names who holds it."""
        self._descriptor: int | None = None
        if sys.platform == "win32":  # there a serial port has one owner anyway
            return
        name = hashlib.sha256(canonical(address).encode()).hexdigest()[:24]
        self._path = runtime_folder() / f"link-{name}.lock"
        self._descriptor = hold(self._path)
        if self._descriptor is None:
            raise LinkLost(f"link {address}: {_owner(self._path)} drives this instrument")
        os.ftruncate(self._descriptor, 0)
        os.write(self._descriptor, json.dumps(whoami()).encode())

    def release(self) -> None:
        """Give it back. Idempotent."""
        if self._descriptor is not None:
            with contextlib.suppress(OSError):
                self._path.unlink()
            os.close(self._descriptor)
            self._descriptor = None


def canonical(address: str) -> str:
    """One text for one link, however it is written."""
    if address.startswith("socket://"):
        return (
            address.rstrip("/").rpartition("@")[2].removeprefix("socket://").replace("localhost", "127.0.0.1").lower()
        )
    return os.path.realpath(address) if address.startswith("/") else address.lower()


def _owner(path: Path) -> str:
    try:
        who = json.loads(path.read_text())
        return f"{who['program']} (process {who['pid']}, since {who['since']})"
    except (OSError, ValueError, KeyError):  # it is just writing, or has just gone
        return "another program"
