"""Qualification: the file and when it is believed, the standard set, and the judgement by references."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from acquire.cli.app import NOT_PASSED, run
from acquire.qualifications import SCHEMA, Parameter, Qualification, due, dump, history, keep, load_qualification
from acquire.recording import RecordingError
from acquire.recording.model import Recording
from acquire.session import Session
from acquire.station import simulated_station
from gap.design import simulated as own
from gap.diagnosis import DiagnosisError
from gap.qualify.judge import qualify
from gap.qualify.page import BAD, chart
from gap.qualify.steps import STANDARD, steps_of
from protocols import find, load
from protocols.specimens import stated

NOW = datetime(2026, 5, 1, tzinfo=UTC)


def qualification(**other: object) -> Qualification:
    parameters = {"height_gain_error": Parameter(value=0.01, se=0.001, unit="1", tolerance=0.03, passed=True)}
    given = {
        "schema": SCHEMA,
        "instrument": "cutometer",
        "serial": "C7",
        "date": NOW,
        "passed": True,
        "verdict": "none",
    }
    return Qualification(**{**given, "parameters": parameters, **other})


def test_a_file_comes_back(tmp_path: Path) -> None:
    (tmp_path / "q.yaml").write_text(dump(qualification()))
    assert load_qualification(tmp_path / "q.yaml") == qualification()
    (tmp_path / "bad.yaml").write_text(dump(qualification()).replace("passed: true", "passed: perhaps", 1))
    with pytest.raises(RecordingError, match=r"bad\.yaml:\d+.*perhaps|bad\.yaml:\d+"):
        load_qualification(tmp_path / "bad.yaml")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("se: 0.001", "se: -1"), r"parameters\.height_gain_error\.se.*greater than 0"),
        (("se: 0.001", "se: 0.0"), r"parameters\.height_gain_error\.se.*greater than 0"),
        (("value: 0.01", "value: .nan"), r"parameters\.height_gain_error\.value.*finite"),
        (("tolerance: 0.03", "tolerance: .inf"), r"parameters\.height_gain_error\.tolerance.*finite"),
        (("valid_days: 180.0", "valid_days: -3"), r"valid_days.*greater than 0"),
        (("valid_days: 180.0", "valid_days: 1.0e+8"), r"valid_days.*must be at most 3650"),
        (("sd: 250.0", "sd: -1"), r"noise.*pressure\.sd: must be a number from 0 on"),
        (("- 0.5\n", "- -0.5\n"), r"covariance.*not symmetric in a and b"),
        (("- 0.5\n", "- 5.0\n"), r"covariance.*negative variance"),
        (("- 1.0\n", "- -1.0\n"), r"covariance.*variance of a must be positive"),
        (("  - b\n", ""), r"covariance.*1 rows of 1 numbers"),
    ],
)  # fmt: skip
def test_a_number_that_cannot_be_is_refused_with_its_line_and_name(
    tmp_path: Path, change: tuple[str, str], words: str
) -> None:
    covariance = {"names": ("a", "b"), "matrix": ((1.0, 0.5), (0.5, 2.0))}
    text = dump(qualification(covariance=covariance, noise={"pressure": {"sd": 250.0, "unit": "Pa"}}))
    assert load_qualification(written(tmp_path, text))
    assert change[0] in text
    both = -1 if "negative" in words else 1
    with pytest.raises(RecordingError, match=rf"q\.yaml:\d+.*{words}"):
        load_qualification(written(tmp_path, text.replace(*change, both)))


def written(folder: Path, text: str) -> Path:
    (folder / "q.yaml").write_text(text)
    return folder / "q.yaml"


@pytest.mark.parametrize(
    ("instrument", "serial", "days", "words"),
    [
        ("cutometer", "C7", 1, ""),
        ("cutometer", "", 1, ""),
        ("aspiration", "C7", 1, "of a cutometer, not of a aspiration"),
        ("cutometer", "C8", 1, "serial number C7, not of C8"),
        ("cutometer", "C7", 200, "expired on 2026-10-28"),
    ],
)
def test_when_it_is_believed(instrument: str, serial: str, days: int, words: str) -> None:
    why = qualification().against(instrument, serial, NOW + timedelta(days=days))
    assert words in why
    assert bool(words) == bool(why)
    assert "doubt" in qualification(doubts=("dead weight",)).against("cutometer", "C7", NOW)


def test_a_run_is_warned_only_where_there_once_was_one(tmp_path: Path) -> None:
    assert due("cutometer", "C7", tmp_path, NOW) == ""
    keep(qualification(), tmp_path)
    assert due("cutometer", "C7", tmp_path, NOW + timedelta(days=2)) == ""
    assert "expired" in due("cutometer", "C7", tmp_path, NOW + timedelta(days=400))
    keep(qualification(date=NOW + timedelta(days=1), passed=False), tmp_path)
    assert "not passed" in due("cutometer", "C7", tmp_path, NOW + timedelta(days=2))
    assert [q.passed for q in history("cutometer", "C7", tmp_path)] == [True, False]


def test_the_control_chart_shows_every_qualification() -> None:
    points = [
        (qualification(), Parameter(value=v, se=0.001, unit="1", tolerance=0.03, passed=v < 0.03)) for v in (0.01, 0.04)
    ]
    svg = chart(points)
    assert svg.count("<circle") == 2
    assert svg.count("stroke-dasharray") == 2
    assert BAD in svg.rpartition("<circle")[2]
    assert "<script>" not in chart([(points[0][0], points[0][1].model_copy(update={"unit": "<script>"}))])


def test_the_standard_set_is_short_and_its_numbers_can_be_a_laboratory_s_own() -> None:
    with Session(simulated_station()) as session:
        for name, steps in STANDARD.items():
            assert sum(session.compile(name, load(find(s.protocol)))[0].duration for s in steps) < 300
    steps = {s.name: s for s in steps_of("cutometer", ["step-high.height=1.503±0.001 mm"])}
    assert steps["step-high"].known["height"].scalar == pytest.approx(1.503e-3)
    assert steps["step-low"].known["height"].scalar == pytest.approx(0.5e-3)
    for wrong, words in (("step.height=1 mm", "STEP.KEY=VALUE"), ("block.height=1 mm", "block: height: no property")):
        with pytest.raises(ValueError, match=words):
            steps_of("cutometer", [wrong])


def references(**said: str) -> list[Recording]:
    """A sound aspiration device on two steps and the membrane; ``said`` is what is claimed of the specimens instead."""
    legs = [
        replace(own.step_hold(0.0, 4.0, 4.0), specimen="gauge step", known=stated("gauge step", {"height": h}))
        for h in ("0.500 mm", "1.000 mm", "1.500 mm")
    ]
    legs.append(replace(own.step_hold(-20e3, 3.0, 3.0), specimen="reference membrane"))
    made = own.suction_session("aspiration", np.random.default_rng(4), legs=legs)
    if "height" in said:
        known = stated("gauge step", said)
        made[1] = replace(made[1], info=replace(made[1].info, specimen_properties=known))
    return made


def test_only_references_of_one_instrument_qualify() -> None:
    skin = own.suction_session("aspiration", np.random.default_rng(4), legs=[own.step_hold(-20e3, 3.0, 3.0)])
    with pytest.raises(DiagnosisError, match="no recording of a reference specimen"):
        qualify(skin)
    one, other = references()[:2]
    other = replace(other, info=replace(other.info, instrument="cutometer"))
    with pytest.raises(DiagnosisError, match="several instruments"):
        qualify([one, other])


@pytest.mark.slow
def test_a_wrong_reference_is_doubted_and_not_the_instrument() -> None:
    judged = qualify(references(height="1.100±0.002 mm"))
    q = judged.qualification
    assert not q.passed
    assert not q.findings
    assert any("gauge step" in text and "0.0011" in text for text in q.doubts)
    assert q.against("aspiration")
    sound = qualify(references()).qualification
    assert sound.passed
    assert not sound.doubts


def _with_height(recording: Recording, added: np.ndarray) -> Recording:
    """The recording with something (n,) m added to its apex height."""
    height = recording.streams["apex_height"]
    other = replace(height, value=np.asarray(height.value, float) + added)
    return replace(recording, streams={**recording.streams, "apex_height": other})


def creeping(recording: Recording) -> Recording:
    """A membrane a tenth of whose height comes with a lag of 3 s."""
    height = recording.streams["apex_height"]
    time, value = np.asarray(height.time, float), np.asarray(height.value, float)
    late = np.zeros_like(value)
    for k, step in enumerate(np.diff(time)):
        late[k + 1] = late[k] + (value[k] - late[k]) * step / 3.0
    return _with_height(recording, 0.1 * (late - value))


def bending(recording: Recording) -> Recording:
    """A block that gives way by 40 µm at 20 kPa."""
    time = np.asarray(recording.streams["apex_height"].time, float)
    pressure = recording.streams["pressure"]
    return _with_height(recording, -2e-9 * np.interp(time, pressure.time, np.asarray(pressure.value, float)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("specimen", "change"), [("reference membrane", creeping), ("rigid block", bending)], ids=["membrane", "block"]
)
def test_a_membrane_that_creeps_and_a_block_that_bends_are_doubted(
    specimen: str, change: Callable[[Recording], Recording]
) -> None:
    legs = [
        replace(own.step_hold(0.0, 4.0, 4.0), specimen="gauge step", known=stated("gauge step", {"height": h}))
        for h in ("0.500 mm", "1.000 mm", "1.500 mm")
    ]
    for name in ("reference membrane", "rigid block"):
        legs += [
            replace(leg, specimen=name) for leg in (own.step_hold(-20e3, 4.0, 4.0), own.triangle(-20e3, 4.0, 1, 3.0))
        ]
    sound = own.suction_session("aspiration", np.random.default_rng(4), legs=legs)
    judged = qualify([change(r) if r.info.specimen == specimen else r for r in sound]).qualification
    assert not judged.passed
    assert not judged.findings
    assert [text.split(":")[0] for text in judged.doubts] == [specimen]
    assert specimen in judged.against("aspiration")


ROBOT = (own.direction_cycles(0.0, 0.0, 1.2e-3, 4.0, 1), own.direction_cycles(1.57, 0.0, 1.2e-3, 4.0, 1))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("specimen", "wrong"),
    [("reference spring", {"k": "440±4 N/m"}), ("dead weight", {"mass": "22.00±0.02 g", "direction": "0, 0, -1"})],
)
def test_a_spring_and_a_mass_10_percent_off_are_doubted(specimen: str, wrong: dict[str, str]) -> None:
    spring = stated("reference spring", {"k": "400±4 N/m"})
    legs = [replace(leg, specimen="reference spring", known=spring) for leg in ROBOT]
    hanging = own.direction_cycles(0.0, 0.0, 1e-4, 4.0, 1)
    for direction in ("0, 0, -1", "1, 0, 0", "0, 1, 0"):
        said = stated("dead weight", {"mass": "20.00±0.02 g", "direction": direction})
        legs.append(replace(hanging, specimen="dead weight", known=said))
    made = own.robot_session(np.random.default_rng(4), legs=legs)
    of = [k for k, r in enumerate(made) if r.info.specimen == specimen]
    for k in of if specimen == "reference spring" else of[:1]:
        made[k] = replace(made[k], info=replace(made[k].info, specimen_properties=stated(specimen, wrong)))
    judged = qualify(made).qualification
    assert not judged.passed
    assert not judged.findings
    assert judged.doubts
    assert all(text.startswith(specimen) for text in judged.doubts)


@pytest.mark.slow
def test_the_command_passes_a_sound_instrument_names_a_fault_and_goes_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    common = ["--sim", "--yes", "--speed", "50", "--seed", "3", "--jobs", "1"]
    sound = tmp_path / "sound"
    assert run(["qualify", "cutometer", *common, "-o", str(sound), "--history", str(tmp_path / "h")]) == 0
    made = {p: p.stat().st_mtime_ns for p in (sound / "recordings").glob("*.h5")}
    assert len(made) == len(STANDARD["cutometer"])
    assert run(["qualify", "cutometer", *common, "-o", str(sound), "--history", str(tmp_path / "h")]) == 0
    assert {p: p.stat().st_mtime_ns for p in made} == made  # nothing was measured again
    assert "1 qualification in the history" in (sound / "qualification.html").read_text()
    capsys.readouterr()
    faulty = ["--effect", "sensor_gain:error=0.08", "-o", str(tmp_path / "faulty"), "--json"]
    assert run(["qualify", "cutometer", *common, *faulty]) == NOT_PASSED
    said = json.loads(capsys.readouterr().out)
    assert "sensor_gain" in said["findings"][0]["class"]
