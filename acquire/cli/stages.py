"""A line on the terminal with the running stage and the time it may take."""

from __future__ import annotations

import time
from types import TracebackType
from typing import Self, TextIO

SURE = 0.1
"""Share of the work before which no estimate is given."""


class Stages:
    """Called with the name of a stage and the share of the work that is usually over when it begins; silent where
    ``stream`` is no terminal."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream if stream.isatty() else None
        self._begin = time.monotonic()

    def __call__(self, stage: str, share: float) -> None:
        if self._stream is None:
            return
        elapsed = time.monotonic() - self._begin
        left = f", about {elapsed * (1 - share) / share:.0f} s left" if SURE < share < 1 else ""
        self._stream.write(f"\r\x1b[K{elapsed:4.0f} s  {stage}{left}")
        self._stream.flush()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._stream is not None:
            self._stream.write("\r\x1b[K")
            self._stream.flush()
