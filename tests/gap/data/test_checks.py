"""Recordings that cannot be diagnosed are refused with the recording and the channel."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from acquire.recording.model import Recording, RunInfo, Series
from gap import DiagnosisError, diagnose
from gap.data.checks import of_one_skin, refuse_impossible, remarks, stated_opening

TIME = np.linspace(0.0, 4.0, 41)
SUCTION = -30e3 * np.minimum(TIME, 1.0)


def recording(
    pressure: np.ndarray = SUCTION, height: np.ndarray = -2e-8 * SUCTION, specimen: str = "skin"
) -> Recording:
    info = RunInfo("run 1", "cutometer", "2026-01-01T00:00:00", specimen=specimen)
    streams = {
        "pressure": Series(pressure, TIME, "Pa", stage="actuator"),
        "apex_height": Series(height, TIME, "m", stage="sensor"),
    }
    return Recording(info, streams, {"pressure": Series(SUCTION, TIME, "Pa")})


def test_a_height_in_the_wrong_unit_is_named():
    r = recording()
    r = replace(r, streams={**r.streams, "apex_height": replace(r.streams["apex_height"], value=-2e-5 * SUCTION)})
    with pytest.raises(DiagnosisError, match=r"run 1: channel apex_height reaches 0\.6 m: .*a wrong unit\?"):
        refuse_impossible([r])


def test_a_pressure_below_vacuum_is_named():
    with pytest.raises(DiagnosisError, match="channel pressure reaches -3e\\+06 Pa: no pump reaches below vacuum"):
        refuse_impossible([recording(pressure=100 * SUCTION)])


@pytest.mark.parametrize(
    ("channel", "stuck"), [("pressure", {"pressure": 0 * TIME}), ("apex_height", {"height": 0 * TIME})]
)
def test_a_channel_that_never_moves_is_refused(channel: str, stuck: dict):
    """Once claimed with .93: a height that stands still is told an offset, a pressure crosstalk."""
    with pytest.raises(DiagnosisError, match=f"{channel} never changes in 2 recordings whose set-points do"):
        diagnose([recording(**stuck), recording(**stuck)])


def test_a_sensor_that_stops_in_one_recording_of_two_is_diagnosed():
    refuse_impossible([recording(height=0 * TIME), recording()])


def test_a_rigid_block_may_stand_still():
    refuse_impossible([recording(height=0 * TIME, specimen="rigid block"), recording()])


def test_numbers_that_are_missing_are_no_values():
    refuse_impossible([recording(height=np.where(TIME > 2, np.nan, -2e-8 * SUCTION))])


def of(subject: str, site: str, specimen: str = "skin") -> Recording:
    r = recording(specimen=specimen)
    return replace(r, info=replace(r.info, subject=subject, site=site))


def test_skin_of_another_site_is_left_out_and_told():
    """Two sites were one tissue: a cheek that is softer than the forearm was a change of tone."""
    forearm, cheek, block = of("P1", "forearm"), of("P1", "cheek"), of("", "", "rigid block")
    kept, told = of_one_skin([cheek, forearm, block, forearm])
    assert kept == [forearm, block, forearm]
    assert told == ["skin of P1, cheek is left out (1 of 3 recordings on skin): diagnose it apart"]


def test_as_many_of_either_skin_are_the_first_ones():
    first, second = of("P1", "forearm"), of("P2", "forearm")
    assert of_one_skin([first, second])[0] == [first]


def test_skin_that_is_not_stated_is_that_of_the_others():
    stated, empty = of("P1", "forearm"), of("", "")
    assert of_one_skin([stated, empty, stated]) == ([stated, empty, stated], [])
    assert of_one_skin([of("P1", "cheek", "rigid block"), stated])[1] == []


@pytest.mark.parametrize(
    ("protocol", "told"),
    [
        ("setup: {opening: 5 mm}", "run 1: an opening of 5 mm is stated, but 2 mm is assumed"),
        ("setup: {opening: 2.0 mm}", ""),
        ("setup: {opening: wide}", ""),
        ("in words", ""),
        ("", ""),
    ],
)
def test_an_opening_that_is_not_the_assumed_one_is_remarked_upon(protocol: str, told: str) -> None:
    r = recording()
    said = [text for text in remarks([replace(r, info=replace(r.info, protocol=protocol))], True) if "opening" in text]
    assert len(said) == bool(told)
    assert all(text.startswith(told) for text in said)


def test_an_opening_is_taken_from_the_calibration_before_the_protocol() -> None:
    r = recording()
    known = {"opening": {"value": 4.0, "unit": "mm", "provenance": "measured"}}
    assert (
        stated_opening(replace(r, info=replace(r.info, calibration=known, protocol="setup: {opening: 2 mm}"))) == 4e-3
    )
    assert np.isnan(stated_opening(replace(r, info=replace(r.info, calibration={"opening": {"value": "wide"}}))))
