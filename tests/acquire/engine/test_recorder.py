"""The recorder: no run ends as done without its recording, whatever happens to the disk."""

from __future__ import annotations

import errno
import os
import shutil
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from acquire.cli.app import run
from acquire.engine import RunEngine, RunPlan, State
from acquire.files import CannotWrite
from acquire.recording import JournalWriter, RecordingError, RunInfo, open_recording
from protocols.setpoints import Setpoints
from tests.acquire.engine.helpers import LIMITS, LONG, SHORT, eventually, running

Plan = Callable[..., RunPlan]


def whole(path: Path) -> bool:
    """Whether the recording's samples follow each other without a gap."""
    return bool(np.all(np.diff(open_recording(path).stream("pressure").seq) == 1))  # type: ignore[arg-type]


def test_a_deleted_journal_trips_and_the_run_is_saved(engine: RunEngine, plan: Plan) -> None:
    planned = plan(LONG)
    running(engine, planned)
    planned.path.with_suffix(".journal").unlink()
    outcome = engine.wait(10.0)
    assert (outcome.status, outcome.recording) == (State.TRIPPED, planned.path)
    assert "journal is gone" in outcome.reason
    assert whole(planned.path)


def test_a_deleted_folder_is_made_anew(engine: RunEngine, plan: Plan, tmp_path: Path) -> None:
    planned = plan(LONG)
    running(engine, planned)
    shutil.rmtree(tmp_path)
    outcome = engine.wait(10.0)
    assert outcome.status is State.TRIPPED
    assert outcome.recording is not None
    assert whole(outcome.recording)


def test_a_disk_that_was_taken_away(
    engine: RunEngine, plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shelter = tmp_path / "shelter"
    monkeypatch.setattr("acquire.engine.recorder._shelters", lambda: (tmp_path / "no" / "folder", shelter))
    monkeypatch.setattr("acquire.recording.journal.JournalWriter.same_disk", lambda writer: False)
    (tmp_path / "no").write_text("not a folder")
    planned = plan(LONG)
    running(engine, planned)
    planned.path.with_suffix(".journal").rename(tmp_path / "elsewhere")
    outcome = engine.wait(10.0)
    assert (outcome.status, outcome.recording) == (State.TRIPPED, shelter / planned.path.name)
    assert whole(shelter / planned.path.name)


def test_what_is_left_of_a_disk_that_was_taken_away_is_another_one(tmp_path: Path) -> None:
    """Its folders are not made anew on the disk below, where nobody would find them once it is back."""
    folder = tmp_path / "disk" / "out"
    with JournalWriter(folder / "run.journal", RunInfo("run", "fake", "2024-01-01T00:00:00+00:00")) as writer:
        shutil.rmtree(tmp_path / "disk")
        assert writer.same_disk()
        writer._disk += 1  # as its own device number was while it was there
        assert not writer.same_disk()


def test_a_run_without_a_recording_has_not_completed(
    engine: RunEngine, plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*args: object, **more: object) -> None:
        raise CannotWrite("run.h5: cannot be written: No space left on device")

    monkeypatch.setattr("acquire.engine.recorder.finalise", refuse)
    planned = plan(SHORT)
    engine.connect()
    engine.arm(planned)
    engine.start()
    outcome = engine.wait(20.0)
    assert (outcome.status, outcome.recording) == (State.FAILED, None)
    assert outcome.journal == planned.path.with_suffix(".journal")
    assert outcome.journal.exists()
    assert "No space left" in outcome.reason


def test_a_slow_disk_loses_nothing(engine: RunEngine, plan: Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each write to the disk stands still for a second now and then."""
    sync, stalls = os.fdatasync, iter([0.0, 1.0, 0.0, 1.0])

    def stall(file: int) -> None:
        time.sleep(next(stalls, 0.0))
        sync(file)

    monkeypatch.setattr(os, "fdatasync", stall)
    planned = plan(Setpoints((*SHORT.segments, *SHORT.segments)))
    engine.connect()
    engine.arm(planned)
    engine.start()
    outcome = engine.wait(20.0)
    assert (outcome.status, outcome.lost) == (State.COMPLETED, 0)
    assert whole(planned.path)


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("operator", "k\udce9", "operator: is not UTF-8"),
        ("subject", "P\x007", "subject: has a control character"),
        ("site", "a\nb", "site: must be one line"),
        ("specimen", "x" * 500, "specimen: "),
        ("repeat", 2**63, "repeat: "),
        ("repeat", -1, "repeat: "),
        ("id", "", "id: "),
    ],
)
def test_what_cannot_be_recorded_is_refused_before_anybody_is_touched(
    field: str, value: object, words: str, tmp_path: Path
) -> None:
    info = {"id": "run", "instrument": "fake", "start_time": "2024-01-01T00:00:00+00:00", field: value}
    with pytest.raises(RecordingError, match=words):
        RunPlan(SHORT, LIMITS, RunInfo(**info), tmp_path / "run.h5")  # type: ignore[arg-type]


def test_what_only_the_file_format_refuses_is_refused_too(engine: RunEngine, plan: Plan, tmp_path: Path) -> None:
    """A rehearsal in memory: a name that HDF5 takes for a path, for one."""
    info = RunInfo("run", "fake", "2024-01-01T00:00:00+00:00", calibration={"a/b": {"value": 1.0, "unit": "m"}})
    engine.connect()
    with pytest.raises(RecordingError, match="could not be recorded"):
        engine.arm(RunPlan(SHORT, LIMITS, info, tmp_path / "run.h5"))
    assert not list(tmp_path.iterdir())
    assert "arm" not in engine.rig.device.calls  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--operator", "k\udce9"], "operator"),
        (["--repeat", str(2**63)], "repeat"),
        (["--repeat", "1000001"], "repeat"),
    ],
)
def test_the_command_line_refuses_them(
    options: list[str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["run", "demo-cutometer", "--sim", "--speed", "50", *options, "-o", str(tmp_path / "out")]) == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("now", [0.0, 1e18, 4.2e9])
def test_a_wild_clock_is_refused(
    now: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("acquire.recording.journal.time.time", lambda: now)
    assert run(["run", "demo-cutometer", "--sim", "--speed", "50", "-o", str(tmp_path / "out")]) == 2
    assert "clock says" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_clock_that_is_set_during_a_run_does_not_end_it_before_its_start(
    engine: RunEngine, plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    planned = plan(SHORT)
    engine.connect()
    engine.arm(planned)
    before = time.time()
    monkeypatch.setattr("acquire.recording.journal.time.time", lambda: 1e18)
    engine.start()
    assert engine.wait(20.0).status is State.COMPLETED
    monkeypatch.undo()
    end = open_recording(planned.path).info.end_time
    assert end[:4] == time.strftime("%Y", time.gmtime(before))


def test_a_clock_that_is_set_back_before_arming_neither(engine: RunEngine, plan: Plan) -> None:
    planned = plan(SHORT)
    later = time.strftime("%Y-%m-%dT%H:%M:%S+00:00", time.gmtime(time.time() + 86400))
    engine.connect()
    engine.arm(replace(planned, info=replace(planned.info, start_time=later)))
    engine.start()
    assert engine.wait(20.0).status is State.COMPLETED
    info = open_recording(planned.path).info
    assert info.end_time > info.start_time


def test_a_disk_that_refuses_the_journal(engine: RunEngine, plan: Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    engine.connect()
    real = os.open

    def refuse(path: object, flags: int, mode: int = 0o777, **more: int) -> int:
        if str(path).endswith(".journal"):
            raise OSError(errno.EROFS, os.strerror(errno.EROFS))
        return real(path, flags, mode, **more)  # type: ignore[call-overload, no-any-return]

    monkeypatch.setattr(os, "open", refuse)
    with pytest.raises(CannotWrite, match=r"run\.journal: cannot be written: Read-only file system"):
        engine.arm(plan(SHORT))
    eventually(lambda: engine.state is State.READY)
