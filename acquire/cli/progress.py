"""Progress of long work: a bar on a terminal, plain lines elsewhere; on stderr, so that stdout holds results only."""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from acquire.engine import Progress

LINES = 10.0  # s of wall time between two plain lines


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
        """Show ``progress``."""
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
