"""Progress of a run on a terminal, and how a person ends it.

Progress of long work: a bar on a terminal, plain lines elsewhere; on stderr, so that stdout holds results only."""

from __future__ import annotations

import contextlib
import sys
import time
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Any

from acquire.signals import caught

if TYPE_CHECKING:
    from acquire.engine import Progress
    from acquire.session import Session

LINES = 10.0  # s of wall time between two plain lines


class Stop:
    """Has Ctrl-C, a polite kill and a closed terminal end a session's work. Use as a context manager.

    They are caught from the first moment: a signal before `ends` is kept for it.
    """

    def __init__(self) -> None:
        self._reason = ""
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
