"""Requests of other threads to one thread: in order, each with an answer, void as soon as something overtakes it."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from typing import Any, TypeVar

T = TypeVar("T")


class Requests:
    """Actions that wait for the thread that owns this; thread-safe."""

    def __init__(self, wake: threading.Event) -> None:
        """``wake`` is set when there is something to do."""
        self._waiting: deque[tuple[Callable[[], Any], Future[Any]]] = deque()
        self._wake = wake

    def ask(self, action: Callable[[], T]) -> Future[T]:
        """Have ``action`` carried out, after earlier requests."""
        future: Future[T] = Future()
        self._waiting.append((action, future))
        self._wake.set()
        return future

    def take(self) -> Iterator[tuple[Callable[[], Any], Future[Any]]]:
        """Waiting requests, one by one, save those that are void already. For the owning thread, which answers each."""
        while self._waiting:
            action, future = self._waiting.popleft()
            if future.set_running_or_notify_cancel():
                yield action, future

    def void(self) -> None:
        """Cancel requests that have not begun."""
        for _, future in tuple(self._waiting):
            future.cancel()

    def refuse(self, error: Exception) -> None:
        """Answer everything that waits with ``error``. For the owning thread, at its end."""
        for _, future in self.take():
            future.set_exception(error)
