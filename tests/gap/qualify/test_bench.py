"""Measuring the standard set: whatever an earlier attempt left, the same command repeats the step and loses nothing."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from acquire.catalogue import catalogue
from acquire.engine import State
from acquire.recording import JournalBusy, JournalWriter, RunInfo, open_recording, recover, write_recording
from acquire.recording.recovery import RECOVERED
from acquire.session import Request, Session
from acquire.station import simulated_station
from gap.qualify import bench
from gap.qualify.steps import STANDARD
from protocols import find, load
from tests.acquire.recording.samples import sample_recording

STEP = STANDARD["cutometer"][0]
SAMPLE = sample_recording(100, frames=0)


class Instrument(Session):
    """A simulated Cutometer whose runs come to their end at once."""

    def info(self) -> RunInfo:
        request = Request(specimen=STEP.specimen, specimen_properties=STEP.known)
        return self.plan("cutometer", load(find(STEP.protocol)), request).info

    def run(self, protocol: str, request: Request, *, out: Path, **_: object) -> SimpleNamespace:  # type: ignore[override]
        assert not out.with_suffix(".journal").exists()
        write_recording(replace(SAMPLE, info=replace(self.info(), id="repeated", status="completed")), out)
        return SimpleNamespace(status=State.COMPLETED, reason="")


@pytest.fixture
def info() -> RunInfo:
    """That of a run of the step."""
    with Instrument(simulated_station()) as session:
        return session.info()


def measured(folder: Path) -> str:
    """Id of the recording of the one step."""
    with Instrument(simulated_station()) as session:
        (recording,) = bench.measure(session, "cutometer", [STEP], folder, lambda number, step: None)
    return recording.info.id


def crash(folder: Path, info: RunInfo) -> Path:
    """The journal that a killed run of the step leaves."""
    writer = JournalWriter(folder / f"{STEP.name}.journal", replace(info, id="killed"))
    writer._repeat()
    os.close(writer.descriptor)
    return writer.path


@pytest.mark.parametrize("recovered", [False, True], ids=["journal", "recovered by hand"])
def test_a_killed_step_is_repeated_and_kept(tmp_path: Path, info: RunInfo, recovered: bool) -> None:
    journal = crash(tmp_path, info)
    if recovered:
        recover(journal)  # and the journal is there still
    assert measured(tmp_path) == "repeated"
    found = {entry.path.name: entry.info.id if entry.info else entry.problem for entry in catalogue(tmp_path)}
    assert found.pop(f"{STEP.name}.h5") == "repeated"
    assert found
    assert all(id_ == "killed" and name.startswith(f"{STEP.name}-unfinished-") for name, id_ in found.items())
    assert measured(tmp_path) == "repeated"


@pytest.mark.parametrize("left", [0, 10], ids=["empty", "torn"])
def test_a_journal_without_a_beginning_is_kept_and_stops_nobody(tmp_path: Path, info: RunInfo, left: int) -> None:
    journal = crash(tmp_path, info)
    content = journal.read_bytes()[:left]
    journal.write_bytes(content)
    assert measured(tmp_path) == "repeated"
    (kept,) = tmp_path.glob(f"{STEP.name}-unfinished-*{RECOVERED}")
    assert kept.read_bytes() == content


def test_a_step_that_another_program_measures_is_left_alone(tmp_path: Path, info: RunInfo) -> None:
    with JournalWriter(tmp_path / f"{STEP.name}.journal", info) as writer:
        with pytest.raises(JournalBusy, match="a run is being recorded"):
            measured(tmp_path)
        assert writer.path.exists()
    assert not list(tmp_path.glob("*.h5"))


def test_the_recovered_run_says_so(tmp_path: Path, info: RunInfo) -> None:
    crash(tmp_path, info)
    measured(tmp_path)
    (aside,) = tmp_path.glob("*-unfinished-*.h5")
    assert open_recording(aside).info.status == "recovered"
