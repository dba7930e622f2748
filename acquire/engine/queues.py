"""Two ways for data: to the recorder, where nothing may be lost, and to a screen, where only the newest counts."""

from __future__ import annotations

import collections
import threading
from collections.abc import Iterable
from typing import Generic, TypeVar

from drivers.signals import Block, Frame

T = TypeVar("T")


class Overflow(RuntimeError):
    """The recorder could not keep up: the queue is full and the run must stop rather than lose data."""


def nbytes(item: object) -> int:
    """Roughly how much memory a queued item holds."""
    if isinstance(item, Block):
        return 24 * len(item) + sum(v.nbytes for v in item.values.values())
    if isinstance(item, Frame):
        return item.image.nbytes
    return 256


class RecordQueue(Generic[T]):
    """A bounded queue that never drops: putting into a full one raises."""

    def __init__(self, capacity: int = 256 << 20) -> None:
        """``capacity`` in bytes."""
        self._capacity = capacity
        self._held = 0
        self._items: collections.deque[T] = collections.deque()
        self._changed = threading.Condition()

    @property
    def fill(self) -> float:
        """How full it is, 0 … 1."""
        return self._held / self._capacity

    def put(self, item: T) -> None:
        """Append. Raises Overflow when it does not fit."""
        size = nbytes(item)
        with self._changed:
            if self._held + size > self._capacity:
                raise Overflow(f"the recorder is {self._held / 1e6:.0f} MB behind")
            self._items.append(item)
            self._held += size
            self._changed.notify()

    def put_always(self, item: T) -> None:
        """Append whatever the fill: for the word that nothing more comes."""
        with self._changed:
            self._items.append(item)
            self._changed.notify()

    def take(self, timeout: float) -> list[T]:
        """Everything queued, after waiting at most ``timeout`` s for something."""
        with self._changed:
            if not self._items:
                self._changed.wait(timeout)
            items = list(self._items)
            self._items.clear()
            self._held = 0
        return items


class DisplayQueue(Generic[T]):
    """A bounded queue that drops the oldest: a slow screen stalls nothing. ``dropped`` counts lost items."""

    def __init__(self, capacity: int = 64) -> None:
        """``capacity`` in items."""
        self._items: collections.deque[T] = collections.deque(maxlen=capacity)
        self._lock = threading.Lock()
        self.dropped = 0

    def put(self, items: Iterable[T]) -> None:
        """Append, at the cost of the oldest."""
        with self._lock:
            for item in items:
                self.dropped += len(self._items) == self._items.maxlen
                self._items.append(item)

    def take(self) -> list[T]:
        """Everything queued; empties it. Never waits."""
        with self._lock:
            items = list(self._items)
            self._items.clear()
        return items
