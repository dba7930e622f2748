"""The links of one rig, together: the driven device's first, then the further sources'."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from typing import Any

from acquire.engine.link import LinkThread, Receiver
from drivers.device import Rig, Status

SAFE = 2.0  # s of wall time within which every device must confirm that it is safe


class Links:
    """Threads from `open` to `close`; none in between two of these."""

    def __init__(self, rig: Rig, receiver: Receiver, beat: Callable[[], int] | None) -> None:
        """``beat()`` counts the supervisor's permissions so far (None: no watchdog)."""
        self._rig, self._receiver, self._beat = rig, receiver, beat
        self._threads: list[LinkThread] = []

    def __iter__(self) -> Iterator[LinkThread]:
        return iter(self._threads)

    @property
    def device(self) -> LinkThread:
        """The driven device's link. Raises IndexError while there is none."""
        return self._threads[0]

    @property
    def status(self) -> Status | None:
        """The device's last status."""
        return self._threads[0].status if self._threads else None

    @property
    def found(self) -> str:
        """The state that an earlier host left behind, in words."""
        return self._threads[0].found if self._threads else ""

    def open(self, *, acknowledged: bool) -> dict[str, Future[Any]]:
        """Start every link; the results are the identities, by name of the source."""
        self._threads = [LinkThread(s, self._receiver, self._beat) for s in (self._rig.device, *self._rig.sources)]
        for thread in self._threads:
            thread.start()
        return {thread.source.name: thread.connect(acknowledged=acknowledged) for thread in self._threads}

    def make_safe(self) -> None:
        """Have every source made safe, at once and without waiting."""
        for thread in self._threads:
            thread.make_safe()

    def wait_safe(self) -> bool:
        """Whether every source has confirmed the last `make_safe` in time."""
        deadline = time.monotonic() + SAFE
        return all([thread.wait_safe(max(0.0, deadline - time.monotonic())) for thread in self._threads])

    def close(self) -> None:
        """Make safe, close and end all of them."""
        for thread in self._threads:
            thread.stop()
        for thread in self._threads:
            thread.join()
        self._threads = []
