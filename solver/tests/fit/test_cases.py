"""Recordings become cases, or are refused by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from recovery import Info, Recording, Series

from skinrig_solver import models
from skinrig_solver.fit import RecordingError, read_spec
from skinrig_solver.fit.cases import Case, cases

Record = Callable[..., Recording]
TRUTH = {"a": 1e-4}


def made(recordings: list[Recording], /, **options: object) -> list[Case]:
    name = str(options.pop("model", "suction_yeoh_qlv"))
    return cases(recordings, read_spec({"model": name, **options}), models()[name].info)


def test_time_starts_at_zero_and_protocol_gives_the_opening(record: Record) -> None:
    recording = record(TRUTH, protocol="schema: protocol/1\nsetup: {opening: 6 mm}\n")
    late = {k: replace(s, time=s.time + 100.0) for k, s in recording.streams.items()}
    (case,) = made([replace(recording, streams=late)])
    assert case.experiment.time[0] == 0.0
    assert case.experiment.geometry == {"opening_radius": 3e-3}
    (case,) = made([recording], geometry={"opening_radius": "1 mm"})
    assert case.experiment.geometry == {"opening_radius": 1e-3}
    assert case.size == 401
    assert case.scale["apex_height"] == np.abs(case.data["apex_height"]).max()


def test_channels_of_their_own_rate_and_holes_are_brought_together(record: Record) -> None:
    recording = record(TRUTH)
    pressure, height = recording.streams["pressure"], recording.streams["apex_height"]
    value = height.value.copy()
    value[50:60] = np.nan
    streams = {
        "pressure": Series(pressure.time[::3], pressure.value[::3], "Pa"),
        "apex_height": Series(height.time, value, "m"),
    }
    (case,) = made([replace(recording, streams=streams)])
    assert case.size == 391
    assert np.all(np.isfinite(case.data["apex_height"]))
    assert np.abs(case.experiment.drive["pressure"]).max() == pytest.approx(3e4, rel=0.05)


def test_set_points_stand_in_for_a_drive_that_was_not_recorded(record: Record) -> None:
    recording = record(TRUTH)
    bare = replace(recording, streams={"apex_height": recording.streams["apex_height"]})
    with pytest.raises(RecordingError, match="recording run-0 has no channel or set-point 'pressure'"):
        made([bare])
    command = Series(np.array([0.0, 1.0, 1.0, 20.0]), np.array([0.0, 0.0, -2e4, -2e4]), "Pa")
    (case,) = made([replace(bare, setpoints={"pressure": command})])
    assert case.note == "pressure was not recorded: set-point used"
    assert case.experiment.drive["pressure"][-1] == -2e4
    with_both = replace(recording, setpoints={"pressure": command})
    assert made([with_both], drive="commanded")[0].experiment.drive["pressure"][-1] == -2e4


def test_thinning_picks_suction_and_averages_the_sheet(record: Record) -> None:
    (case,) = made([record(TRUTH)], samples=100)
    assert case.size == 81
    assert case.note == "81 of 401 samples, evenly picked"
    time = np.arange(0.0, 10.0, 1e-3)
    names = {f"probe_{x}": "m" for x in "xyz"} | {f"force_{x}": "N" for x in "xyz"}
    robot = Recording(Info("robot", "microrobot"), {n: Series(time, 1e-3 * time, unit) for n, unit in names.items()})
    (case,) = made([robot], model="sheet_ogden", samples=100)
    assert case.size == 300
    assert case.note == "100 of 10000 samples, means of neighbours"
    assert case.data["force_x"] == pytest.approx(case.experiment.drive["probe_x"])


def test_phases_and_balance_weigh_samples(record: Record) -> None:
    phases = [{"from": 0, "to": 5, "weight": 3}, {"from": 5, "to": 10}]
    (case,) = made([record(TRUTH)], phases=phases, phase_origin="load")
    weight, time = case.weight["apex_height"] ** 2, case.experiment.time - 1.05
    first, second = weight[(time >= 0) & (time < 5)].sum(), weight[(time >= 5) & (time < 10)].sum()
    assert first / second == pytest.approx(3.0)
    assert weight[time < -0.1].max() == weight[time > 10].max() == 0.0
    assert weight[weight > 0].mean() == pytest.approx(1.0)
    short = record(TRUTH)
    streams = {k: Series(s.time[:201], s.value[:201], s.unit) for k, s in short.streams.items()}
    both = made([record(TRUTH), replace(short, info=Info("b", "cutometer"), streams=streams)], balance="recordings")
    sums = [(c.weight["apex_height"] ** 2).sum() for c in both]
    assert sums[0] == pytest.approx(sums[1])


def test_options_reach_the_recordings_they_mean(record: Record) -> None:
    recordings = [record(TRUTH), record(TRUTH, seed=1, instrument="aspiration"), record(TRUTH, seed=2)]
    wide = {"geometry": {"radius": "50 mm"}}
    found = made(recordings, recordings={"aspiration": wide, "run-0": {"weight": 4}, "3": {"skip": True}})
    assert [c.label for c in found] == ["run-0", "run-1"]
    assert found[0].weight["apex_height"][0] == 2.0
    assert found[1].experiment.geometry == {"radius": 50e-3, "opening_radius": 4e-3}
    with pytest.raises(RecordingError, match=r"recordings\.forehead: fits none of"):
        made(recordings, recordings={"forehead": {"skip": True}})
    assert [c.label for c in made([record(TRUTH), record(TRUTH)])] == ["run-0", "run-0'"]


def test_what_cannot_be_compared_is_refused_by_name(record: Record) -> None:
    recording = record(TRUTH)
    height, pressure = recording.streams["apex_height"], recording.streams["pressure"]

    def with_height(series: Series) -> Recording:
        return replace(recording, streams={"pressure": pressure, "apex_height": series})

    for bad, words in (
        (replace(recording, info=Info("r", "microrobot")), "is of a microrobot"),
        (replace(recording, streams={"pressure": pressure}), "no channel 'apex_height'; it has pressure"),
        (with_height(Series(height.time, height.value, "mm")), "is in 'mm', not in 'm'"),
        (with_height(Series(height.time, height.value * np.nan, "m")), "only 0 samples have finite values"),
        (with_height(Series(height.time, height.value * 0.0, "m")), "are zero throughout"),
        (with_height(Series(height.time, np.ones((401, 2)), "m")), "has shape"),
    ):
        with pytest.raises(RecordingError, match=words):
            made([bad])
    with pytest.raises(RecordingError, match="at least one recording"):
        made([])
    with pytest.raises(RecordingError, match=r"channels\.force_x"):
        made([recording], channels={"force_x": 1})
    with pytest.raises(RecordingError, match="weight 0"):
        made([recording], channels={"apex_height": 0})
    with pytest.raises(RecordingError, match="no recorded sample"):
        made([recording], phases=[{"from": 100, "to": 200}])


def test_an_idle_component_does_not_count_as_signal() -> None:
    time = np.arange(0.0, 10.0, 0.1)
    sizes = {"x": 1.0, "y": 0.5, "z": 1e-3}
    streams = {f"probe_{x}": Series(time, 1e-3 * time, "m") for x in "xyz"}
    streams |= {f"force_{x}": Series(time, size * time / time[-1], "N") for x, size in sizes.items()}
    (case,) = made([Recording(Info("robot", "microrobot"), streams)], model="sheet_ogden")
    assert case.scale == pytest.approx({"force_x": 1.0, "force_y": 0.5, "force_z": 0.1})
