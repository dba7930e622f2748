"""Pauses and early ends on the byte-level simulated instruments: done right, and recorded as done."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from acquire.engine import RunEngine, State
from acquire.recording import Recording, open_recording
from acquire.session import Session
from acquire.station import simulated_station

SUCTION = """\
schema: protocol/1
name: pausing
instrument: {kind}
steps:
  - {{type: hold, suction: 150 mbar, duration: 6 s}}
  - {{type: wait, duration: 1 s}}
"""
ROBOT = """\
schema: protocol/1
name: pausing
instrument: microrobot
limits: {probe: {low: 0 mm, high: 1.5 mm, rate: 1 mm/s}}
steps:
  - type: trajectory
    amplitude: 1 mm
    frequency: 0.2 Hz
    cycles: 2
    directions: [{theta: 30 deg, phi: 0 deg}]
"""
UNTIL = """\
schema: protocol/1
name: until
instrument: cutometer
steps:
  - {type: ramp, suction: 400 mbar, rate: 50 mbar/s, until: {channel: apex_height, above: 0.1 mm}}
  - {type: hold, suction: 100 mbar, duration: 2 s}
  - {type: wait, duration: 1 s}
"""


def finished(engine: RunEngine) -> Recording:
    outcome = engine.wait(30)
    assert (outcome.status, outcome.reason, outcome.lost) == (State.COMPLETED, "", 0)
    assert outcome.recording is not None
    return open_recording(outcome.recording)


@pytest.mark.parametrize("kind", ["cutometer", "aspiration", "microrobot"])
def test_a_pause_vents_and_the_segment_is_repeated(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "pausing.yaml"
    path.write_text(ROBOT if kind == "microrobot" else SUCTION.format(kind=kind))
    with Session(simulated_station(seed=1), speed=5, out=tmp_path, frame_size=(160, 120)) as session:
        engine, plan = session.prepare(path)
        engine.arm(plan)
        engine.start()
        deadline = time.monotonic() + 20
        while engine.progress.elapsed < 1.5:
            assert time.monotonic() < deadline
            time.sleep(0.01)
        engine.pause()
        assert engine.state is State.PAUSED
        assert session.back_door(kind).wait_vented().state == "held"
        time.sleep(0.1)
        engine.resume()
        recording = finished(engine)
    events = {event.code: event.time for event in recording.events}
    for quantity, commanded in recording.setpoints.items():
        measured = recording.streams[quantity]
        paused = (measured.time > events["pause"] + 0.6) & (measured.time < events["resume"])
        size = np.abs(commanded.value).max()
        assert np.abs(measured.value[paused]).max(initial=0.0) <= 0.03 * size + 60e-6
        late = np.interp(measured.time - 0.08, commanded.time, commanded.value)
        near = np.abs(measured.value - late) < 0.05 * size + 60e-6
        assert near.mean() > 0.9  # everywhere but around steps and on the way back to the centre
    if kind != "microrobot":
        pressure = recording.streams["pressure"]
        rate = 1 / np.median(np.diff(pressure.time))
        assert np.sum(pressure.value < -14e3) / rate > 5.5 + 1.0  # the whole hold, and what was before the pause


def test_an_until_on_a_measured_height(tmp_path: Path) -> None:
    path = tmp_path / "until.yaml"
    path.write_text(UNTIL)
    with Session(simulated_station(seed=1), speed=4, out=tmp_path) as session:
        engine, plan = session.prepare(path)
        engine.arm(plan)
        engine.start()
        recording = finished(engine)
    (event,) = [e for e in recording.events if e.code == "until"]
    height, commanded = recording.streams["apex_height"], recording.setpoints["pressure"]
    first = height.time[np.argmax(height.value > 0.1e-3)]
    assert event.time == pytest.approx(first, abs=0.05)
    assert -40e3 < commanded.value.min() < -5e3
    # The ramp ended soon after, and the hold began from the pressure that it had reached.
    bottom = commanded.time[np.argmin(commanded.value)]
    assert first < bottom < first + 1.0
    pressure = recording.streams["pressure"]
    assert pressure.value.min() == pytest.approx(commanded.value.min(), abs=600)
    end = np.median(pressure.value[(pressure.time > bottom + 1.0) & (pressure.time < bottom + 1.9)])
    assert end == pytest.approx(-10e3, abs=200)
