"""The bytes of a journal, read by position and ahead."""

from __future__ import annotations

import os
import threading
import weakref
from pathlib import Path

SECTOR = 4096  # bytes that a disk gives or refuses at once
WINDOW = 1 << 20  # bytes read ahead


class JournalBytes:
    """The bytes of a journal by position, read through a descriptor of its own: also when the name is gone.

    Bytes that the disk cannot give read as zeros, which are no record; ``fault`` is then the disk's reason.
    """

    def __init__(self, path: Path, descriptor: int | None = None) -> None:
        """``descriptor`` is the open journal where there is one already. Raises OSError, FileNotFoundError."""
        self.path = path
        self.fault = ""
        if descriptor is None:
            descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_BINARY", 0))
        else:
            descriptor = os.dup(descriptor)
        self._descriptor = descriptor
        self._lock = threading.Lock()
        self.close = weakref.finalize(self, os.close, descriptor)
        self.size = os.fstat(descriptor).st_size

    def read(self, start: int, length: int) -> bytes:
        """Up to ``length`` bytes from ``start``; fewer at the end."""
        try:
            return self._read(start, length)
        except OSError as error:
            self.fault = os.strerror(error.errno or 0)
        parts = []
        for sector in range(start, min(start + length, self.size), SECTOR):
            size = min(SECTOR, start + length - sector)
            try:
                parts.append(self._read(sector, size))
            except OSError:
                parts.append(bytes(min(size, self.size - sector)))
        return b"".join(parts)

    def _read(self, start: int, length: int) -> bytes:
        parts = []
        with self._lock:
            os.lseek(self._descriptor, start, os.SEEK_SET)
            while length > 0 and (part := os.read(self._descriptor, length)):
                parts.append(part)
                length -= len(part)
        return b"".join(parts)


class Window:
    """Reads ahead, so that small records do not cost a system call each."""

    def __init__(self, data: JournalBytes) -> None:
        self._data, self._start, self._held = data, 0, b""

    def view(self, position: int, length: int) -> memoryview:
        """``length`` bytes from ``position``, fewer at the end."""
        first = position - self._start
        if first < 0 or first + length > len(self._held):
            self._start, first = position, 0
            self._held = self._data.read(position, max(length, WINDOW))
        return memoryview(self._held)[first : first + length]

    def find(self, what: bytes, position: int) -> int:
        """Where ``what`` is next from ``position`` on; the journal's size if nowhere."""
        while position < self._data.size:
            part = bytes(self.view(position, min(WINDOW, self._data.size - position)))
            found = part.find(what)
            if found >= 0:
                return position + found
            if len(part) < WINDOW:
                break
            position += len(part) - len(what) + 1
        return self._data.size
