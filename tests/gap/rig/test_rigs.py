"""The diagnosis on real machines whose truth is published, and on generated stand-ins of the same form."""

from __future__ import annotations

import csv

import numpy as np
import pytest

from acquire.recording.model import Recording, RunInfo, Series
from gap.diagnosis import diagnose
from gap.report.document import as_json
from gap.rig.model import load_model
from tests.conftest import Folder
from tests.standins import ROOT, example

pytestmark = pytest.mark.slow


def emps(name: str, recordings: Folder) -> Recording:
    made: Recording = example("emps").recording(name, recordings("emps"))
    return made


def tanks(part: str, recordings: Folder) -> Recording:
    with open(recordings("cascaded_tanks") / "dataBenchmark.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    time = 4.0 * np.arange(len(rows))
    pump, level = (np.array([float(r[f"{c}{part}"]) for r in rows]) for c in "uy")
    info = RunInfo(f"tanks-{part}", "tanks", "")
    return Recording(info, {"level": Series(level, time, "V")}, {"pump": Series(pump, time, "V")})


@pytest.fixture(scope="module")
def servo_report(recordings: Folder) -> dict:
    model = load_model(f"{ROOT}/examples/emps/model.py:Servo")
    return as_json(diagnose([emps("record", recordings), emps("pulses", recordings)], model=model))


def test_emps_is_told_friction_at_the_actuator(servo_report: dict) -> None:
    cause = servo_report["causes"][0]
    assert servo_report["verdict"] == "effect"
    assert "friction" in cause["effects"][0]
    assert servo_report["where"][0]["stage"] == "actuator"
    assert cause["parameters"]["level"]["value"] == pytest.approx(20.39, rel=0.1)


@pytest.mark.parametrize("recordings", ["published"], indirect=True)
def test_the_real_emps_is_told_coulomb_friction(servo_report: dict) -> None:
    assert servo_report["causes"][0]["effects"] == ["coulomb_friction"]


def test_emps_gap_shrinks_also_on_the_record_with_pulses(servo_report: dict) -> None:
    gap = servo_report["gap"]
    assert gap["after"] < 0.35 * gap["before"]
    assert servo_report["causes"][0]["shrink"]["repeat"] > 0.6


@pytest.mark.parametrize("parts", [("Est",), ("Val",), ("Est", "Val")])
def test_tanks_are_told_saturation_and_never_friction(parts: tuple[str, ...], recordings: Folder) -> None:
    model = load_model(f"{ROOT}/examples/cascaded_tanks/model.py:Tanks")
    report = as_json(diagnose([tanks(part, recordings) for part in parts], model))
    assert report["verdict"] == "effect"
    assert report["causes"][0]["effects"] == ["saturation"]
    assert report["where"][0]["stage"] == "sensor"
    assert not any("friction" in e for c in report["causes"] for e in c["class"] if c["probability"] > 0.05)
