"""Checks that an HDF5 file from anywhere must pass before a value of it is read.

A file may name other files (external links, external storage, virtual datasets), ask for a filter that is loaded from a
plugin folder, or declare terabytes it does not hold. Such a file is refused as a whole.
"""

from __future__ import annotations

from pathlib import Path

import h5py

from acquire.recording.model import RecordingError

MAX_OBJECTS = 20_000
MAX_BYTES = 2**31  # of one dataset that is read whole; frames are read lazily and only have to be backed by storage
DEFLATE_LIMIT = 1100  # deflate cannot shrink data more than 1032 times
KNOWN_FILTERS = {h5py.h5z.FILTER_DEFLATE, h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_FLETCHER32}


def check_file(file: h5py.File, path: Path) -> None:
    """Walk every link of ``file``. Raises RecordingError that names the first object that is not acceptable."""
    seen: set[int] = set()
    pending: list[h5py.Group] = [file]
    while pending:
        group = pending.pop()
        for name in group:
            where = f"{group.name.rstrip('/')}/{name}"
            link = group.get(name, getlink=True)
            if isinstance(link, h5py.ExternalLink):
                raise RecordingError(f"{path}: {where} is an external link to {link.filename!r}; refused")
            if isinstance(link, h5py.SoftLink):
                # A recording has none, and one that leads back up would be followed for ever.
                raise RecordingError(f"{path}: {where} is a soft link to {link.path!r}; refused")
            item = group[name]
            address = h5py.h5o.get_info(item.id).addr
            if address in seen:
                continue
            seen.add(address)
            if len(seen) > MAX_OBJECTS:
                raise RecordingError(f"{path}: more than {MAX_OBJECTS} objects; refused")
            if isinstance(item, h5py.Group):
                pending.append(item)
            elif isinstance(item, h5py.Dataset):
                _check_dataset(item, path, where)
            else:
                raise RecordingError(f"{path}: {where} is neither a group nor a dataset; refused")


def _check_dataset(dataset: h5py.Dataset, path: Path, where: str) -> None:
    if dataset.external:
        raise RecordingError(f"{path}: {where} keeps its data in the external file {dataset.external[0][0]!r}; refused")
    if dataset.is_virtual:
        raise RecordingError(f"{path}: {where} is a virtual dataset; refused")
    if h5py.check_vlen_dtype(dataset.dtype) or h5py.check_ref_dtype(dataset.dtype):
        raise RecordingError(f"{path}: {where} holds variable-length data or references; refused")
    plist = dataset.id.get_create_plist()
    unknown = {plist.get_filter(i)[0] for i in range(plist.get_nfilters())} - KNOWN_FILTERS
    if unknown:
        raise RecordingError(f"{path}: {where} needs the HDF5 filter(s) {sorted(unknown)}; refused")
    size, stored = int(dataset.size or 0) * dataset.dtype.itemsize, dataset.id.get_storage_size()
    if size > stored * DEFLATE_LIMIT:
        raise RecordingError(
            f"{path}: {where} claims {size} bytes of shape {dataset.shape} but stores {stored}; refused"
        )


def check_readable_whole(dataset: h5py.Dataset, path: Path) -> None:
    """Refuse a dataset too large to be taken into memory. Raises RecordingError."""
    size = int(dataset.size or 0) * dataset.dtype.itemsize
    if size > MAX_BYTES:
        raise RecordingError(f"{path}: {dataset.name} is {size} bytes; more than {MAX_BYTES} are not read at once")
