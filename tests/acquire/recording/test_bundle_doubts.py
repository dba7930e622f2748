"""Warnings about bundles that can be imported, though something in them is strange."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from acquire.qualifications import SERIAL
from acquire.recording import load
from acquire.recording.bundle_doubts import READ
from acquire.recording.bundle_export import write_bundle
from acquire.recording.model import AXIS_LOOP, difference
from acquire.station import CALIBRATIONS
from tests.acquire.recording.samples import sample_recording
from tests.acquire.recording.test_bundle import DATA, channel, make

COMMAND = {"data.csv": DATA, "command.csv": "t,x\n0,0\n2,0.001\n"}


def told(folder: Path, files: dict[str, str] | None = None, **head: Any) -> dict[str, str]:
    """The warnings about a bundle by their code; an exported copy has the same."""
    recording = load(make(folder / "a", files, **head))
    assert load(write_bundle(recording, folder / "b")).events == recording.events
    return {event.code: event.text for event in recording.events}


@pytest.mark.parametrize("specimen", ["skin", "rigid block", "manometer"])
def test_what_is_understood_is_not_remarked_upon(tmp_path: Path, specimen: str) -> None:
    assert told(tmp_path, specimen=specimen) == {}


def test_a_name_that_is_nearly_a_reference_is_asked_about(tmp_path: Path) -> None:
    text = told(tmp_path, specimen="gauge stepp", specimen_properties={"height": "1.000±0.002 mm"})["unknown_specimen"]
    assert "'gauge stepp'" in text
    assert "did you mean 'gauge step'?" in text
    assert "there is rigid block, gauge step" in told(tmp_path / "b", specimen="phantom")["unknown_specimen"]


LOOP_STATED = {
    "loop_proportional": "2000 N/m",
    "loop_integral": {"value": 6e4, "unit": "N/(m s)"},
    "loop_derivative": {"value": 18.0, "unit": "N s/m"},
    "axis_mass": "0.1 kg",
}


@pytest.mark.parametrize(
    ("changed", "code", "text"),
    [
        ({}, "", ""),
        ({"loop_filter": "1 ms", "probe_radius": "1 mm", "frame_rate": "25 Hz"}, "", ""),  # words of their own
        ({"openning": "2 mm"}, "unknown_calibration", "openning is kept, but nothing reads it: is it opening?"),
        ({"loop_intergal": "1 N"}, "unknown_calibration", "is it loop_integral?"),
        ({"axis_mass": None}, "incomplete_loop", "a controller needs axis_mass besides loop_proportional"),
        ({"loop_proportional": "2 N/mm"}, "loop_unit", "loop_proportional is in N/mm; a diagnosis takes N/m"),
    ],
)
def test_calibrations_that_nothing_would_read_are_asked_about(
    tmp_path: Path, changed: dict[str, Any], code: str, text: str
) -> None:
    calibration = {name: value for name, value in (LOOP_STATED | changed).items() if value is not None}
    found = told(tmp_path, run={"calibration": calibration})
    assert text in found.pop(code, "")
    assert found == {}


def test_calibrations_of_stations_and_qualifications_are_known() -> None:
    assert set(READ) > {SERIAL, *CALIBRATIONS, *AXIS_LOOP}


def test_a_reference_without_its_number_is_remarked_upon(tmp_path: Path) -> None:
    assert told(tmp_path, specimen="gauge step")["incomplete_specimen"].startswith("height: state it for a gauge step")


def test_an_uncertainty_as_large_as_the_value_is_asked_about(tmp_path: Path) -> None:
    """0.5000 mm ± 2: the author meant micrometres."""
    stated = {"specimen": "gauge step", "specimen_properties": {"height": "0.5000 mm ± 2"}}
    text = told(tmp_path, **stated)["wide_uncertainty"]
    assert text == "height is 0.0005 ± 0.002 m: a ± without a unit has that of the value, so write the unit of both"


def test_suction_that_goes_up_is_asked_about_recorded_or_commanded(tmp_path: Path) -> None:
    command = {"command.csv": "t,p\n0,0\n1,0\n1,30\n2,30\n2,0\n9,0\n"}
    given = {"setpoints": {"pressure": channel("p", "kPa", "command.csv")}}
    text = told(tmp_path, {"data.csv": DATA, **command}, **given)["pressure_sign"]
    assert text.startswith("the set-point of pressure goes up to 300 mbar above the air's; suction is negative")
    recorded = told(tmp_path / "b", {"data.csv": DATA.replace("-300", "300")})["pressure_sign"]
    assert recorded.startswith("the pressure goes up to 300 mbar")


def test_setpoints_that_nothing_reads_are_remarked_upon(tmp_path: Path) -> None:
    setpoints = {f"probe_{a}": channel("x", "m", "command.csv") for a in "xyw"}
    channels = {"axis_position_1": channel("h", "mm")}
    robot = {"instrument": "microrobot", "channels": channels}
    text = told(tmp_path, COMMAND, setpoints=setpoints, **robot)["unknown_setpoint"]
    assert text == "probe_w: kept, but the microrobot is commanded by probe_x, probe_y, probe_z"
    del setpoints["probe_w"]
    text = told(tmp_path / "b", COMMAND, setpoints=setpoints, **robot)["missing_setpoint"]
    assert text == "no set-points of probe_z, which a diagnosis needs"


def test_a_start_that_is_no_time_is_remarked_upon(tmp_path: Path) -> None:
    assert "'yesterday' is no time such as" in told(tmp_path, run={"start_time": "yesterday"})["start_time"]


@pytest.mark.parametrize(
    "start", ["2026-04-02T09:10:00+02:00", "2026-04-02 09:10:00.5 +0200", "2026-04-02 09:10:00  Z"]
)
def test_a_start_may_have_its_zone_apart(tmp_path: Path, start: str) -> None:
    assert told(tmp_path, run={"start_time": start}) == {}


def test_a_reference_is_known_by_its_name_in_capitals(tmp_path: Path) -> None:
    assert told(tmp_path, specimen="Rigid Block") == {}
    assert load(tmp_path / "a").info.specimen == "rigid block"


def test_times_that_are_equal_are_remarked_upon(tmp_path: Path) -> None:
    text = told(tmp_path, {"data.csv": DATA.replace("0.2,", "0.1,")})["equal_times"]
    assert text == "data.csv:4: channel pressure, column 't': 0.1 is the time of the line before too (1 such lines)"


def test_seconds_that_were_called_milliseconds_are_asked_about(tmp_path: Path) -> None:
    rows = "".join(f"{k / 100},0,0\n" for k in range(1000))
    fast = {**channel("p", "mbar"), "time": {"column": "t", "unit": "ms"}}
    text = told(tmp_path, {"data.csv": "t,p,h\n" + rows}, channels={"pressure": fast})["fast_samples"]
    assert text == "channel pressure has 1e+05 samples a second, 0.00999 s in all: a wrong unit of time?"
    assert told(tmp_path / "b", {"data.csv": "t,p,h\n" + rows}) == {}


def test_a_run_of_ours_comes_back_whatever_it_holds(tmp_path: Path) -> None:
    """A gauge that failed and a clock that stood still are what was recorded."""
    sound = sample_recording(20, frames=0)
    failed = {name: replace(s, value=np.full(20, -1e9), time=np.full(20, 3.0)) for name, s in sound.streams.items()}
    recording = replace(sound, streams=failed)
    assert difference(load(write_bundle(recording, tmp_path / "b")), recording) == ""


@pytest.mark.parametrize(("resolution", "asked"), [(1e-5, False), (1e-6, False), (0.01, True)])
def test_a_resolution_in_the_columns_unit_is_asked_about(tmp_path: Path, resolution: float, asked: bool) -> None:
    """0.01 of a column in mm is 10 mm: the noise of every sample would count as so wide."""
    channels = {"pressure": channel("p", "mbar"), "apex_height": channel("h", "mm", resolution=resolution)}
    said = told(tmp_path, channels=channels)
    assert set(said) == ({"coarse_resolution"} if asked else set())
    if asked:
        assert "channel apex_height states a resolution of 0.01 m" in said["coarse_resolution"]
        assert "a number is in SI units" in said["coarse_resolution"]
