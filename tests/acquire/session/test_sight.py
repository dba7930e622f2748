"""The threshold and the region of a run's frames are settled before it, by what the camera sees."""

from __future__ import annotations

from pathlib import Path

import pytest

from acquire.recording import open_recording
from acquire.session import Session
from acquire.station import simulated_station
from protocols import Protocol, find, load

FRAMES = {"region": True, "full": False}


def by(protocol: Protocol, frames: str | None) -> Protocol:
    """``protocol`` that says how much of each frame is recorded."""
    return protocol.model_copy(update={"setup": protocol.setup.model_copy(update={"frames": frames})})


@pytest.mark.parametrize("station_says", list(FRAMES))
def test_the_protocol_says_how_much_of_a_frame_is_kept_else_the_station(tmp_path: Path, station_says: str) -> None:
    station = simulated_station(seed=0)
    entry = station.instruments["aspiration"].model_copy(update={"frames": station_says})
    station = station.model_copy(update={"instruments": {"aspiration": entry}})
    demo = load(find("demo-aspiration"))
    with Session(station, speed=4, out=tmp_path) as session:
        for protocol_says in (None, *FRAMES):
            _, plan = session.prepare(by(demo, protocol_says))
            assert plan.info.calibration["gvt"]["note"] == "proposed before the run"
            assert (plan.region is not None) == FRAMES[protocol_says or station_says]


def test_a_run_is_recorded_with_the_contours_of_its_region(tmp_path: Path) -> None:
    text = """
        schema: protocol/1
        name: short
        instrument: aspiration
        setup: {opening: 8 mm}
        steps:
          - {type: ramp, suction: 100 mbar, rate: 100 mbar/s}
    """
    (tmp_path / "short.yaml").write_text(text)
    with Session(simulated_station(seed=0), speed=4, out=tmp_path) as session:
        outcome = session.run(tmp_path / "short.yaml")
    assert outcome.recording is not None, outcome.reason
    recording = open_recording(outcome.recording)
    assert recording.frames is not None
    count = len(recording.frames.time)
    assert recording.frames.data.kept.whole.sum() < 0.2 * count
    told = next(event.text for event in recording.events if event.code == "contour")
    assert f"{count} of {count} frames were read during the run" in told
