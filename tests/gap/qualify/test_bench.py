"""Measuring the standard set: whatever an earlier attempt left, the same command repeats the step and loses nothing."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from acquire.catalogue import catalogue
from acquire.engine import State
from acquire.recording import JournalBusy, JournalWriter, open_recording, recover, write_recording
from acquire.recording.recovery import RECOVERED
from gap.qualify import bench
from gap.qualify.steps import STANDARD
from tests.acquire.recording.samples import sample_recording

STEP = STANDARD["cutometer"][0]
SAMPLE = sample_recording(100, frames=0)
INFO = replace(SAMPLE.info, specimen=STEP.specimen, specimen_properties=STEP.known)


class Instrument:
    """Takes the place of a session: its runs come to their end."""

    def run(self, protocol: str, request: object, *, out: Path, **_: object) -> SimpleNamespace:
        assert not out.with_suffix(".journal").exists()
        write_recording(replace(SAMPLE, info=replace(INFO, id="repeated", status="completed")), out)
        return SimpleNamespace(status=State.COMPLETED, reason="")


def measured(folder: Path) -> str:
    """Id of the recording of the one step."""
    (recording,) = bench.measure(Instrument(), "cutometer", [STEP], folder, lambda number, step: None)  # type: ignore[arg-type]
    return recording.info.id


def crash(folder: Path) -> Path:
    """The journal that a killed run of the step leaves."""
    writer = JournalWriter(folder / f"{STEP.name}.journal", replace(INFO, id="killed"))
    writer._repeat()
    os.close(writer.descriptor)
    return writer.path


@pytest.mark.parametrize("recovered", [False, True], ids=["journal", "recovered by hand"])
def test_a_killed_step_is_repeated_and_kept(tmp_path: Path, recovered: bool) -> None:
    journal = crash(tmp_path)
    if recovered:
        recover(journal)  # and the journal is there still
    assert measured(tmp_path) == "repeated"
    found = {entry.path.name: entry.info.id if entry.info else entry.problem for entry in catalogue(tmp_path)}
    assert found.pop(f"{STEP.name}.h5") == "repeated"
    assert found
    assert all(id_ == "killed" and name.startswith(f"{STEP.name}-unfinished-") for name, id_ in found.items())
    assert measured(tmp_path) == "repeated"


@pytest.mark.parametrize("left", [0, 10], ids=["empty", "torn"])
def test_a_journal_without_a_beginning_is_kept_and_stops_nobody(tmp_path: Path, left: int) -> None:
    journal = crash(tmp_path)
    content = journal.read_bytes()[:left]
    journal.write_bytes(content)
    assert measured(tmp_path) == "repeated"
    (kept,) = tmp_path.glob(f"{STEP.name}-unfinished-*{RECOVERED}")
    assert kept.read_bytes() == content


def test_a_step_that_another_program_measures_is_left_alone(tmp_path: Path) -> None:
    with JournalWriter(tmp_path / f"{STEP.name}.journal", INFO) as writer:
        with pytest.raises(JournalBusy, match="a run is being recorded"):
            measured(tmp_path)
        assert writer.path.exists()
    assert not list(tmp_path.glob("*.h5"))


def test_the_recovered_run_says_so(tmp_path: Path) -> None:
    crash(tmp_path)
    measured(tmp_path)
    (aside,) = tmp_path.glob("*-unfinished-*.h5")
    assert open_recording(aside).info.status == "recovered"
