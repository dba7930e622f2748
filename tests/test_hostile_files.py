"""Files made to do harm, and names that no file can have: one line that names the file, and status 2."""

from __future__ import annotations

import csv
import os
import struct
import time
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import openpyxl
import pytest

from acquire.cli.app import BAD_INPUT, run
from acquire.recording import load, read_bundle, write_bundle, write_recording
from acquire.recording.export import write_csv
from acquire.recording.model import Recording, RecordingError, RunInfo, Series
from acquire.recording.tables import MAX_CELLS, Table
from acquire.station import load_station
from protocols import load as load_protocol
from protocols import units
from protocols.source import read
from tests.acquire.recording.samples import sample_recording

BUNDLE = """schema: recording-bundle/1
instrument: rig
channels:
  x: {file: data.csv, column: x, unit: mm, time: {column: t, unit: s}}
"""
STATION = "schema: station/1\ninstruments: {cutometer: {simulated: true}}\n"


def told(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """The command's refusal of its input, in a few lines and without a traceback."""
    assert run(arguments) == BAD_INPUT
    said = capsys.readouterr().err
    assert "Traceback" not in said
    assert 0 < len(said) < 2000
    return said


def bundle(folder: Path, about: str = BUNDLE, table: str = "t,x\n0,1\n1,2\n") -> Path:
    folder.mkdir(exist_ok=True)
    (folder / "recording.yaml").write_text(about)
    (folder / "data.csv").write_text(table)
    return folder


@pytest.mark.parametrize("command", ["check", "show", "import", "export", "report", "recover", "run", "devices", "gap"])
def test_a_name_that_no_file_can_have(command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    long, circle = "x" * 5000, tmp_path / "circle"
    circle.symlink_to(circle)
    options = {"run": ["--sim", "-o", str(tmp_path)], "devices": ["--station"], "gap": ["diagnose"]}.get(command, [])
    for name in (long, f"{long}.h5", str(circle), str(circle / "run.h5")):
        arguments = [command, name, *options] if command == "run" else [command, *options, name]
        assert name[:20] in told(arguments, capsys)


def test_a_pipe_is_not_waited_for(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    os.mkfifo(tmp_path / "pipe.yaml")
    began = time.monotonic()
    told(["check", str(tmp_path / "pipe.yaml")], capsys)
    assert "not a file" in told(["devices", "--station", str(tmp_path / "pipe.yaml")], capsys)
    assert time.monotonic() - began < 2


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("file: data.csv", "file: loop.csv"),
        ("file: data.csv", f"file: {'x' * 300}"),
        ("file: data.csv", 'file: "a\\0"'),
    ],
    ids=["links in a circle", "too long", "NUL"],
)
def test_a_bundle_that_names_no_file(key: str, value: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (bundle(tmp_path / "b", BUNDLE.replace(key, value)) / "loop.csv").symlink_to("loop.csv")
    assert "recording.yaml:4:" in told(["import", str(tmp_path / "b")], capsys)


def test_deep_yaml_inside_a_bundle(tmp_path: Path) -> None:
    deep = "[" * 5000 + "]" * 5000
    folder = bundle(tmp_path / "b", f"{BUNDLE}protocol: p.yaml\n")
    (folder / "p.yaml").write_text(f"schema: protocol/1\nsteps: {deep}\n")
    with pytest.raises(RecordingError, match=r"p\.yaml:2:\d+: nested deeper than"):
        read_bundle(folder)
    (folder / "p.yaml").write_text(f"of another program: {deep}\n")
    assert deep in read_bundle(folder).info.protocol, "kept as it is"


@pytest.mark.parametrize("written", ["-3_0", "0x10", "0b1", "1:30", "0b1_1", "1_000.5"])
def test_a_number_is_what_everybody_reads(written: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="not a plain number"):
        read(f"a: {written}\n")
    with pytest.raises(ValueError, match="is not a number"):
        read_bundle(bundle(tmp_path / "b", table=f"t,x\n0,1\n1,{written}\n"))
    quoted = f"{BUNDLE}events: [{{time: '{written}', level: info, code: x, text: x}}]\n"
    with pytest.raises(ValueError, match=r"events\[0\]\.time"):
        read_bundle(bundle(tmp_path / "b", quoted))


def test_plain_numbers_and_names() -> None:
    data = read("a: [1, -2.5, 1e3, +4, .5, 007, 2026-01-02, '3']\n")[0]
    assert data == {"a": [1, -2.5, 1000.0, 4, 0.5, "007", "2026-01-02", "3"]}


@pytest.mark.parametrize("option", [["--speed", "3_0"], ["--speed", "1e308"], ["--speed", "nan"], ["--repeat", "1_0"]])
def test_numbers_on_the_command_line(option: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert option[0] in told(["run", "demo-cutometer", "--sim", "-o", str(tmp_path), *option], capsys)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("unit", ["10**10**10", "m*10**10**10", "m^(9^9^9)", "m*99999999"])
def test_a_unit_that_would_be_worked_out_for_years(unit: str) -> None:
    with pytest.raises(ValueError, match="is not a unit"):
        units.to_si(unit)
    with pytest.raises(ValueError, match=r"is no unit of length|does not read as"):
        units.parse(f"1 {unit}", "length")


@pytest.mark.parametrize("reader", [load_protocol, load_station, read_bundle])
@pytest.mark.parametrize("text", ['"a\\0b"', '"\\ud800"'], ids=["NUL", "surrogate"])
def test_texts_that_cannot_be_stored(reader: Callable[[Path], object], text: str, tmp_path: Path) -> None:
    path = tmp_path / "recording.yaml"
    path.write_text(f"schema: x\nname: {text}\n")
    with pytest.raises(ValueError, match=r"recording\.yaml:2:7: name: a text cannot hold"):
        reader(path)


def test_a_byte_order_mark_is_no_part_of_the_text(tmp_path: Path) -> None:
    folder = bundle(tmp_path / "b")
    for name in ("recording.yaml", "data.csv"):
        (folder / name).write_bytes(b"\xef\xbb\xbf" + (folder / name).read_bytes())
    assert read_bundle(folder).streams["x"].value.tolist() == [1e-3, 2e-3]


# Workbooks -----------------------------------------------------------------------------------------------------------


def workbook(path: Path, rows: list[list[object]], change: Callable[[str], str] = lambda text: text) -> Path:
    """A workbook whose sheet's XML is changed."""
    book = openpyxl.Workbook()
    for row in rows:
        book.active.append(row)
    plain = path.with_suffix(".plain")
    book.save(plain)
    with zipfile.ZipFile(plain) as old, zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as new:
        for member in old.infolist():
            content = old.read(member)
            new.writestr(member.filename, change(content.decode()).encode() if "sheet1" in member.filename else content)
    return path


def test_a_workbook_that_claims_more_than_it_has(tmp_path: Path) -> None:
    path = workbook(
        tmp_path / "a.xlsx", [["t", "x"], [0, 1], [1, 2]], lambda text: text.replace("A1:B3", "A1:XFD1048576")
    )
    began = time.monotonic()
    assert Table(path).column("x", "x")[0].tolist() == [1, 2]
    assert time.monotonic() - began < 2


def test_a_workbook_of_too_many_cells(tmp_path: Path) -> None:
    """Each row has one cell in the last column there can be: some kB of file, hundreds of millions of cells."""
    far = "".join(f'<row r="{n}"><c r="XFD{n}"><v>1</v></c></row>' for n in range(1, 20_000))
    path = workbook(tmp_path / "a.xlsx", [["t"]], lambda text: text.replace("<sheetData>", f"<sheetData>{far}"))
    began = time.monotonic()
    with pytest.raises(RecordingError, match=rf"a\.xlsx: more than {MAX_CELLS} cells"):
        Table(path)
    assert time.monotonic() - began < 2


def test_a_workbook_that_unpacks_to_gigabytes(tmp_path: Path) -> None:
    path = workbook(tmp_path / "a.xlsx", [["t"]], lambda text: text.replace("</sheetData>", " " * 2**27))
    assert path.stat().st_size < 2**20
    with pytest.raises(RecordingError, match=r"a\.xlsx: unpacks to \d+ bytes"):
        Table(path)


def test_damaged_workbooks(tmp_path: Path) -> None:
    whole = workbook(tmp_path / "a.xlsx", [["t", "x"], [0, 1], [1, 2]]).read_bytes()
    random = np.random.default_rng(3)
    path = tmp_path / "b.xlsx"
    refused = 0
    for _ in range(60):
        damaged = bytearray(whole)
        for spot in random.integers(len(whole), size=int(random.integers(1, 6))):
            damaged[spot] = int(random.integers(256))
        path.write_bytes(bytes(damaged))
        try:
            Table(path)
        except RecordingError:  # any other exception fails
            refused += 1
    assert refused > 30


# Pictures ------------------------------------------------------------------------------------------------------------


def test_a_picture_that_claims_to_be_huge(tmp_path: Path) -> None:
    folder = bundle(tmp_path / "b", f"{BUNDLE}frames: {{files: '*.png', rate: 25 Hz}}\n")
    head = struct.pack(">IIBBBBB", 60_000, 60_000, 8, 0, 0, 0, 0)
    chunk = b"IHDR" + head
    png = b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + chunk + struct.pack(">I", zlib.crc32(chunk))
    (folder / "a.png").write_bytes(png)
    with pytest.raises(RecordingError, match=r"a\.png: 3600000000 pixels"):
        read_bundle(folder)


def test_a_film_is_no_play_list(tmp_path: Path) -> None:
    folder = bundle(tmp_path / "b", f"{BUNDLE}frames: {{files: 'a.mp4', rate: 25 Hz}}\n")
    (folder / "a.mp4").write_text("#EXTM3U\n#EXTINF:10,\nfile:///etc/passwd\n")
    with pytest.raises(RecordingError, match=r"a\.mp4: neither AVI nor MP4"):
        read_bundle(folder)


# HDF5 ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["streams/spy", "run/subject", "setpoints", "events", "derived/x", "frames"])
@pytest.mark.parametrize("target", ["/nowhere", "/entry", "/entry/streams"])
def test_links_that_lead_nowhere_or_elsewhere(name: str, target: str, tmp_path: Path) -> None:
    path = write_recording(sample_recording(50, frames=0), tmp_path / "run.h5")
    with h5py.File(path, "r+") as file:
        if f"entry/{name}" in file:
            del file[f"entry/{name}"]
        file[f"entry/{name}"] = h5py.SoftLink(target)
    with pytest.raises(RecordingError, match=r"run\.h5"):
        load(path)


@pytest.mark.parametrize("name", ["streams/pressure/time", "streams/pressure/seq"])
def test_what_holds_no_numbers_is_refused(name: str, tmp_path: Path) -> None:
    path = write_recording(sample_recording(50, frames=0), tmp_path / "run.h5")
    with h5py.File(path, "r+") as file:
        count = len(file[f"entry/{name}"])
        del file[f"entry/{name}"]
        file[f"entry/{name}"] = np.zeros(count, [("time", "f8"), ("text", "S4")])
    with pytest.raises(RecordingError, match=rf"run\.h5: /entry/{name} holds .*, not numbers"):
        load(path)


# Tables that we write ------------------------------------------------------------------------------------------------

NAMES = ["a,b", '=cmd|"calc"!A1', "+1", "-x", "@sum", "'=x", "''=x", '"', "a;b", "tab\there", "#n", "ü", "'quoted'"]


def odd_names() -> Recording:
    time_axis = np.arange(3.0)
    streams = {name: Series(time_axis + k, time_axis, "m", seq=np.arange(3)) for k, name in enumerate(NAMES)}
    return Recording(RunInfo("r", "rig", "2026-01-01T00:00:00+00:00"), streams)


def test_no_title_is_a_formula_and_all_come_back(tmp_path: Path) -> None:
    recording = odd_names()
    (file,) = write_csv(recording, tmp_path / "a.csv")
    with file.open(newline="", encoding="utf-8") as stream:
        rows = list(csv.reader(stream))
    assert {len(row) for row in rows} == {len(NAMES) + 1}
    assert not [title for title in rows[0] if title[0] in "=+-@\t\r"]
    again = read_bundle(write_bundle(recording, tmp_path / "bundle"))
    assert {n: s.value.tolist() for n, s in again.streams.items()} == {
        n: s.value.tolist() for n, s in recording.streams.items()
    }


@pytest.mark.parametrize(
    "text",
    ["raise SystemExit(3)", "1/0", "import nothing_such", "class Model: pass", "def Model(): 5", "Model = 7", "Model("],
)
def test_a_model_file_that_is_no_model(text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recording = write_recording(sample_recording(50, frames=0), tmp_path / "run.h5")
    model = tmp_path / "model.py"
    model.write_text(text)
    out = ["-o", str(tmp_path / "out")]
    assert "model.py" in told(["gap", "diagnose", str(recording), "--model", f"{model}:Model", *out], capsys)
