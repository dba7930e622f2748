"""Recordings that a folder of a qualification holds already: which are taken, and which are refused."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from acquire.engine import Aborted
from acquire.qualifications import SERIAL
from acquire.recording import Recording, RunInfo, Series, write_recording
from acquire.session import Request, Session
from acquire.station import simulated_station
from gap.qualify.bench import measure
from gap.qualify.judge import _date
from gap.qualify.kept import in_words, kept
from gap.qualify.steps import STANDARD, Step
from protocols import find, load

ADDRESS = "address: /dev/ttyUSB0\n    options:"
EFFECT = ("sensor_gain:error=0.08",)
Change = Callable[[RunInfo], RunInfo]


def of_serial(number: str) -> Change:
    told = {"value": number, "unit": "", "provenance": "documented", "note": ""}
    return lambda info: replace(info, calibration={**info.calibration, SERIAL: told})


def put(
    folder: Path, steps: tuple[Step, ...], change: Change = lambda info: info, effects: tuple[str, ...] = ()
) -> None:
    """Recordings of ``steps`` as a simulated Cutometer with ``effects`` makes them, their texts alone."""
    folder.mkdir(exist_ok=True)
    with Session(simulated_station(effects=effects)) as session:
        for step in steps:
            request = Request(specimen=step.specimen, specimen_properties=step.known)
            info = session.plan("cutometer", load(find(step.protocol)), request).info
            time = np.arange(3.0)
            streams = {"pressure": Series(np.zeros(3), time, "Pa", time, np.arange(3))}
            info = replace(info, start_time="2026-05-02T10:00:00+00:00", end_time="2026-05-02T10:00:03+00:00")
            write_recording(Recording(change(of_serial("SIM-C1")(info)), streams), folder / f"{step.name}.h5")


STEPS = STANDARD["cutometer"]


def taken(folder: Path, instrument: str = "cutometer", effects: tuple[str, ...] = ()) -> str:
    """How many steps a simulated instrument with ``effects`` need not measure again, in words."""
    with Session(simulated_station(effects=effects)) as session:
        return in_words(kept(session, instrument, STANDARD[instrument], folder), STANDARD[instrument])


def test_recordings_of_the_same_instrument_are_taken_and_told(tmp_path: Path) -> None:
    put(tmp_path / "some", STEPS[:2])
    assert taken(tmp_path / "some") == "2 of 6 steps taken from recordings of 2026-05-02"
    put(tmp_path / "faulty", STEPS, effects=EFFECT)
    assert taken(tmp_path / "faulty", effects=EFFECT).startswith("6 of 6 steps")
    put(tmp_path / "stopped", STEPS[:1], lambda info: replace(info, status="aborted"))
    assert taken(tmp_path / "stopped") == "0 of 6 steps taken from recordings"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda info: replace(info, protocol=info.protocol.replace("4 s", "5 s")), "another protocol"),
        (lambda info: replace(info, specimen="manometer"), "is of a manometer"),
        (of_serial("C8"), "is of serial number C8, not of SIM-C1"),
        (lambda info: replace(info, station=info.station.replace("simulated:", ADDRESS)), "a real instrument"),
    ],
    ids=["protocol", "specimen", "serial number", "real"],
)  # fmt: skip
def test_recordings_of_another_measurement_are_refused(tmp_path: Path, change: Change, words: str) -> None:
    put(tmp_path, STEPS[:1], change)
    with pytest.raises(ValueError, match=rf"block\.h5: .*{words}"):
        taken(tmp_path)


def test_recordings_of_another_instrument_or_with_other_effects_are_refused(tmp_path: Path) -> None:
    put(tmp_path, STEPS)
    with pytest.raises(ValueError, match=r"block\.h5: is of instrument cutometer, not of aspiration"):
        taken(tmp_path, "aspiration")
    with pytest.raises(ValueError, match="with no effects, and this is a simulated instrument with sensor_gain"):
        taken(tmp_path, effects=EFFECT)


def test_an_effect_that_cannot_be_simulated_is_refused_before_anybody_mounts_anything(tmp_path: Path) -> None:
    asked: list[int] = []

    def ask(number: int, step: Step) -> None:
        asked.append(number)
        raise Aborted("asked")

    with (
        Session(simulated_station(effects=("sensor_gain:gain=1.08",))) as session,
        pytest.raises(ValueError, match=r"sensor_gain has no parameter 'gain=1\.08'"),
    ):
        measure(session, "cutometer", STEPS, tmp_path, ask)
    assert not asked


def test_a_qualification_is_dated_by_its_oldest_recording() -> None:
    runs = [
        Recording(RunInfo("a", "cutometer", day), {})
        for day in ("2026-05-02T10:00:00+00:00", "2026-04-30T23:00:00+02:00", "")
    ]
    assert _date(runs) == datetime(2026, 4, 30, 21, tzinfo=UTC)
    assert (datetime.now(UTC) - _date(runs[2:])).total_seconds() < 5
