"""Checksums in a recording: one of every dataset, and one of everything else (names, attributes, shapes).

HDF5 itself notices damage only in compressed datasets. The attribute ``crc32`` of a dataset is that of its values
in C order; ``checksum`` of ``/entry`` covers the names, types, shapes and attributes of everything below it.
"""

from __future__ import annotations

import zlib
from typing import Any

import h5py
import numpy as np

OF_DATA, OF_ALL = "crc32", "checksum"


def of_data(value: Any) -> int:
    """CRC32 of a dataset's values; of a text without the zeros that fill it up."""
    array = np.asarray(value)
    content = np.ascontiguousarray(array).tobytes()
    return zlib.crc32(content.rstrip(b"\0") if array.dtype.kind == "S" else content)


def of_structure(entry: h5py.Group) -> int:
    """CRC32 of everything in ``entry`` but the values of its datasets."""
    crc = _attributes(entry, 0)
    pending: list[tuple[str, h5py.Group]] = [("", entry)]
    while pending:
        path, group = pending.pop()
        for name in sorted(group):
            item = group.get(name)
            where = f"{path}/{name}"
            crc = zlib.crc32(where.encode(errors="replace"), crc)
            if isinstance(item, h5py.Group):
                pending.append((where, item))
            elif isinstance(item, h5py.Dataset):
                crc = zlib.crc32(f"{item.dtype.descr} {item.shape}".encode(), crc)
            if item is not None:
                crc = _attributes(item, crc)
    return crc


def _attributes(item: h5py.HLObject, crc: int) -> int:
    for name in sorted(item.attrs):
        if name != OF_ALL:
            crc = zlib.crc32(name.encode(errors="replace"), crc)
            crc = zlib.crc32(np.ascontiguousarray(item.attrs[name]).tobytes(), crc)
    return crc
