"""Every faulty bundle is refused with a message that says what is wrong and where."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from acquire.recording import RecordingError, load
from tests.acquire.recording.test_bundle import DATA, PROTOCOL, channel, make

PRESSURE = channel("p", "mbar")
FAULTS: list[tuple[str, dict[str, Any], dict[str, str]]] = [
    (r"recording\.yaml:21:1: subjct: unknown key 'subjct'; did you mean 'subject'", {"subjct": "P07"}, {}),
    (r"recording\.yaml:1:\d+: schema", {"schema": "recording-bundle/7"}, {}),
    (r"recording\.yaml:1:1: instrument: is missing", {"instrument": None}, {}),
    (r"recording\.yaml:\d+:\d+: repeat", {"repeat": "first"}, {}),
    (r"needs channels or frames", {"channels": None}, {}),
    (
        r"channels\.pressure\.file: there is no file 'none\.csv'",
        {"channels": {"pressure": channel("p", "mbar", "none.csv")}},
        {},
    ),
    (
        r"channels\.pressure\.file: '\.\./x\.csv' lies outside",
        {"channels": {"pressure": channel("p", "mbar", "../x.csv")}},
        {},
    ),
    (
        r"data\.csv: channel pressure: no column 'P1'; did you mean 'p'|there is",
        {"channels": {"pressure": channel("P1", "mbar")}},
        {},
    ),
    (
        r"channels\.pressure\.unit: channel pressure: 'mbarr' is not a unit",
        {"channels": {"pressure": channel("p", "mbarr")}},
        {},
    ),
    (r"channel pressure: 'mm' is m, but this channel is in Pa", {"channels": {"pressure": channel("p", "mm")}}, {}),
    (
        r"channel pressure: 'mm' is not a unit of time",
        {"channels": {"pressure": {**PRESSURE, "time": {"column": "t", "unit": "mm"}}}},
        {},
    ),
    (r"time needs either a column or a rate", {"channels": {"pressure": {**PRESSURE, "time": {"unit": "s"}}}}, {}),
    (
        r"channels\.pressure\.time: is missing",
        {"channels": {"pressure": {"file": "data.csv", "column": "p", "unit": "mbar"}}},
        {},
    ),
    (
        r"data\.csv:3: channel apex_height, column 'h': 'nan' is not a finite",
        {},
        {"data.csv": DATA.replace("0.1\n", "nan\n")},
    ),
    (
        r"data\.csv:3: channel apex_height, column 'h': 'high' is not a number",
        {},
        {"data.csv": DATA.replace("0.1\n", "high\n")},
    ),
    (r"data\.csv:3: channel apex_height, column 'h': the cell is empty", {}, {"data.csv": DATA.replace("0.1\n", "\n")}),
    (r"data\.csv:4: channel pressure, column 't': time goes back", {}, {"data.csv": DATA.replace("0.2,", "0.05,")}),
    (
        r"data\.csv:2: the columns of the header are separated by a tab, those of this line by a comma",
        {},
        {"data.csv": DATA.replace("t,p,h", "t\tp\th")},
    ),
    (
        r"data\.csv:2: the columns of the header are separated by a comma, those of this line by a semicolon",
        {},
        {"data.csv": DATA.replace(",", ";").replace("t;p;h", "t,p,h")},
    ),
    (r"data\.csv: there is no header row", {}, {"data.csv": "\n"}),
    (r"data\.csv: channel pressure: column 'p' is empty", {}, {"data.csv": "t,p,h\n0,,1\n"}),
    (r"data\.csv: channel pressure: 2 columns are called 'p'", {}, {"data.csv": "t,p,p\n0,1,1\n"}),
    (
        r"data\.csv:4: channel pressure, column 't': 4 times in column 't' for 2 values, which end before this line",
        {},
        {"data.csv": "t,p,h\n0,0,0\n1,0,0\n2,,0\n3,,0\n"},
    ),
    (
        r"data\.csv:3: 4 cells under 3 headings: is a decimal comma among them",
        {},
        {"data.csv": DATA.replace("0.1\n", "0,1\n")},
    ),
    (r"data\.csv:2: 4 cells under 3 headings", {}, {"data.csv": "t,p,h\n0,1,2,3\n1,1,2,3\n"}),
    (
        r"data\.csv:2: 3 cells under 1 heading: is a decimal comma .* A line above the headings begins with #",
        {},
        {"data.csv": "exported by a recorder\n" + DATA},
    ),
    (
        r"data\.csv:2: channel pressure, column 't': '2026-03-01T12:00:00\.010' is a date: write seconds",
        {},
        {"data.csv": "t,p,h\n2026-03-01T12:00:00.010,0,0\n2026-03-01T12:00:00.020,0,0\n"},
    ),
    (r"data\.csv: not a text file", {}, {"data.csv": "t,p\n\0\0"}),
    (
        r"data\.xlsx: not a readable workbook",
        {"channels": {"pressure": channel("p", "mbar", "data.xlsx")}},
        {"data.xlsx": "no"},
    ),
    (r"protocol: there is no file 'x\.yaml'", {"protocol": "x.yaml"}, {}),
    (
        r"protocol: the protocol is faulty: p\.yaml:6:3: steps\[0\]",
        {"protocol": "p.yaml"},
        {"p.yaml": PROTOCOL.replace("type: hold", "tipe: hold")},
    ),
    (
        r"frames\.files: .*no file matches 'img_\*\.png'",
        {"frames": {"files": "img_*.png", "scale": "1 mm/px", "rate": "25 Hz"}},
        {},
    ),
    (
        r"frames\.files: .*bad\.png: not a readable image",
        {"frames": {"files": "*.png", "rate": "25 Hz"}},
        {"bad.png": "x"},
    ),
    (r"frames: frames need either a rate or a time_file", {"frames": {"files": "*.png", "scale": "1 mm/px"}}, {}),
    (
        r"frames\.scale: .*'0\.02 mm' ?|'mm' is no unit of scale",
        {"frames": {"files": "*.png", "scale": "0.02 mm", "rate": "25 Hz"}},
        {},
    ),
    (
        r"data\.csv:3: channel pressure, column 'p': -300 bar is -3e\+07 Pa: no pump .* vacuum; a wrong unit\?",
        {"channels": {"pressure": channel("p", "bar")}},
        {},
    ),
    (
        r"data\.csv:3: channel pressure, column 'p': -300 kPa is -300000 Pa: no pump reaches below vacuum",
        {"instrument": "a pump", "channels": {"pressure": channel("p", "kPa")}},
        {},
    ),
    (
        r"command\.csv:3: channel pressure, column 'p': -3000 mbar is -300000 Pa: no pump reaches below vacuum",
        {"setpoints": {"pressure": channel("p", "mbar", "command.csv")}},
        {"command.csv": "t,p\n0,0\n0,-3000\n"},
    ),
    (
        r"data\.csv:5: channel apex_height, column 'h': 0\.17 m is 0\.17 m: skin does not rise higher",
        {"channels": {"apex_height": channel("h", "m")}},
        {},
    ),
    (
        r"data\.csv:3: channel pressure, column 't': all 4 times are 1: time stands still",
        {},
        {"data.csv": "t,p,h\n1,0,0\n1,0,0\n1,0,0\n1,0,0\n"},
    ),
    (r"must lie in the bundle", {"frames": {"files": "../*.png", "rate": "25 Hz"}}, {}),
]


@pytest.mark.parametrize(("message", "changes", "files"), FAULTS, ids=[fault[0] for fault in FAULTS])
def test_refused(tmp_path: Path, message: str, changes: dict[str, Any], files: dict[str, str]) -> None:
    folder = make(tmp_path / "bundle", files, **changes)
    with pytest.raises(RecordingError, match=message) as caught:
        load(folder)
    assert str(folder) in str(caught.value)


def test_a_repeated_key_a_tag_and_a_bomb_are_refused(tmp_path: Path) -> None:
    folder = make(tmp_path)
    text = (folder / "recording.yaml").read_text()
    for fault, extra in {
        "repeated key": "subject: P08\n",
        "tags": "notes: !!python/object/apply:os.system [ls]\n",
        "too large or endless": "notes: &a [*a]\n",
        "not YAML": "notes: [\n",
    }.items():
        (folder / "recording.yaml").write_text(text + extra)
        with pytest.raises(RecordingError, match=rf"recording\.yaml:\d+:\d+: .*{fault}"):
            load(folder)


def test_an_empty_description_is_a_file_without_content(tmp_path: Path) -> None:
    folder = make(tmp_path)
    (folder / "recording.yaml").write_text("# nothing\n")
    with pytest.raises(RecordingError, match=r"recording\.yaml: the file is empty"):
        load(folder)


def test_not_a_bundle(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"not a bundle: there is no recording\.yaml"):
        load(tmp_path)


def test_aliases_of_a_dumping_program_are_fine(tmp_path: Path) -> None:
    time = {"column": "t", "unit": "s"}
    make(tmp_path, channels={"pressure": {**PRESSURE, "time": time}, "x": {**PRESSURE, "time": time}})
    assert "*id001" in (tmp_path / "recording.yaml").read_text()
    assert list(load(tmp_path).streams) == ["pressure", "x"]
