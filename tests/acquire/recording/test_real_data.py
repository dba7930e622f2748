"""Real recordings and images, and stand-ins of the same form, go through: a servo drive, tanks, bubbles on a needle."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from nexusformat.nexus import nxload

from acquire.recording import load, open_recording, write_bundle, write_recording
from acquire.recording.model import difference
from acquire.report.figures import overview, save
from acquire.report.summary import in_words, summarise
from sim_devices.stages.scene import Scene
from tests.conftest import Folder
from tests.standins import BUBBLE_HEIGHT, example


@pytest.mark.parametrize("name", ["record", "pulses"])
def test_servo_drive(name: str, recordings: Folder, tmp_path: Path) -> None:
    made = example("emps").recording(name, recordings("emps"))
    imported = load(write_bundle(made, tmp_path / "bundle"))
    assert imported.info.id == f"emps-{name}"
    path = write_recording(imported, tmp_path / "run.h5")
    assert difference(imported, open_recording(path)) == ""
    assert ("disturbance" in imported.streams) == (name == "pulses")
    words = in_words(summarise(imported))
    assert f"{len(made.streams['position'].time)} samples, 1000 Hz" in words
    assert save(overview(imported), tmp_path / "a.png").stat().st_size > 10_000
    assert nxload(path).plottable_data.nxsignal.nxname == "position"


def test_servo_drive_obeys_its_documented_law(recordings: Folder) -> None:
    """Least squares on the imported channels gives the published mass, friction and offset within 1 %."""
    from scipy.signal import butter, filtfilt

    streams = example("emps").recording("record", recordings("emps")).streams
    time, force = streams["position"].time, streams["motor_force"].value
    b, a = butter(4, 100 / 500)
    velocity = np.gradient(filtfilt(b, a, streams["position"].value), time)
    moving = np.abs(velocity) > 1e-3
    columns = [np.gradient(velocity, time), velocity, np.sign(velocity), np.ones_like(time)]
    found, *_ = np.linalg.lstsq(np.column_stack(columns)[moving], filtfilt(b, a, force)[moving], rcond=None)
    assert found == pytest.approx([95.11, 203.50, 20.39, -3.16], rel=0.011)


@pytest.mark.parametrize("name", ["estimation", "validation"])
def test_tanks_are_a_bundle_with_their_table_as_it_is(name: str, recordings: Folder, tmp_path: Path) -> None:
    recording = load(example("cascaded_tanks").make_bundle(name, tmp_path, recordings("cascaded_tanks")))
    level = recording.stream("level")
    assert len(level.value) == 1024
    assert level.time[-1] == 4 * 1023
    assert 0.02 < np.mean(level.value == 10.0) < 0.2
    assert level.unit == "V"


def test_the_real_tanks_level_is_cut_off_as_published(public_data: Folder, tmp_path: Path) -> None:
    for name, part in {"estimation": 0.046, "validation": 0.037}.items():
        recording = load(example("cascaded_tanks").make_bundle(name, tmp_path / name, public_data("cascaded_tanks")))
        assert np.mean(recording.stream("level").value == 10.0) == pytest.approx(part, abs=0.001)


# Heights in m. 1100 of the first image's rows from the neck to the apex, at 3.1 µm; the others at the assumed scale.
REAL_BUBBLES = {"calibrated": 3.41e-3, "gttab": 2.32e-3, "gwater": 2.50e-3}


@pytest.mark.parametrize("name", REAL_BUBBLES)
def test_bubbles(name: str, public_data: Folder, tmp_path: Path) -> None:
    _goes_through(name, REAL_BUBBLES[name], public_data("bubble_on_needle_cc0"), tmp_path)


@pytest.mark.parametrize("name", REAL_BUBBLES)
def test_rendered_bubbles(name: str, stand_in: Folder, tmp_path: Path) -> None:
    scene = Scene()
    pixels = (scene.initial_height + BUBBLE_HEIGHT) / scene.scale
    _, every, size, _ = example("bubble_bundle").BUNDLES[name]
    _goes_through(name, pixels * every * size * 1e-3, stand_in("bubble_on_needle_cc0"), tmp_path)


def _goes_through(name: str, height: float, data: Path, folder: Path) -> None:
    recording = load(example("bubble_bundle").make_bundle(name, folder / "bundle", data))
    assert recording.stream("apex_height").value == pytest.approx([height], rel=0.03)
    assert recording.derived["contour_confidence"].value[0] > 0.5
    assert np.nanmax(recording.derived["profile"].value) == pytest.approx(height, rel=0.03)
    low, high = (recording.derived[f"apex_{end}"].value[0] for end in ("low", "high"))
    assert low <= recording.stream("apex_height").value[0] <= high
    path = write_recording(recording, folder / "run.h5")
    assert nxload(path).plottable_data.nxsignal.nxname == "apex_height"
    assert difference(recording, open_recording(path)) == ""
