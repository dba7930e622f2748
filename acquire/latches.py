"""An emergency stop outlives the program in which a person pressed it, until a person acknowledges it.

A trip latches in its engine. If that program then ends, or dies, the next one must not simply go on: the latch of a
real instrument is kept as a file in the user's runtime folder. A restart of the computer forgets it.
"""

from __future__ import annotations

import hashlib
import json
import logging
from pathlib import Path

from drivers.claims import canonical, runtime_folder, whoami
from drivers.device import DeviceError, Faulted

log = logging.getLogger(__name__)


def latch(address: str, reason: str) -> None:
    """Keep that the instrument at ``address`` was stopped by a person. Where that cannot be kept it is logged."""
    try:
        path = _path(address)
        path.touch(mode=0o600)
        path.write_text(json.dumps({**whoami(), "reason": reason}))
    except (OSError, DeviceError) as error:
        log.error("the emergency stop is not kept beyond this program: %s", error)


def acknowledge(address: str) -> None:
    """A person has looked. Raises OSError, DeviceError."""
    _path(address).unlink(missing_ok=True)


def check(name: str, address: str) -> None:
    """Raises Faulted where an emergency stop of the instrument waits for a person."""
    path = _path(address)
    if not path.exists():
        return
    try:
        told = json.loads(path.read_text())
        what = f"{told['reason']} ({told['since']}, in {told['program']})"
    except (OSError, ValueError, KeyError):
        what = "emergency stop"
    raise Faulted(
        f"{name}: {what} was never acknowledged: look at the person and the instrument, then acknowledge it "
        "(acquire safe, or Reset in the window)"
    )


def _path(address: str) -> Path:
    return runtime_folder() / f"estop-{hashlib.sha256(canonical(address).encode()).hexdigest()[:24]}.json"
