"""Where HDF5 writes to: a file whose errors HDF5 never sees.

HDF5 that could not flush a file crashes the process when it closes it, or any other file later on: with it would go the
process that has a person under suction. So HDF5 is told that every write succeeded, and whoever writes asks `check`.
"""

from __future__ import annotations

import io
import os
from typing import BinaryIO, cast


class Sink:
    """A file object for ``h5py.File`` over ``file``, an open empty file.

    After the first error the disk is left alone, and what HDF5 still writes is kept in memory, so that it reads back
    what it wrote until it closes.
    """

    def __init__(self, file: BinaryIO) -> None:
        self._file = cast(io.FileIO, getattr(file, "raw", file))  # unbuffered: an error belongs to its own write
        self._position = 0
        self._size = 0
        self._error: OSError | None = None
        self._kept: list[tuple[int, bytes]] = []

    @property
    def size(self) -> int:
        """Length of the file."""
        return self._size

    def check(self) -> None:
        """Raises the OSError that the disk gave, if it gave one."""
        if self._error is not None:
            raise self._error

    # Called by h5py -----------------------------------------------------------------------------------------------

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Move to ``offset``."""
        self._position = offset + {os.SEEK_SET: 0, os.SEEK_CUR: self._position, os.SEEK_END: self._size}[whence]
        return self._position

    def tell(self) -> int:
        """The present position."""
        return self._position

    def write(self, data: memoryview | bytes) -> int:
        """Write ``data`` at the present position; never raises."""
        start, content = self._position, bytes(data)
        self._position += len(content)
        self._size = max(self._size, self._position)
        if self._error is None:
            try:
                self._file.seek(start)
                written = 0
                while written < len(content):
                    written += self._file.write(content[written:]) or 0
                return len(content)
            except OSError as error:
                self._error = error
        self._kept.append((start, content))
        return len(content)

    def read(self, size: int) -> bytes:
        """``size`` bytes from the present position."""
        content = bytearray(size)
        self.readinto(content)
        return bytes(content)

    def readinto(self, buffer: memoryview | bytearray) -> int:
        """Fill ``buffer`` from the present position; zeros where nothing was written."""
        view = memoryview(buffer).cast("B")
        start, content = self._position, bytearray(len(view))
        self._position += len(view)
        try:
            self._file.seek(start)
            read = self._file.read(len(view)) or b""
            content[: len(read)] = read
        except OSError as error:
            self._error = self._error or error
        for begin, kept in self._kept:
            first, last = max(begin, start), min(begin + len(kept), start + len(view))
            if first < last:
                content[first - start : last - start] = kept[first - begin : last - begin]
        view[:] = content
        return len(view)

    def truncate(self, size: int | None = None) -> int:
        """Set the length of the file; never raises."""
        self._size = self._position if size is None else size
        if self._error is None:
            try:
                self._file.truncate(self._size)
            except OSError as error:
                self._error = error
        return self._size

    def flush(self) -> None:
        """Nothing is held back."""
