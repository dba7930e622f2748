"""Files that are whole or not there: the one way in which anything is written for keeps.

The content goes to a new file of a private name in the target's folder, is put onto the disk, and only then gets
its final name. A full disk, a read-only folder or a killed process leaves no half file under the final name, and a
symbolic link in the target's place is replaced, never followed.
"""

from __future__ import annotations

import contextlib
import errno
import os
import secrets
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PARTIAL = ".partial"  # the ending of an unfinished file; a killed process may leave such a file, which is worthless
JOURNAL, HDF5 = ".journal", b"\x89HDF\r\n\x1a\n"  # how a run's journal is called, and how every HDF5 file begins
PRIVATE, SHARED = 0o600, 0o666  # modes of new files, the latter less the umask


class CannotWrite(ValueError):
    """A file could not be written: the disk is full, read-only or gone, or the name is taken. Nothing was changed."""


@contextlib.contextmanager
def whole_file(path: Path | str, *, mode: int = SHARED, overwrite: bool = True) -> Iterator[BinaryIO]:
    """A new file, open for writing and reading in binary, that becomes ``path`` when the block ends without an error.

    Its ``name`` is where it lies meanwhile, for libraries that want a path. Missing folders are made. Raises
    FileExistsError if ``path`` exists and may not be overwritten, CannotWrite where the disk refuses.
    """
    path = Path(path)
    if not overwrite and os.path.lexists(path):
        raise FileExistsError(f"{path}: exists already; it is not overwritten")
    with told(path):
        _make_folder(path.parent)
        partial = _partial(path)
        no_link = getattr(os, "O_NOFOLLOW", 0)
        file = open(partial, "x+b", opener=lambda name, flags: os.open(name, flags | no_link, mode))  # noqa: SIM115
    try:
        with told(path), file:
            yield file
            file.flush()
            _keep(file, partial, path, overwrite)
    finally:
        partial.unlink(missing_ok=True)


def nameless(folder: Path, mode: int = PRIVATE) -> BinaryIO:
    """A new file in ``folder`` that is gone when it is closed, or its process dies, unless `named` names it.

    Raises OSError where the system or the disk has no such files (Linux has).
    """
    kind = getattr(os, "O_TMPFILE", 0)
    if not kind:
        raise OSError(errno.ENOTSUP, os.strerror(errno.ENOTSUP))
    return os.fdopen(os.open(folder, os.O_RDWR | kind, mode), "r+b", buffering=0)


@contextlib.contextmanager
def named(file: BinaryIO, path: Path) -> Iterator[Path]:
    """Where a `nameless` file lies meanwhile; it becomes ``path`` when the block ends without an error.

    Raises FileExistsError if ``path`` exists, CannotWrite where the disk refuses.
    """
    partial = _partial(path)
    try:
        with told(path):
            # Only with a folder's descriptor does Python follow the link that stands for an open file.
            folder = os.open("/proc/self/fd", os.O_RDONLY)
            try:
                os.link(str(file.fileno()), partial, src_dir_fd=folder, follow_symlinks=True)
            finally:
                os.close(folder)
            yield partial
            _keep(file, partial, path, overwrite=False)
    finally:
        partial.unlink(missing_ok=True)


@contextlib.contextmanager
def whole_folder(path: Path | str) -> Iterator[Path]:
    """A new folder that becomes ``path`` when the block ends without an error; ``path`` may be an empty folder already.

    Raises CannotWrite if there is something in ``path``, or where the disk refuses.
    """
    path = Path(path)
    with told(path):
        if os.path.lexists(path) and (path.is_symlink() or not path.is_dir() or any(path.iterdir())):
            raise CannotWrite(f"{path}: is not empty; a folder of its own is needed")
        _make_folder(path.parent)
        partial = _partial(path)
        partial.mkdir(mode=0o777)
    try:
        with told(path):
            yield partial
            for folder, _, names in os.walk(partial):
                for name in names:
                    _sync(Path(folder) / name)
            with contextlib.suppress(FileNotFoundError):
                path.rmdir()
            partial.rename(path)
            sync_folder(path.parent)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def write_text(path: Path | str, text: str) -> Path:
    """Write ``text`` (UTF-8, line ends as they are) to ``path``, which may exist if it is no recording.

    Raises CannotWrite.
    """
    _spare_recording(Path(path))
    with whole_file(path) as file:
        file.write(text.encode())
    return Path(path)


def write_figure(figure: Figure, path: Path | str, dpi: float) -> Path:
    """Write a picture to ``path`` in the format its suffix names. Raises CannotWrite, ValueError for no such format."""
    path = Path(path)
    _spare_recording(path)
    with whole_file(path) as file:
        figure.savefig(file, format=path.suffix.lstrip(".").lower() or "png", dpi=dpi)
    return path


def _spare_recording(path: Path) -> None:
    """Raises CannotWrite where ``path`` is a recording, or a run's journal: a person gave the wrong name."""
    with contextlib.suppress(OSError), path.open("rb") as file:
        if path.suffix == JOURNAL or file.read(len(HDF5)) == HDF5:
            raise CannotWrite(f"{path}: is a recording; it is not overwritten")


def sync_folder(folder: Path) -> None:
    """Make a rename in ``folder`` durable (POSIX; other systems do so by themselves)."""
    if os.name == "posix":
        _sync(folder)


@contextlib.contextmanager
def told(path: Path | str) -> Iterator[None]:
    """Have an error of the operating system told as `CannotWrite` with ``path`` and the reason in plain words."""
    try:
        yield
    except FileExistsError:
        raise
    except OSError as error:
        # h5py puts a paragraph into the text; the number says it in three words.
        reason = os.strerror(error.errno) if error.errno else str(error)
        raise CannotWrite(f"{path}: cannot be written: {reason}") from error


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError as error:  # there is a file in its place
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR)) from error


def _partial(path: Path) -> Path:
    # Not the whole name: together with the random part it might be too long for the disk.
    return path.with_name(f".{path.name[:60]}-{secrets.token_hex(6)}{PARTIAL}")


def _keep(file: BinaryIO, partial: Path, path: Path, overwrite: bool) -> None:
    """Put the open ``file``, which lies at ``partial``, onto the disk and give it its final name."""
    os.fsync(file.fileno())
    if not os.path.samestat(os.fstat(file.fileno()), os.lstat(partial)):
        raise CannotWrite(f"{path}: cannot be written: another program replaced {partial.name}")
    _name(partial, path, overwrite)
    sync_folder(path.parent)


def _name(partial: Path, path: Path, overwrite: bool) -> None:
    """Give ``partial`` its final name; without ``overwrite`` never that of a file that appeared meanwhile."""
    if overwrite:
        os.replace(partial, path)
        return
    try:
        os.link(partial, path)
    except FileExistsError:
        raise FileExistsError(f"{path}: exists already; it is not overwritten") from None
    except OSError:  # a disk without hard links
        if os.path.lexists(path):
            raise FileExistsError(f"{path}: exists already; it is not overwritten") from None
        os.replace(partial, path)


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
