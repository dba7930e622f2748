"""Sound files of every kind that we read, and ways to spoil them."""

from __future__ import annotations

import contextlib
import io
import json
import re
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from random import Random as QuickRandom

import h5py
import numpy as np

Random = np.random.Generator

#: What parsers stumble over: other notations, ends of text, huge and not finite numbers, deep nesting, odd characters.
_TEXTS = """
' " # % &a *a | > ~ , ; [ ] { } - ? : m mbar true null -1 2.5 -0
!!python/object/apply:os.system <<:*a -3_0 0x1F 1:30 1e999 -1e-999 nan inf .inf \\ud800
../../etc/passwd /etc/passwd =cmd|'calc'!A1 ,,,, 10**10**10 ä 😀 ٣
"""
TOKENS: list[bytes] = [
    *(text.encode() for text in _TEXTS.split()),
    *(
        b"\0",
        b"\xff\xfe",
        b"\xef\xbb\xbf",
        b"\xed\xa0\x80",
        b"\r",
        b"\t",
        b"\x1b[2J",
        b"\n\n",
        b"\n",
        b" ",
        b": ",
        b"- ",
    ),
    *(b"9" * 400, b"9" * 5000, b"1" * 20, b"[" * 3000, b"{a: " * 1000, b"(" * 500, b"x" * 5000),
]


def spoiled(data: bytes, random: Random, times: int = 0) -> bytes:
    """``data`` with up to four mutations of bytes, ranges or tokens."""
    out = bytearray(data)
    for _ in range(times or int(random.integers(1, 5))):
        _STEPS[random.integers(len(_STEPS))](out, random)
    return bytes(out)


def _spot(out: bytearray, random: Random) -> int:
    return int(random.integers(len(out) + 1))


def _flip(out: bytearray, random: Random) -> None:
    if out:
        out[int(random.integers(len(out)))] ^= 1 << int(random.integers(8))


def _set(out: bytearray, random: Random) -> None:
    if out:
        out[int(random.integers(len(out)))] = int(random.choice([0, 255, 127, 128, random.integers(256)]))


def _token(out: bytearray, random: Random) -> None:
    spot = _spot(out, random)
    out[spot:spot] = TOKENS[random.integers(len(TOKENS))]


def _replace(out: bytearray, random: Random) -> None:
    """A word or number becomes a token."""
    words = list(_words(out))
    if words:
        start, end = words[random.integers(len(words))]
        out[start:end] = TOKENS[random.integers(len(TOKENS))]


def _words(out: bytearray) -> list[tuple[int, int]]:
    return [match.span() for match in re.finditer(rb"[\w.+-]+", bytes(out[:100_000]))]


def _delete(out: bytearray, random: Random) -> None:
    spot = _spot(out, random)
    del out[spot : spot + int(random.choice([1, 4, 40, 400]))]


def _truncate(out: bytearray, random: Random) -> None:
    del out[_spot(out, random) :]


def _repeat(out: bytearray, random: Random) -> None:
    spot = _spot(out, random)
    piece = out[spot : spot + int(random.choice([1, 10, 100]))]
    out[spot:spot] = piece * int(random.choice([1, 10, 1000]))


def _numbers(out: bytearray, random: Random) -> None:
    """Four or eight bytes become a number that lengths and offsets should not be."""
    if len(out) > 8:
        spot = int(random.integers(len(out) - 8))
        form, value = [("<I", 0xFFFFFFFF), ("<I", 0x7FFFFFFF), ("<Q", 2**64 - 1), ("<Q", 2**40), ("<I", 0)][
            random.integers(5)
        ]
        out[spot : spot + struct.calcsize(form)] = struct.pack(form, value)


_STEPS: list[Callable[[bytearray, Random], None]] = [
    _flip, _set, _token, _replace, _replace, _delete, _truncate, _repeat, _numbers,
]  # fmt: skip


def spoil_message(data: bytes, random: QuickRandom) -> bytes:
    """A message of an instrument with one to three mutations: quick, as there are millions."""
    out = bytearray(data)
    for _ in range(1 + int(random.random() * 3)):
        spot = int(random.random() * len(out))
        match int(random.random() * 7):
            case 0 if out:
                out[spot] ^= 1 << int(random.random() * 8)
            case 1 if out:
                out[spot] = int(random.random() * 256)
            case 2:
                out[spot:spot] = random.randbytes(1 + int(random.random() * 8))
            case 3:
                del out[spot : spot + 1 + int(random.random() * 8)]
            case 4:
                del out[spot:]
            case 5:
                out[spot:spot] = out[spot : spot + 1 + int(random.random() * 24)]
            case _:
                out[spot:spot] = _NUMBERS[int(random.random() * len(_NUMBERS))]
    return bytes(out)


_NUMBERS = (b"nan", b"inf", b"-1", b"1e999", b"9" * 30, b"\0" * 4, b"\xff" * 4, b"\xff" * 8, b"\x80", b"\r", b"=", b",")


def spoil_workbook(data: bytes, random: Random) -> bytes:
    """A workbook of which one part is spoiled inside the archive, or the archive itself."""
    if random.random() < 0.3:
        return spoiled(data, random)
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as new:
        names = old.namelist()
        chosen = names[random.integers(len(names))] if random.random() < 0.5 else "xl/worksheets/sheet1.xml"
        for name in names:
            content = old.read(name)
            if name == chosen:
                content = _spoil_xml(content, random)
            new.writestr(name, content)
    return out.getvalue()


def _spoil_xml(content: bytes, random: Random) -> bytes:
    cell = int(random.integers(6))
    rows = range(4, 4 + 10 ** int(random.integers(1, 5)))
    far = b"".join(b'<row r="%d"><c r="XFD%d"><v>1</v></c></row>' % (n, n) for n in rows)
    tricks = [
        lambda: content.replace(b"A1:B", b"A1:XFD1048576", 1),
        lambda: content.replace(b"</sheetData>", far + b"</sheetData>"),
        lambda: content.replace(b"</sheetData>", b" " * 10 ** int(random.integers(4, 9)) + b"</sheetData>"),
        lambda: content.replace(b"<sheetData>", b"<x>" * 20_000 + b"<sheetData>"),
        lambda: b'<!DOCTYPE l [<!ENTITY a "aaaaaaaaaa">' + b"".join(
            b'<!ENTITY %c "%s">' % (98 + k, b"&%c;" % (97 + k) * 10) for k in range(9)
        ) + b"]><l>&j;</l>",
        lambda: spoiled(content, random),
    ]  # fmt: skip
    return tricks[cell]()


def spoil_hdf5(data: bytes, random: Random, folder: Path) -> bytes:
    """A recording whose bytes or objects are spoiled."""
    if random.random() < 0.6:
        return spoiled(data, random)
    path = folder / "spoiling.h5"
    path.write_bytes(data)
    with h5py.File(path, "r+") as file:
        names: list[str] = []
        file.visit(names.append)
        for _ in range(int(random.integers(1, 3))):
            name = names[random.integers(len(names))]
            with contextlib.suppress(KeyError, RuntimeError):  # a link made before leads nowhere, or in a circle
                if isinstance(file[name], h5py.Dataset | h5py.Group):
                    _spoil_object(file, name, random)
    content = path.read_bytes()
    path.unlink()
    return content


def _spoil_object(file: h5py.File, name: str, random: Random) -> None:
    other = str(random.choice(["/entry", "/entry/streams", "/nowhere", f"/{name}"]))
    made = [
        lambda: None,
        lambda: file.create_group(name),
        lambda: file.__setitem__(name, h5py.SoftLink(other)),
        lambda: file.__setitem__(name, h5py.ExternalLink("/etc/passwd", other)),
        lambda: file.create_dataset(name, data=np.zeros(3, np.complex128)),
        lambda: file.create_dataset(name, data=np.full((2, 3), np.nan)),
        lambda: file.create_dataset(name, data=np.array([b"\xff\xfe", b"\xed\xa0"])),
        lambda: file.create_dataset(name, (10**14,), "f8", chunks=(2**16,)),
        lambda: file.create_dataset(name, data=np.array(["x"], h5py.string_dtype())),
        lambda: file.create_dataset(name, data=h5py.Empty("f8")),
        lambda: file.create_dataset(name, data=np.zeros(2, [("time", "f8"), ("text", "S4")])),
        lambda: file.create_dataset(name, data=np.int8(1)),
    ]
    if random.random() < 0.3:
        attribute = str(random.choice(["schema", "signal", "units", "range", "resolution", "scale", "axes"]))
        value = [np.nan, b"\xff\xfe", 2**63 - 1, "x" * 20_000, h5py.Empty("S1"), np.zeros((3, 3))][random.integers(6)]
        file[name].attrs[attribute] = value
        return
    del file[name]
    made[random.integers(len(made))]()


MAGIC, HEADER = b"SRJ1", struct.Struct("<4sIBQ")


def spoil_journal(data: bytes, random: Random) -> bytes:
    """A journal spoiled anywhere, or in a record whose checksum is right."""
    if random.random() < 0.5:
        return spoiled(data, random)
    records = []
    position = 0
    while position + HEADER.size <= len(data):
        _, length, kind, number = HEADER.unpack_from(data, position)
        start = position + HEADER.size
        records.append((kind, number, data[start : start + length]))
        position = start + length + 4
    chosen = int(random.integers(len(records)))
    kind, number, payload = records[chosen]
    if kind in (1, 2, 5, 6, 7) and random.random() < 0.5:
        payload = _spoil_json(payload, random)
    else:
        payload = spoiled(payload, random, 1)
    records[chosen] = (kind if random.random() < 0.9 else int(random.integers(10)), number, payload)
    if random.random() < 0.3:
        records += [records[random.integers(len(records))]] * int(random.integers(1, 200))
    return b"".join(record(*one) for one in records)


def record(kind: int, number: int, payload: bytes) -> bytes:
    """A record of a journal with its checksum."""
    head = HEADER.pack(MAGIC, len(payload), kind, number) + payload
    return head + struct.pack("<I", zlib.crc32(head))


def _spoil_json(payload: bytes, random: Random) -> bytes:
    content = json.loads(payload)
    value = [None, [], {}, -1, 1e308, "x", "\0", "\ud800", [[[1]]], {"a": {}}, True, 2**70][random.integers(12)]
    place, key = content, str(random.choice(list(content)))
    while isinstance(place[key], dict) and place[key] and random.random() < 0.6:
        place = place[key]
        key = str(random.choice(list(place)))
    place[key] = value
    return b"[" * 50_000 if random.random() < 0.05 else json.dumps(content).encode()
