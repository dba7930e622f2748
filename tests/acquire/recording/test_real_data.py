"""Real recordings and images go through: a servo drive, cascaded tanks, bubbles on a needle."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from nexusformat.nexus import nxload

from acquire.recording import load, open_recording, write_bundle, write_recording
from acquire.recording.model import difference
from acquire.report.figures import overview, save
from acquire.report.summary import in_words, summarise

ROOT = Path(__file__).parents[3]


def example(name: str) -> ModuleType:
    """The script examples/<name>/make_bundle.py as a module."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "examples" / name / "make_bundle.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", ["record", "pulses"])
def test_servo_drive(name: str, tmp_path: Path) -> None:
    made = example("emps").recording(name)
    imported = load(write_bundle(made, tmp_path / "bundle"))
    assert imported.info.id == f"emps-{name}"
    path = write_recording(imported, tmp_path / "run.h5")
    assert difference(imported, open_recording(path)) == ""
    assert ("disturbance" in imported.streams) == (name == "pulses")
    words = in_words(summarise(imported))
    assert "24841 samples, 1000 Hz" in words
    assert save(overview(imported), tmp_path / "a.png").stat().st_size > 10_000
    assert nxload(path).plottable_data.nxsignal.nxname == "position"


def test_servo_drive_obeys_its_documented_law() -> None:
    """Least squares on the imported channels gives the published mass, friction and offset within 1 %."""
    from scipy.signal import butter, filtfilt

    streams = example("emps").recording("record").streams
    time, force = streams["position"].time, streams["motor_force"].value
    b, a = butter(4, 100 / 500)
    velocity = np.gradient(filtfilt(b, a, streams["position"].value), time)
    moving = np.abs(velocity) > 1e-3
    columns = [np.gradient(velocity, time), velocity, np.sign(velocity), np.ones_like(time)]
    found, *_ = np.linalg.lstsq(np.column_stack(columns)[moving], filtfilt(b, a, force)[moving], rcond=None)
    assert found == pytest.approx([95.11, 203.50, 20.39, -3.16], rel=0.011)


@pytest.mark.parametrize("name", ["estimation", "validation"])
def test_tanks_are_a_bundle_as_they_are(name: str) -> None:
    recording = load(ROOT / "tests" / "data" / "cascaded_tanks" / f"{name}.yaml")
    level = recording.stream("level")
    assert len(level.value) == 1024
    assert level.time[-1] == 4 * 1023
    assert np.mean(level.value == 10.0) == pytest.approx({"estimation": 0.046, "validation": 0.037}[name], abs=0.001)
    assert level.unit == "V"


def test_bubbles(tmp_path: Path) -> None:
    module = example("bubble_bundle")
    recording = load(module.make_bundle("calibrated", tmp_path / "calibrated"))
    # 1100 of the full image's rows from the neck to the apex, at 3.1 µm.
    assert recording.stream("apex_height").value == pytest.approx([3.41e-3], rel=0.03)
    assert recording.derived["contour_confidence"].value[0] > 0.5
    assert np.nanmax(recording.derived["profile"].value) == pytest.approx(3.41e-3, rel=0.03)
    low, high = (recording.derived[f"apex_{end}"].value[0] for end in ("low", "high"))
    assert low <= recording.stream("apex_height").value[0] <= high
    path = write_recording(recording, tmp_path / "run.h5")
    assert nxload(path).plottable_data.nxsignal.nxname == "apex_height"
    assert difference(recording, open_recording(path)) == ""
    for name, height in {"gttab": 2.32e-3, "gwater": 2.50e-3}.items():  # at the assumed scale
        other = load(module.make_bundle(name, tmp_path / name))
        assert other.stream("apex_height").value == pytest.approx([height], rel=0.03)
        assert other.derived["contour_confidence"].value[0] > 0.5
