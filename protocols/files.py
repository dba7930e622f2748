"""Files that other people made: read within a bound, and whatever is wrong with one is told in a line that names it.

`contents` is how a whole file is read, `refusing` surrounds whatever decodes it, `inside` keeps a name that a file
mentions within that file's folder, and `number` is the one spelling of numbers in text.
"""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

#: A number in text, without further spellings of Python's ``float``: ``3_0``, foreign digits, ``nan``, ``infinity``.
NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)
#: Characters that no file of ours can hold: NUL ends a text in HDF5, and half a surrogate pair is no character.
UNSTORABLE = re.compile("[\0\ud800-\udfff]")
LONGEST = 300  # characters of a foreign error's words that are passed on


def number(text: str) -> float:
    """The number that ``text`` spells, blanks around it allowed. Raises ValueError."""
    if not NUMBER.fullmatch(text.strip()):
        raise ValueError(f"{text[:LONGEST]!r} is not a number")
    return float(text)


def contents(path: Path | str, limit: int) -> bytes:
    """All bytes of the regular file ``path``.

    Raises FileNotFoundError, and ValueError for a path that cannot be opened, anything but a file (a pipe would be
    waited for without end), and more than ``limit`` bytes; each names the file.
    """
    path = Path(path)
    try:
        # A pipe that nobody writes to would hold up a plain open.
        descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    except FileNotFoundError:
        raise FileNotFoundError(f"{path}: no such file") from None
    except (OSError, ValueError) as error:
        raise ValueError(f"{path}: cannot be read: {in_words(error)}") from error
    with os.fdopen(descriptor, "rb") as file:
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            raise ValueError(f"{path}: not a file")
        with refusing(path):
            raw = file.read(limit + 1)
    if len(raw) > limit:
        size = f"{limit // 2**20} MB" if limit >= 2**20 else f"{limit // 2**10} kB"
        raise ValueError(f"{path}: larger than {size}")
    return raw


def is_file(path: Path | str) -> bool:
    """Whether ``path`` is a regular file; a name that no file can have (too long, with a NUL) is none."""
    try:
        return Path(path).is_file()
    except (OSError, ValueError):
        return False


def inside(folder: Path, name: str) -> Path:
    """The file ``name`` in ``folder``. Raises ValueError where it leads out of the folder, or is no name of a file."""
    try:
        # Links are followed first: one that points outside leads out.
        within = (folder / name).resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError, ValueError) as error:  # RuntimeError: links in a circle
        raise ValueError(f"{shortened(name)!r} is no file: {in_words(error)}") from error
    if not within:
        raise ValueError(f"{shortened(name)!r} lies outside {folder.name or 'its folder'}")
    return folder / name


@contextmanager
def refusing(path: Path | str, error: type[ValueError] = ValueError, what: str = "cannot be read") -> Iterator[None]:
    """Whatever goes wrong while a stranger's file is decoded becomes an ``error`` ``<path>: <what>: <why>``.

    Decoders raise of all kinds (RecursionError, MemoryError, AttributeError … out of third parties' code); the file is
    to blame for all of them. An ``error`` of ours already has its message and passes.
    """
    try:
        yield
    except error as known:
        if error is not ValueError:
            raise
        raise ValueError(f"{path}: {what}: {in_words(known)}") from known
    except Exception as foreign:
        raise error(f"{path}: {what}: {in_words(foreign)}") from foreign


def in_words(error: BaseException) -> str:
    """The message of an exception, in one short line."""
    if isinstance(error, RecursionError):
        return "nested too deeply"
    if isinstance(error, MemoryError):
        return "it needs more memory than there is"
    if isinstance(error, UnicodeError):
        return "not UTF-8 text"
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return shortened(" ".join(str(error).split())) or type(error).__name__


def shortened(text: str, longest: int = LONGEST) -> str:
    """``text``, its middle left out where it is longer than ``longest`` characters."""
    return text if len(text) <= longest else f"{text[: longest // 2]} … {text[-longest // 2 :]}"
