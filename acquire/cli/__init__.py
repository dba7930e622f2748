"""The command line, ``acquire``. Each command's work is imported when it is called, so that ``--help`` stays quick."""

from __future__ import annotations

import sys


def main() -> None:
    """Entry point of the ``acquire`` command; exits with the status of the contract (0, 2, 3, 4, 5)."""
    from acquire.cli.app import run

    sys.exit(run())
