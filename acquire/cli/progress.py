"""Progress of a run on a terminal, and how a person ends it.

Progress of long work: a bar on a terminal, plain lines elsewhere; on stderr, so that stdout holds results only."""

from __future__ import annotations

import contextlib
import os
import select
import sys
import time
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Any

from acquire.signals import caught

if TYPE_CHECKING:
    from acquire.engine import Progress
    from acquire.session import Session

LINES = 10.0  # s of wall time between two plain lines
LOOK = 0.1  # s between looks for a signal while a person is asked


class Stop:
    """Has Ctrl-C, a polite kill and a closed terminal end a session's work. Use as a context manager.

    They are caught from the first moment: a signal before `ends` is kept for it.
    """

    def __init__(self) -> None:
        self._reason = ""
        self._typed = b""
        self._session: Session | None = None
        self._caught: AbstractContextManager[None] = caught(self._act)

    def __enter__(self) -> Stop:
        self._caught.__enter__()
        return self

    def __exit__(self, *exc: Any) -> None:
        self._caught.__exit__(*exc)

    def ends(self, session: Session) -> None:
        """From now on it is ``session`` whose work ends."""
        self._session = session
        if self._reason:
            session.abort(self._reason)

    def check(self) -> None:
        """Raises Aborted once there was a signal: between two runs a session has nothing to end."""
        if self._reason:
            from acquire.engine import Aborted

            raise Aborted(self._reason)

    def line(self) -> str:
        """The next line that a person types, without its end; raises Aborted at a signal, and EOFError where no more
        comes.

        A stray Enter of before the question is no answer to it, at a terminal.
        """
        try:
            file = None if os.name == "nt" else sys.stdin.fileno()  # only POSIX waits for a file and a while at once
        except (OSError, ValueError):  # standard input is not the system's
            file = None
        if file is not None and os.isatty(file):
            import termios

            termios.tcflush(file, termios.TCIFLUSH)
            self._typed = b""
        while b"\n" not in self._typed:
            self.check()
            if file is None or select.select([file], [], [], LOOK)[0]:
                more = sys.stdin.readline().encode() if file is None else os.read(file, 4096)
                if not more:
                    raise EOFError
                self._typed += more
        self.check()
        line, _, self._typed = self._typed.partition(b"\n")
        return line.decode(errors="replace").strip()

    def _act(self, name: str) -> None:
        self._reason = f"aborted by a person ({name})"
        if self._session is not None:
            self._session.abort(self._reason)
        with contextlib.suppress(OSError):  # the terminal may be gone
            print(f"acquire: {name}: stopping", file=sys.stderr, flush=True)


class Reporter:
    """Shows a run's progress. Use as a context manager."""

    def __init__(self, title: str, duration: float) -> None:
        self._title = title
        self._duration = duration
        self._bar: Any = None
        self._task: Any = None
        self._told = -LINES

    def __enter__(self) -> Reporter:
        if sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
            from rich.progress import Progress as Bar

            columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[what]}"))
            self._bar = Bar(*columns, TimeRemainingColumn(), console=Console(stderr=True))
            self._bar.start()
            self._task = self._bar.add_task(self._title, total=self._duration, what="")
        return self

    def __exit__(self, *exc: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def update(self, progress: Progress) -> None:
        """Show ``progress``. Never raises: who no longer reads must not end a run."""
        with contextlib.suppress(OSError):
            self._show(progress)

    def _show(self, progress: Progress) -> None:
        if self._bar is not None:
            self._bar.update(self._task, completed=progress.elapsed, what=in_words(progress))
        elif time.monotonic() - self._told >= LINES:
            self._told = time.monotonic()
            print(f"{self._title}: {in_words(progress)}", file=sys.stderr, flush=True)


def in_words(progress: Progress) -> str:
    """One line: state, segment, labels, time."""
    labels = " ".join(f"{k} {v}" for k, v in progress.labels.items())
    where = f"segment {progress.segment + 1}/{progress.segments} {progress.phase}".strip()
    clock = f"{progress.elapsed:.1f} of {progress.duration:.1f} s"
    return ", ".join(part for part in (str(progress.state), where, labels, clock) if part)
