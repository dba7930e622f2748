"""The numbers known of a reference specimen: kept by every way in and out, and told where they are wrong."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from acquire.recording import (
    JournalWriter,
    Recording,
    RecordingError,
    open_recording,
    read_bundle,
    read_journal,
    write_bundle,
    write_recording,
)
from acquire.recording.model import difference
from protocols.specimens import stated
from tests.acquire.recording.samples import sample_recording


@pytest.fixture
def on_a_weight() -> Recording:
    known = stated("dead weight", {"mass": "20.00±0.02 g", "direction": "0, 0.6, -0.8"})
    recording = sample_recording(30, frames=0)
    return replace(
        recording,
        info=replace(recording.info, instrument="microrobot", specimen="dead weight", specimen_properties=known),
    )


def test_file_bundle_and_journal_keep_them(on_a_weight: Recording, tmp_path: Path) -> None:
    known = on_a_weight.info.specimen_properties
    file = open_recording(write_recording(on_a_weight, tmp_path / "weight.h5"))
    assert file.info.specimen_properties == known
    assert difference(on_a_weight, replace(file, info=replace(file.info, specimen_properties={}))) != ""
    assert read_bundle(write_bundle(on_a_weight, tmp_path / "bundle")).info.specimen_properties == known
    with JournalWriter(tmp_path / "weight.journal", on_a_weight.info):
        pass
    assert read_journal(tmp_path / "weight.journal").info.specimen_properties == known
    with h5py.File(tmp_path / "weight.h5") as h5:
        mass = h5["entry/run/specimen_properties/mass"]
        assert (mass.attrs["units"], mass.attrs["se"]) == (b"kg", 2e-5)


def test_file_bundle_and_journal_keep_the_experiment(on_a_weight: Recording, tmp_path: Path) -> None:
    answer = replace(on_a_weight, info=replace(on_a_weight.info, experiment="microrobot_dead_weight.0.10.a.b"))
    named = answer.info.experiment
    assert open_recording(write_recording(answer, tmp_path / "weight.h5")).info.experiment == named
    assert read_bundle(write_bundle(answer, tmp_path / "bundle")).info.experiment == named
    with JournalWriter(tmp_path / "weight.journal", answer.info):
        pass
    assert read_journal(tmp_path / "weight.journal").info.experiment == named


BUNDLE = """\
schema: recording-bundle/1
instrument: {instrument}
specimen: {specimen}
specimen_properties:
  {properties}
channels:
  pressure: {{file: data.csv, column: p, unit: mbar, time: {{column: t, unit: s}}}}
"""


def bundle(folder: Path, instrument: str, specimen: str, properties: str) -> Path:
    folder.mkdir(exist_ok=True)
    text = BUNDLE.format(instrument=instrument, specimen=specimen, properties=properties)
    (folder / "recording.yaml").write_text(text)
    time = np.arange(20) / 100
    np.savetxt(folder / "data.csv", np.column_stack([time, 0 * time]), header="t,p", delimiter=",", comments="")
    return folder


def test_outside_bundles_state_them_in_several_ways(tmp_path: Path) -> None:
    for text in ("height: 1.000±0.002 mm", "height: {value: 1.0, se: 0.002, unit: mm}", "height: 0.001"):
        info = read_bundle(bundle(tmp_path, "cutometer", "gauge step", text)).info
        assert info.specimen_properties["height"].scalar == pytest.approx(1e-3)
        assert info.specimen_properties["height"].se == pytest.approx(2e-6)


@pytest.mark.parametrize(
    ("instrument", "specimen", "properties", "words"),
    [
        ("cutometer", "gauge step", "mass: 3 g", r"recording.yaml:5.*mass: no property of a gauge step"),
        ("cutometer", "gauge step", "height: 3 g", r"recording.yaml:5.*height: is in kg, not in m"),
        ("microrobot", "gauge step", "height: 1 mm", r"recording.yaml:3.*not for a microrobot"),
    ],
)
def test_a_wrong_one_is_told_with_its_line(
    tmp_path: Path, instrument: str, specimen: str, properties: str, words: str
) -> None:
    with pytest.raises(RecordingError, match=words):
        read_bundle(bundle(tmp_path, instrument, specimen, properties))


def test_a_specimen_of_somebody_elses_is_imported(tmp_path: Path) -> None:
    info = read_bundle(bundle(tmp_path, "cutometer", "water", "depth: 3 mm")).info
    assert (info.specimen, info.specimen_properties["depth"].scalar) == ("water", pytest.approx(3e-3))
