"""Most frames are kept in the region of the edge only: without loss there, whole now and then, and told in the file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from acquire.analysis.frames import with_contour
from acquire.engine.recorder import Recorder
from acquire.recording import JournalWriter, RunInfo, finalise, open_recording, read_journal, recover, write_recording
from acquire.recording.region import Keeper
from drivers.aspiration.contour import Pipeline, Settings
from drivers.aspiration.live import LiveApex
from drivers.contour import Contour
from drivers.signals import Frame, Region
from sim_devices.stages.scene import Scene

SCALE, RATE, COUNT = 1e-4, 25.0, 300
SCENE = Scene((160, 120), SCALE, 8e-3)
INFO = RunInfo("r", "aspiration", "2026-01-01T12:00:00+00:00")


def height(time: float) -> float:
    """Apex height (m): at rest for a second, then up to 1.5 mm."""
    return 1.5e-3 * min(max(time - 1.0, 0.0), 1.0)


@pytest.fixture(scope="module")
def frames() -> list[Frame]:
    """Frames with the contour that was read in each when it came."""
    live = LiveApex(SCALE)
    found = []
    for number in range(COUNT):
        image = SCENE(height(number / RATE), number / RATE)
        live(image)
        found.append(Frame(image, number, number / RATE, 0.0, live.latest))
    return found


@pytest.fixture(scope="module")
def region() -> Region:
    """Where the edge can be, by the tissue at rest."""
    live = LiveApex(SCALE)
    assert live.region(4e-3) is None  # nothing seen yet
    live(SCENE(0.0))
    found = live.region(4e-3)
    assert found is not None
    return found


def recorded(folder: Path, frames: list[Frame], region: Region | None) -> JournalWriter:
    """A journal of ``frames`` as the recorder writes it, not ended."""
    gvt = {"gvt": {"value": frames[0].contour.gvt, "unit": "1", "provenance": "measured"}}  # type: ignore[union-attr]
    writer = JournalWriter(folder / "run.journal", replace(INFO, calibration=gvt), frame_scale=SCALE, region=region)
    keeper = Keeper(region)
    for frame in frames:
        writer.frame(frame, whole=keeper.whole(frame))
    return writer


def test_the_region_holds_the_rim_and_half_a_ball(region: Region) -> None:
    rim = SCENE.base_row
    assert (region.left, region.width) == (0, 160)
    assert region.top <= rim - 4e-3 / SCALE
    assert region.top + region.height > rim
    live = LiveApex(SCALE)
    live(SCENE(0.0))
    assert live.region(8e-3) is None  # nearly all of the picture
    upside_down = LiveApex(SCALE, Settings(apex="down"))
    upside_down(np.ascontiguousarray(SCENE(0.0)[::-1]))
    turned = upside_down.region(4e-3)
    assert turned is not None
    assert turned.top <= 119 - rim
    assert turned.top + turned.height > 119 - rim + 4e-3 / SCALE


def test_a_frame_is_whole_where_the_edge_may_lie_outside(frames: list[Frame], region: Region) -> None:
    keeper = Keeper(region)
    kept = [keeper.whole(frame) for frame in frames]
    assert np.flatnonzero(kept).tolist() == [0, 250]
    high = replace(frames[30].contour, profile=np.full(160, region.top + 3.0))  # type: ignore[type-var]
    for odd in (None, Contour(100.0, flags=("no_tissue",)), high):
        assert keeper.whole(replace(frames[30], time=10.5, contour=odd))
    assert not keeper.whole(replace(frames[30], time=10.5))
    assert Keeper(None).whole(frames[1])


def test_what_is_kept_comes_back_bit_by_bit(tmp_path: Path, frames: list[Frame], region: Region) -> None:
    whole = recorded(tmp_path / "whole", frames, None).size
    writer = recorded(tmp_path, frames, region)
    assert writer.size < 0.85 * whole
    journal = read_journal(writer.path).frames
    path = finalise(writer, tmp_path / "run.h5")
    recording = open_recording(path)
    copy = open_recording(write_recording(recording, tmp_path / "copy.h5")).frames
    assert recording.frames is not None
    for found in (journal, recording.frames, copy):
        assert found is not None
        assert found.data.kept == recording.frames.data.kept
        everything = np.asarray(found.data)
        for number in (0, 40, 249, 250, 299):
            shown = frames[250 if number >= 250 else 0].image.copy()
            shown[region.place] = frames[number].image[region.place]
            assert np.array_equal(found.data[number], shown), number
            assert np.array_equal(everything[number], shown), number
    with h5py.File(path) as file:  # without anything of ours
        group = file["entry/frames"]
        assert group["data"].shape == (COUNT, 120, 160)
        assert np.array_equal(group["data"][40][region.place], frames[40].image[region.place])
        assert np.array_equal(group["data"][250], frames[250].image)
        assert np.flatnonzero(group["whole"]).tolist() == [0, 250]
        assert group.attrs["region"].tolist() == [0, region.top, 160, region.height]
        assert b"all of 2 of 300 frames" in group.attrs["kept"]
    assert any(event.code == "region" for event in recording.events)


def test_a_killed_run_s_frames_are_recovered(tmp_path: Path, frames: list[Frame], region: Region) -> None:
    writer = recorded(tmp_path, frames[:60], region)
    (tmp_path / "killed.journal").write_bytes(writer.path.read_bytes()[:-7])
    writer.close()
    found = open_recording(recover(tmp_path / "killed.journal")).frames
    assert found is not None
    assert len(found.data) == 60  # the contour was cut, not its frame
    assert np.array_equal(found.data[59][region.place], frames[59].image[region.place])


def test_contours_of_the_run_are_not_read_again(
    tmp_path: Path, frames: list[Frame], region: Region, monkeypatch: pytest.MonkeyPatch
) -> None:
    read: list[int] = []
    measure = Pipeline.measure
    monkeypatch.setattr(Pipeline, "measure", lambda self, frame: read.append(1) or measure(self, frame))
    # The last was read at another threshold, and two were not read at all.
    odd = list(frames)
    odd[-1] = replace(frames[-1], contour=replace(frames[-1].contour, gvt=99.0))  # type: ignore[type-var]
    odd[7:9] = (replace(frame, contour=None) for frame in frames[7:9])
    recording = open_recording(finalise(recorded(tmp_path, odd, region), tmp_path / "run.h5"))
    assert len(read) == 3
    again = with_contour(recording, Settings(gvt=recording.info.calibration["gvt"]["value"]))
    assert len(read) == 3 + COUNT
    for name, series in recording.derived.items():
        assert np.nanmax(np.abs(series.value - again.derived[name].value)) < 0.05 * (SCALE if series.unit == "m" else 1)


def test_the_recorder_keeps_the_region_of_its_run(tmp_path: Path, frames: list[Frame], region: Region) -> None:
    failures: list[str] = []
    recorder = Recorder(tmp_path / "run.h5", INFO, (), failures.append, SCALE, region=region)
    recorder.start()
    for frame in frames[:30]:
        recorder.put(frame)
    path = recorder.finish("completed", "").result(30)
    recorder.join()
    found = open_recording(path).frames
    assert not failures
    assert found is not None
    assert found.data.kept.region == region
