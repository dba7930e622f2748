"""Malformed input of every kind that comes from outside is refused with a message that says what and where.

Protocols, stations, bundles, recordings, journals and byte streams; each with the pattern of its message. The packages'
own tests go deeper; this is the list that one reads to see what happens to bad input.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from acquire.cli.app import BAD_INPUT, run
from acquire.recording import load, write_recording
from acquire.station import load_station
from drivers.aspiration.framelink import FrameDecoder, Picture
from drivers.aspiration.framelink import encode as encode_frame
from drivers.aspiration.pressure import PressureCodec
from drivers.cutometer.codec import CutometerCodec
from drivers.messages import Beat
from drivers.microrobot.codec import MicrorobotCodec
from protocols import load as load_protocol
from tests.acquire.recording.samples import sample_recording

PROTOCOL = """schema: protocol/1
name: step
instrument: cutometer
limits: {pressure: {low: -500 mbar, high: 0 mbar}}
steps:
- {type: hold, pressure: -300 mbar, duration: 2 s}
"""
PROTOCOLS = {
    r":2:1: nam: unknown key 'nam'; did you mean 'name'": ("name:", "nam:"),
    r":1:9: schema: .*protocol/3": ("protocol/1", "protocol/3"),
    r":3:13: instrument: 'cutmeter' is not known; did you mean 'cutometer'": ("cutometer", "cutmeter"),
    r":6:10: steps\[0\]\.type: unknown step type 'hodl'; did you mean 'hold'": ("hold,", "hodl,"),
    r":6:26: steps\[0\]\.pressure: 'mbr' is no unit of pressure": (
        "mbar, dur",
        "mbr, dur",
    ),
    r":6:47: steps\[0\]\.duration: a unit is missing": ("2 s", "2"),
    r":6:47: steps\[0\]\.duration: must be positive": ("2 s", "-2 s"),
    r":6:3: steps\[0\]\.duration: is missing": (", duration: 2 s", ""),
    r":5:1: steps: repeated key \(first in line 4\)": (
        "limits: {pressure: {low: -500 mbar, high: 0 mbar}}",
        "steps: []",
    ),
    r":2:7: .*anchors": ("name: step", "name: &x step"),
    r":6:1: not YAML": ("steps:", "steps: ["),
}

STATION = """schema: station/1
name: bench
instruments:
  cutometer:
    address: /dev/ttyUSB0
    limits: {pressure: {low: -450 mbar, high: 0 mbar}}
    calibration:
      opening: {value: 2 mm, provenance: assumed}
"""
STATIONS = {
    r":5:5: instruments\.cutometer\.adress: unknown key 'adress'; did you mean 'address'": ("address", "adress"),
    r":3:1: instrumnts: unknown key 'instrumnts'; did you mean 'instruments'": ("instruments", "instrumnts"),
    r":6:13: instruments\.cutometer\.limits: pressure\.low: 'mbra' is no unit of pressure": ("-450 mbar", "-450 mbra"),
    r":8:42: instruments\.cutometer\.calibration\.opening\.provenance: 'guessed' is not known": ("assumed", "guessed"),
    r":8:7: instruments\.cutometer\.calibration: 'N' is no unit of length": ("2 mm", "2 N"),
    r":1:9: schema: 'station/2' is not known; did you mean 'station/1'": ("station/1", "station/2"),
    r":6:13: instruments\.cutometer\.limits: pressure: the range is empty": ("high: 0 mbar", "high: -500 mbar"),
}

BUNDLE = """schema: recording-bundle/1
instrument: cutometer
channels:
  pressure: {file: data.csv, column: p, unit: mbar, time: {column: t, unit: s}}
"""
TABLE = "t,p\n0,0\n0.1,-300\n0.2,-300\n"
BUNDLES: dict[str, tuple[str, str]] = {
    r"recording\.yaml:3:1: chanels: unknown key": (BUNDLE.replace("channels", "chanels"), TABLE),
    r"recording\.yaml:4:20: channels\.pressure\.file: there is no file": (
        BUNDLE.replace("data.csv", "x.csv"),
        TABLE,
    ),
    r"recording\.yaml:4:47: channels\.pressure\.unit: channel pressure: 'mm' is m, .* Pa": (
        BUNDLE.replace("mbar", "mm"),
        TABLE,
    ),
    r"data\.csv: channel pressure: no column 'q'": (BUNDLE.replace("column: p", "column: q"), TABLE),
    r"data\.csv:3: channel pressure, column 'p': 'x' is not a number": (
        BUNDLE,
        TABLE.replace("-300\n0.2", "x\n0.2"),
    ),
    r"data\.csv:4: channel pressure, column 'p': 'nan' is not a finite": (
        BUNDLE,
        TABLE.replace("0.2,-300", "0.2,nan"),
    ),
    r"data\.csv:4: channel pressure, column 't': time goes back": (BUNDLE, TABLE.replace("0.2", "0.05")),
    r"data\.csv: there is no header row": (BUNDLE, ""),
    r"recording\.yaml:5:11: protocol: there is no file 'p\.yaml'": (BUNDLE + "protocol: p.yaml\n", TABLE),
}


def _external(file: h5py.File) -> None:
    file["entry/streams/spy"] = h5py.ExternalLink("/etc/passwd", "/")


def _virtual(file: h5py.File) -> None:
    layout = h5py.VirtualLayout(shape=(10,), dtype="f8")
    layout[:] = h5py.VirtualSource("/etc/hostname", "x", shape=(10,))
    del file["entry/streams/pressure/value"]
    file.create_virtual_dataset("entry/streams/pressure/value", layout)


def _bomb(file: h5py.File) -> None:
    del file["entry/streams/pressure/value"]
    file.create_dataset("entry/streams/pressure/value", (10**13,), "f8", chunks=(2**20,), compression="gzip")


def _without_time(file: h5py.File) -> None:
    del file["entry/streams/pressure/time"]


def _other_schema(file: h5py.File) -> None:
    file["entry"].attrs["schema"] = "acquire-recording/9"


RECORDINGS: dict[str, Callable[[h5py.File], None]] = {
    r"run\.h5: /entry/streams/spy is an external link to '/etc/passwd'": _external,
    r"run\.h5: /entry/streams/pressure/value is a virtual dataset": _virtual,
    r"run\.h5: /entry/streams/pressure/value claims 80000000000000 bytes": _bomb,
    r"run\.h5: /entry/streams/pressure/time is missing": _without_time,
    r"run\.h5: /entry has schema 'acquire-recording/9'": _other_schema,
}

BEAT = MicrorobotCodec().encode(Beat(1))
FRAME = encode_frame(Picture(np.zeros((4, 4), np.uint8), 1, 0.5))
# The bytes fed, and the decoder's words for those it drops; a good message must come through after them.
STREAMS: list[tuple[str, Any, bytes, str]] = [
    ("cutometer: noise", CutometerCodec, bytes(range(1, 200)) + CutometerCodec.TERMINATOR, "no checksum"),
    (
        "cutometer: one letter changed",
        CutometerCodec,
        CutometerCodec().encode(Beat(1)).replace(b"00", b"01"),
        "wrong checksum",
    ),
    ("cutometer: no end", CutometerCodec, b"x" * 200_000 + CutometerCodec.TERMINATOR, ""),
    ("pressure controller: noise", PressureCodec, b"\xff" * 50 + PressureCodec.TERMINATOR, "no checksum"),
    ("pressure controller: cut short", PressureCodec, PressureCodec().encode(Beat(1))[3:], "checksum|head|invalid"),
    ("robot: bad COBS", MicrorobotCodec, b"\x09abc\0", "packet of 4 bytes"),
    ("robot: short", MicrorobotCodec, b"\x02a\0", "short packet"),
    ("robot: bit flipped", MicrorobotCodec, bytes([BEAT[0], BEAT[1] ^ 1]) + BEAT[2:], "packet of"),
]


def refused(path: Path, load_it: Callable[[Path], object], message: str) -> None:
    """``load_it`` refuses ``path`` with a ValueError that names the file and matches ``message``."""
    with pytest.raises(ValueError, match=message) as caught:
        load_it(path)
    assert path.name in str(caught.value)


def changed(text: str, old: str, new: str) -> str:
    assert old in text
    return text.replace(old, new, 1)


@pytest.mark.parametrize("message", PROTOCOLS)
def test_protocol(tmp_path: Path, message: str) -> None:
    path = tmp_path / "protocol.yaml"
    path.write_text(changed(PROTOCOL, *PROTOCOLS[message]))
    refused(path, load_protocol, message)


@pytest.mark.parametrize("message", STATIONS)
def test_station(tmp_path: Path, message: str) -> None:
    path = tmp_path / "station.yaml"
    path.write_text(changed(STATION, *STATIONS[message]))
    refused(path, load_station, message)


@pytest.mark.parametrize("message", BUNDLES)
def test_bundle(tmp_path: Path, message: str) -> None:
    about, table = BUNDLES[message]
    folder = tmp_path / "bundle"
    folder.mkdir()
    (folder / "recording.yaml").write_text(about)
    (folder / "data.csv").write_text(table)
    refused(folder, load, message)


@pytest.mark.parametrize("message", RECORDINGS)
def test_recording(tmp_path: Path, message: str) -> None:
    path = write_recording(sample_recording(100, frames=0), tmp_path / "run.h5")
    with h5py.File(path, "r+") as file:
        RECORDINGS[message](file)
    refused(path, load, message)


@pytest.mark.parametrize("content", [b"", b"SRJ1\0\0", b"no journal, only text" * 9], ids=["empty", "cut", "text"])
def test_journal(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "run.journal"
    path.write_bytes(content)
    refused(path, load, "not a journal")


@pytest.mark.parametrize(("codec", "data", "fault"), [s[1:] for s in STREAMS], ids=[s[0] for s in STREAMS])
def test_byte_stream(codec: Any, data: bytes, fault: str) -> None:
    decoder = codec()
    assert decoder.decode(data) == []
    assert decoder.tally.discarded > 0
    assert re.search(fault, decoder.tally.last_fault)
    assert decoder.decode(codec().encode(Beat(1))) == [Beat(1)], "the stream goes on"


@pytest.mark.parametrize(
    ("data", "fault"),
    [
        (b"garbage before a frame", "bytes between frames"),
        (FRAME[:20] + b"\xff" + FRAME[21:], "wrong header|wrong checksum"),
        (FRAME[:-1] + bytes([FRAME[-1] ^ 1]), "wrong checksum"),
    ],
    ids=["garbage", "header", "pixels"],
)
def test_camera_stream(data: bytes, fault: str) -> None:
    decoder = FrameDecoder()
    found = decoder.feed(data + FRAME)
    assert len(found) == 1
    assert decoder.tally.discarded > 0
    assert re.search(f"{fault}|bytes between frames|no header", decoder.tally.last_fault)


def test_the_commands_say_so_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "protocol.yaml"
    path.write_text(changed(PROTOCOL, "name:", "nam:"))
    assert run(["check", str(path)]) == BAD_INPUT
    assert f"{path}:2:1: nam: unknown key 'nam'" in capsys.readouterr().err
    assert run(["import", str(tmp_path)]) == BAD_INPUT
    assert "not a bundle: there is no recording.yaml" in capsys.readouterr().err
    assert run(["show", str(path.with_suffix(".h5"))]) == BAD_INPUT
    assert "no such file" in capsys.readouterr().err
