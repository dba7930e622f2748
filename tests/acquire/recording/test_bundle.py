"""Bundles: what a lab writes by hand comes in with SI units, and what is exported comes back whole."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import openpyxl
import pytest
import yaml

from acquire.recording import RecordingError, load, open_recording, read_bundle, write_bundle, write_recording
from acquire.recording.model import difference
from tests.acquire.recording.samples import sample_recording

DATA = "t,p,h\n0.0,0,0\n0.1,-300,0.1\n0.2,-300,0.15\n0.3,-300,0.17\n"


def channel(column: str, unit: str, file: str = "data.csv", **more: Any) -> dict[str, Any]:
    return {"file": file, "column": column, "unit": unit, "time": {"column": "t", "unit": "s"}, **more}


def make(folder: Path, files: dict[str, str] | None = None, **changes: Any) -> Path:
    """A small bundle; ``changes`` replace keys of recording.yaml (None removes one), ``files`` lie beside it."""
    about = {
        "schema": "recording-bundle/1",
        "instrument": "cutometer",
        "subject": "P07",
        "site": "forehead",
        "repeat": 1,
        "channels": {"pressure": channel("p", "mbar"), "apex_height": channel("h", "mm")},
        **changes,
    }
    folder.mkdir(exist_ok=True)
    for name, text in ({"data.csv": DATA} | (files or {})).items():
        (folder / name).write_text(text, encoding="utf-8")
    about = {key: value for key, value in about.items() if value is not None}
    (folder / "recording.yaml").write_text(yaml.safe_dump(about, sort_keys=False), encoding="utf-8")
    return folder


def test_units_become_si(tmp_path: Path) -> None:
    recording = load(make(tmp_path / "b"))
    pressure, height = recording.stream("pressure"), recording.stream("apex_height")
    assert (pressure.unit, height.unit) == ("Pa", "m")
    assert np.array_equal(pressure.value, [0, -3e4, -3e4, -3e4])
    assert np.allclose(height.value, [0, 1e-4, 1.5e-4, 1.7e-4])
    assert np.array_equal(height.time, [0, 0.1, 0.2, 0.3])
    assert pressure.stage == "actuator"
    assert recording.info.status == "imported"
    assert recording.info.specimen == "skin"
    assert recording.info.id.startswith("import-b-")
    assert read_bundle(tmp_path / "b" / "recording.yaml").info.id == recording.info.id


@pytest.mark.parametrize("text", ["t;p;h\n0;0;0\n0,1;-300;0,1\n", "# lab\n# x\nt\tp\th\n0\t0\t0\n0.1\t-300\t.1\n"])
def test_other_separators_and_decimal_commas(tmp_path: Path, text: str) -> None:
    recording = load(make(tmp_path, {"data.csv": text}))
    assert np.allclose(recording.stream("apex_height").value, [0, 1e-4])
    assert np.allclose(recording.stream("apex_height").time, [0, 0.1])


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_what_spreadsheets_of_windows_write(tmp_path: Path, encoding: str) -> None:
    folder = make(tmp_path)
    (folder / "data.csv").write_bytes("t,p,h\r\n0,0,0\r\n0.1,\N{MINUS SIGN}300,0.1\r\n".encode(encoding))
    assert np.array_equal(load(folder).stream("pressure").value, [0, -3e4])


def test_empty_cells_may_be_samples_without_a_value(tmp_path: Path) -> None:
    channels = {"apex_height": channel("h", "mm", allow_nan=True), "pressure": channel("p", "mbar")}
    slow = load(make(tmp_path, {"data.csv": DATA.replace("0.1\n", "\n")}, channels=channels))
    np.testing.assert_allclose(slow.streams["apex_height"].value, [0.0, np.nan, 0.15e-3, 0.17e-3])


@pytest.mark.parametrize("row", ["s,mbar,mm", "[s];[mbar];", '"s","(mbar)","mm"'])
def test_a_row_of_units_below_the_header_is_skipped(tmp_path: Path, row: str) -> None:
    separator = ";" if ";" in row else ","
    text = DATA.replace("\n", f"\n{row.replace(separator, ',')}\n", 1).replace(",", separator)
    assert np.array_equal(load(make(tmp_path, {"data.csv": text})).stream("pressure").value, [0, -3e4, -3e4, -3e4])


def test_suction_may_be_positive_where_a_bundle_says_so(tmp_path: Path) -> None:
    text = DATA.replace("-300", "300")
    channels = {"pressure": channel("p", "mbar", suction="positive"), "apex_height": channel("h", "mm")}
    recording = load(make(tmp_path / "a", {"data.csv": text}, channels=channels))
    assert np.array_equal(recording.stream("pressure").value, [0, -3e4, -3e4, -3e4])
    assert not np.signbit(recording.stream("pressure").value[0])
    assert not any(e.code == "pressure_sign" for e in recording.events)
    channels["apex_height"]["suction"] = "positive"
    with pytest.raises(RecordingError, match=r"apex_height\.suction: channel apex_height: 'mm' is no unit of pressure"):
        load(make(tmp_path / "b", {"data.csv": text}, channels=channels))


def test_a_calibration_may_be_written_as_people_do(tmp_path: Path) -> None:
    given = {"opening": "4 mm", "serial_number": "C7", "axis_mass": {"value": 0.06, "unit": "kg"}}
    assert load(make(tmp_path, run={"calibration": given})).info.calibration == {
        "opening": {"value": 4.0, "unit": "mm"},
        "serial_number": {"value": "C7"},
        "axis_mass": {"value": 0.06, "unit": "kg"},
    }


def test_a_protocol_in_words_may_end_as_a_file_does(tmp_path: Path) -> None:
    words = "three steps, see lab book 4, p. 12, levels.csv"
    assert load(make(tmp_path, protocol=words)).info.protocol == words


def test_workbook_and_channels_of_different_length(tmp_path: Path) -> None:
    book = openpyxl.Workbook()
    book.active.append(["t", "p", "t2", "h"])
    book.active.append([0, 0, 0, 0])
    book.active.append([0.1, -300.5, None, None])
    book.save(tmp_path / "data.xlsx")
    slow = {**channel("h", "mm", "data.xlsx"), "time": {"column": "t2", "unit": "min"}}
    make(tmp_path, channels={"pressure": channel("p", "mbar", "data.xlsx"), "apex_height": slow})
    recording = load(tmp_path)
    assert np.array_equal(recording.stream("pressure").value, [0, -30050.0])
    assert len(recording.stream("apex_height").value) == 1


def test_any_other_rig_names_its_own_channels(tmp_path: Path) -> None:
    channels = {
        "motor_force": channel("p", "kgf"),
        "level": {**channel("h", "V"), "time": {"rate": "0.25 Hz", "start": "8 s"}},
    }
    recording = load(make(tmp_path, instrument="servo drive", channels=channels))
    assert recording.stream("motor_force").unit == "N"
    assert np.array_equal(recording.stream("level").time, [8, 12, 16, 20])


def test_a_foreign_protocol_is_kept_verbatim(tmp_path: Path) -> None:
    text = "first press\n  then wait: [\n"
    recording = load(make(tmp_path / "a", {"notes.txt": text}, protocol="notes.txt"))
    assert recording.info.protocol == text
    assert not recording.setpoints
    inline = load(make(tmp_path / "b", protocol={"schema": "other/2", "x": 1}))
    assert yaml.safe_load(inline.info.protocol) == {"schema": "other/2", "x": 1}


@pytest.mark.parametrize("text", ["hold -30 kPa for 10 s, rest 0.5 s", "hold, then vent.", "ramp/hold at 0.5", "hold"])
def test_a_protocol_in_words_is_kept(tmp_path: Path, text: str) -> None:
    info = load(make(tmp_path, protocol=text)).info
    assert (info.protocol, info.protocol_name) == (text, "")


def test_a_protocol_without_a_suffix_is_read_where_its_file_exists(tmp_path: Path) -> None:
    info = load(make(tmp_path, {"steps": "hold, then vent\n"}, protocol="steps")).info
    assert (info.protocol, info.protocol_name) == ("hold, then vent\n", "steps")


PROTOCOL = """schema: protocol/1
name: one-step
instrument: cutometer
limits: {pressure: {low: -500 mbar, high: 0 mbar}}
steps:
- {type: hold, pressure: -300 mbar, duration: 2 s}
"""


def test_a_skinrig_protocol_without_setpoints_is_compiled(tmp_path: Path) -> None:
    data = DATA.replace("0.0,", "10.0,").replace("\n0.", "\n10.")
    recording = load(make(tmp_path, {"data.csv": data, "protocol.yaml": PROTOCOL}, protocol="protocol.yaml"))
    commanded = recording.setpoints["pressure"]
    assert commanded.unit == "Pa"
    assert commanded.time[0] == 10.0, "the session's clock"
    assert commanded.value.min() == -3e4
    assert recording.info.protocol == PROTOCOL
    assert [event.code for event in recording.events] == ["setpoints_compiled"]


def test_setpoints_given_are_taken(tmp_path: Path) -> None:
    files = {"command.csv": "t,p\n0,0\n0,-300\n2,-300\n", "protocol.yaml": PROTOCOL}
    given = {"pressure": channel("p", "mbar", "command.csv")}
    recording = load(make(tmp_path, files, protocol="protocol.yaml", setpoints=given))
    assert np.array_equal(recording.setpoints["pressure"].value, [0, -3e4, -3e4])
    assert not recording.events


def test_a_channel_that_the_instrument_does_not_have_is_kept_and_remarked_upon(tmp_path: Path) -> None:
    channels = {
        "pressure": channel("p", "mbar"),
        "pressure_reference": channel("p", "mbar"),
        "banana": channel("h", "mm"),
    }
    recording = load(make(tmp_path / "a", channels=channels))
    assert set(recording.streams) == set(channels)
    (event,) = recording.events
    assert (event.level, event.code) == ("warning", "unknown_channel")
    assert event.text == "banana: kept, but not among the channels of the cutometer (apex_height, pressure)"
    assert load(write_bundle(recording, tmp_path / "b")).events == recording.events


def test_frames(tmp_path: Path) -> None:
    images = np.random.default_rng(0).integers(0, 255, (11, 20, 30), dtype=np.uint8)
    folder = make(tmp_path, frames={"files": "img_*.png", "rate": "25 Hz"})
    for number, image in enumerate(images):
        cv2.imwrite(str(folder / f"img_{number}.png"), image)
    frames = load(folder).frames
    assert frames is not None
    assert np.array_equal(np.asarray(frames.data), images), "img_2 comes before img_10"
    assert np.allclose(frames.time, np.arange(11) / 25)
    for number, image in enumerate(images):
        cv2.imwrite(str(folder / f"img_{number}.tif"), image.astype(np.uint16) * 256)
    folder = make(tmp_path, frames={"files": "img_*.tif", "rate": "25 Hz", "start": "2 s"})
    frames = load(folder).frames
    assert frames is not None
    assert np.array_equal(np.asarray(frames.data), images)
    assert frames.time[0] == 2.0


def test_film(tmp_path: Path) -> None:
    film = cv2.VideoWriter(str(tmp_path / "film.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (64, 48))
    for level in (0, 100, 200):
        film.write(np.full((48, 64, 3), level, np.uint8))
    film.release()
    frames = load(make(tmp_path, frames={"files": "film.avi", "rate": "25 Hz"})).frames
    assert frames is not None
    assert frames.data.shape == (3, 48, 64)
    assert np.allclose(frames.data[:, 24, 32], [0, 100, 200], atol=3)


def test_export_comes_back_whole(tmp_path: Path) -> None:
    recording = sample_recording()
    folder = write_bundle(recording, tmp_path / "bundle")
    back = load(folder)
    assert difference(recording, back) == ""
    assert back.info.limits == recording.info.limits
    assert back.info.calibration["opening"] == recording.info.calibration["opening"]
    assert back.streams["pressure"].range == recording.streams["pressure"].range
    assert back.frames is not None
    assert recording.frames is not None
    assert np.array_equal(np.asarray(back.frames.data), recording.frames.data)
    again = open_recording(write_recording(back, tmp_path / "run.h5"))
    assert difference(recording, again) == ""
    with pytest.raises(RecordingError, match="is not empty"):
        write_bundle(recording, folder)


def test_samples_without_a_value_come_back(tmp_path: Path) -> None:
    recording = sample_recording()
    height, profile = recording.streams["apex_height"], recording.derived["profile"]
    height.value[[0, 17, -1]] = np.nan
    profile.value[:, :2] = np.nan
    assert difference(recording, load(write_bundle(recording, tmp_path / "bundle"))) == ""


def test_export_of_channels_with_times_of_their_own(tmp_path: Path) -> None:
    recording = sample_recording(frames=0)
    slow = recording.streams["apex_height"]
    slow = replace(slow, value=slow.value[::4], time=slow.time[::4], seq=np.arange(7, 757), time_host=None)
    streams = {"time": slow, "pressure": recording.streams["pressure"]}
    recording = replace(recording, info=replace(recording.info, instrument="another"), streams=streams)
    assert difference(recording, load(write_bundle(recording, tmp_path / "bundle"))) == ""


def test_stated_noise_becomes_si_and_is_kept(tmp_path: Path) -> None:
    stated = {"pressure": channel("p", "mbar", noise={"value": 0.7, "unit": "mbar"})}
    recording = load(make(tmp_path / "b", channels=stated))
    assert recording.stream("pressure").noise == pytest.approx(70.0)
    assert difference(recording, load(write_recording(recording, tmp_path / "kept.h5"))) == ""
    assert load(write_bundle(recording, tmp_path / "again")).stream("pressure").noise == pytest.approx(70.0)
    wrong = {"pressure": channel("p", "mbar", noise={"value": 0.7, "unit": "mm"})}
    with pytest.raises(RecordingError, match=r"recording\.yaml:\d+:\d+: .*noise in 'mm' is m, but this channel is in"):
        load(make(tmp_path / "wrong", channels=wrong))


def test_a_stated_resolution_has_a_unit_of_its_own_or_is_in_si(tmp_path: Path) -> None:
    for k, resolution in enumerate(({"value": 0.1, "unit": "mbar"}, 10.0)):
        recording = load(make(tmp_path / f"b{k}", channels={"pressure": channel("p", "mbar", resolution=resolution)}))
        assert recording.stream("pressure").resolution == pytest.approx(10.0)
    wrong = {"pressure": channel("p", "mbar", resolution={"value": 0.1, "unit": "mm"})}
    with pytest.raises(RecordingError, match=r"recording\.yaml:\d+:\d+: .*resolution in 'mm' is m, but this channel"):
        load(make(tmp_path / "wrong", channels=wrong))
