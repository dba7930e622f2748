"""Small recordings for the tests of this package."""

from __future__ import annotations

import numpy as np

from acquire.recording import Event, Frames, Recording, RunInfo, Series

PROTOCOL = "schema: protocol/1\nname: step\n# µ: a text is kept to the byte\n"


def sample_recording(samples: int = 3000, *, frames: int = 5, run_id: str = "20260101-120000-cutometer") -> Recording:
    """A step of -300 mbar with its apex height, some frames, events and a derived profile."""
    time = np.arange(samples) / 100.0
    host, seq = time + 1000.0, np.arange(samples, dtype=np.int64)
    pressure = np.where(time < 0.5 * time[-1], -3e4, 0.0)
    height = 2e-4 * (1 - np.exp(-time))
    images = np.random.default_rng(0).integers(0, 255, (frames, 24, 32), dtype=np.uint8)
    return Recording(
        info=RunInfo(
            id=run_id,
            instrument="cutometer",
            start_time="2026-01-01T12:00:00+00:00",
            end_time="2026-01-01T12:00:30+00:00",
            protocol=PROTOCOL,
            protocol_name="step",
            subject="P07",
            site="forehead",
            operator="ä",
            repeat=2,
            notes="a note",
            versions={"skinrig": "0.1.0", "numpy": np.__version__},
            station="schema: station/1\n",
            limits={"pressure": (-5e4, 0.0)},
            calibration={
                "opening": {"value": 2e-3, "unit": "m", "provenance": "documented"},
                "matrix": {"value": np.eye(3), "unit": "1", "provenance": "assumed"},
                "probe": {"value": "A12", "unit": "", "provenance": "reported", "source": "label"},
            },
        ),
        streams={
            "pressure": Series(pressure, time, "Pa", host, seq, "actuator", (-5e4, 0.0), 100.0),
            "apex_height": Series(height, time, "m", host, seq, "sensor", (0.0, 4e-3), 1e-5),
        },
        setpoints={"pressure": Series(np.array([0.0, -3e4, -3e4, 0.0]), np.array([0.0, 0.0, 15.0, 15.0]), "Pa")},
        frames=Frames(images, np.arange(frames) / 25.0, 2e-5, np.arange(3, frames + 3)) if frames else None,
        events=(Event(0.0, "info", "start", "läuft"), Event(15.0, "warning", "late", "a sample came late")),
        derived={"profile": Series(np.ones((frames, 7)), np.arange(frames) / 25.0, "m", seq=np.arange(frames))}
        if frames
        else {},
    )
