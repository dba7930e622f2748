"""The diagnosis on real machines whose truth is published."""

from __future__ import annotations

import csv
import importlib.util
from pathlib import Path

import numpy as np
import pytest

from acquire.recording.model import Recording, RunInfo, Series
from gap.diagnosis import diagnose
from gap.report.document import as_json
from gap.rig.model import load_model

ROOT = Path(__file__).parents[3]


def emps(name: str) -> Recording:
    spec = importlib.util.spec_from_file_location("make_bundle", ROOT / "examples/emps/make_bundle.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    made: Recording = module.recording(name)
    return made


def tanks(part: str) -> Recording:
    with open(ROOT / "tests/data/cascaded_tanks/dataBenchmark.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    time = 4.0 * np.arange(len(rows))
    pump, level = (np.array([float(r[f"{c}{part}"]) for r in rows]) for c in "uy")
    info = RunInfo(f"tanks-{part}", "tanks", "")
    return Recording(info, {"level": Series(level, time, "V")}, {"pump": Series(pump, time, "V")})


@pytest.fixture(scope="module")
def servo_report() -> dict:
    model = load_model(f"{ROOT}/examples/emps/model.py:Servo")
    return as_json(diagnose([emps("record"), emps("pulses")], model=model))


def test_emps_is_told_coulomb_friction_at_the_actuator(servo_report: dict) -> None:
    cause = servo_report["causes"][0]
    assert servo_report["verdict"] == "effect"
    assert cause["effects"] == ["coulomb_friction"]
    assert servo_report["where"][0]["stage"] == "actuator"
    assert cause["parameters"]["level"]["value"] == pytest.approx(20.39, rel=0.1)


def test_emps_gap_shrinks_also_on_the_record_with_pulses(servo_report: dict) -> None:
    force = emps("record").streams["motor_force"].value
    gap = servo_report["gap"]
    assert gap["after"] < 0.35 * gap["before"]
    assert servo_report["causes"][0]["shrink"]["repeat"] > 0.6
    assert np.std(force) > 0


@pytest.mark.parametrize("parts", [("Est",), ("Val",), ("Est", "Val")])
def test_tanks_are_told_saturation_and_never_friction(parts: tuple[str, ...]) -> None:
    report = as_json(
        diagnose([tanks(part) for part in parts], load_model(f"{ROOT}/examples/cascaded_tanks/model.py:Tanks"))
    )
    assert report["verdict"] == "effect"
    assert report["causes"][0]["effects"] == ["saturation"]
    assert report["where"][0]["stage"] == "sensor"
    assert not any("friction" in e for c in report["causes"] for e in c["class"] if c["probability"] > 0.05)
