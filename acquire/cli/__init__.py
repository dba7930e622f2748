"""The command line, ``acquire``. Each command's work is imported when it is called, so that ``--help`` stays quick."""

from __future__ import annotations

import signal
import sys


def main() -> None:
    """Entry point of the ``acquire`` command; exits with the status of the contract (0, 2, 3, 4, 5)."""
    try:
        from acquire.cli.app import run

        status = run()
    except KeyboardInterrupt:
        status = 5  # while the command line itself was being loaded: nothing was touched
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        if hasattr(signal, name):  # all is done and told: nothing that comes now may change the status
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    sys.exit(status)
