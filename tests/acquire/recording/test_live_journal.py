"""A journal belongs to the run that writes it: nobody recovers, lists or removes it as if it were left over."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from acquire.catalogue import catalogue
from acquire.cli.app import run
from acquire.engine.recorder import Recorder
from acquire.recording import (
    JournalBusy,
    JournalWriter,
    RecordingError,
    RunInfo,
    finalise,
    open_recording,
    recover,
    settle,
    write_recording,
)
from acquire.recording.lock import is_live
from acquire.recording.recovery import RECOVERED
from drivers.signals import Block

INFO = RunInfo("a-run", "cutometer", "2026-01-01T12:00:00+00:00", subject="P07")


def block(first: int, count: int = 100) -> Block:
    seq = np.arange(first, first + count)
    return Block({"pressure": seq * 1.0}, seq, seq / 100.0, seq / 100.0)


def test_a_running_run_is_not_recovered(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    journal = tmp_path / "run.journal"
    writer = JournalWriter(journal, INFO)
    writer.block(block(0))
    assert run(["recover", str(journal)]) == 2
    assert "is in use: a run is being recorded into it" in capsys.readouterr().err
    with pytest.raises(JournalBusy):
        recover(journal)
    assert not journal.with_suffix(".h5").exists()
    assert run(["ls", "-d", str(tmp_path)]) == 0
    listed = capsys.readouterr().out
    assert "being recorded" in listed
    assert "recover" not in listed
    writer.block(block(100))
    path = finalise(writer, tmp_path / "run.h5")
    assert len(open_recording(path).stream("pressure").value) == 200
    assert not journal.exists()


def test_what_a_kill_left_is_free(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    writer = JournalWriter(tmp_path / "run.journal", INFO)
    writer.block(block(0))
    os.close(writer.descriptor)  # what the system does for a killed process
    assert not is_live(writer.path)
    (entry,) = catalogue(tmp_path)
    assert not entry.live
    assert f"acquire recover {writer.path}" in entry.problem
    assert run(["recover", str(writer.path)]) == 0
    assert open_recording(tmp_path / "run.h5").info.status == "recovered"
    capsys.readouterr()
    assert run(["ls", "-d", str(tmp_path)]) == 0
    assert "journal" not in capsys.readouterr().out
    assert not writer.path.exists()


def test_an_incomplete_recording_costs_no_journal(tmp_path: Path) -> None:
    """The file at the recording's place holds a part of the run: both stay, and the run gets a file of its own."""
    writer = JournalWriter(tmp_path / "run.journal", INFO)
    writer.block(block(0))
    part = tmp_path / "run.h5"
    copy = tmp_path / "copy.journal"
    copy.write_bytes(writer.path.read_bytes())
    recover(copy, part)
    before = part.read_bytes()
    writer.block(block(100))
    path = finalise(writer, part)
    assert path == tmp_path / "run-2.h5"
    assert part.read_bytes() == before
    assert len(open_recording(path).stream("pressure").value) == 200


def test_recovery_refuses_a_file_that_holds_less(tmp_path: Path) -> None:
    journal = tmp_path / "run.journal"
    with JournalWriter(journal, INFO) as writer:
        writer.block(block(0))
        writer.block(block(100))
    whole = open_recording(recover(journal, tmp_path / "whole.h5"))
    short = {name: replace(s, value=s.value[:9], time=s.time[:9], seq=None, time_host=None) for name, s in
             whole.streams.items()}  # fmt: skip
    write_recording(replace(whole, streams=short), tmp_path / "short.h5")
    with pytest.raises(RecordingError, match=r"short\.h5: does not hold all of the journal \(streams: pressure"):
        recover(journal, tmp_path / "short.h5", keep=False)
    damaged = bytearray((tmp_path / "whole.h5").read_bytes())
    damaged[damaged.index(np.arange(200.0).tobytes()) + 1] ^= 0xFF
    (tmp_path / "damaged.h5").write_bytes(damaged)
    with pytest.raises(RecordingError, match=r"damaged\.h5"):
        settle(journal, tmp_path / "damaged.h5")
    assert journal.exists()
    assert recover(journal, tmp_path / "whole.h5", keep=False)
    assert not journal.exists()


def test_a_damaged_journal_stays(tmp_path: Path) -> None:
    journal = tmp_path / "run.journal"
    with JournalWriter(journal, INFO) as writer:
        writer.block(block(0))
        middle = writer.size + 200
        writer.block(block(100))
        writer.block(block(200))
    content = bytearray(journal.read_bytes())
    content[middle] ^= 0xFF
    journal.write_bytes(content)
    recording = open_recording(recover(journal, keep=False))
    assert len(recording.stream("pressure").value) == 200
    assert "journal_damage" in {event.code for event in recording.events}
    assert journal.exists()
    kept = tmp_path / f"run{RECOVERED}"
    kept.write_bytes(b"of an earlier run")
    assert run(["recover", str(journal)]) == 0
    assert not journal.exists()
    assert (tmp_path / f"run-2{RECOVERED}").read_bytes() == content
    assert kept.read_bytes() == b"of an earlier run"
    assert [entry.path.name for entry in catalogue(tmp_path)] == ["run.h5"]


def test_subjects_are_private(tmp_path: Path) -> None:
    writer = JournalWriter(tmp_path / "run.journal", INFO)
    assert writer.path.stat().st_mode & 0o777 == 0o600
    path = finalise(writer, tmp_path / "run.h5")
    assert path.stat().st_mode & 0o777 == 0o600


def test_one_damaged_record_does_not_cost_the_others(tmp_path: Path) -> None:
    """Identity and layouts are there more than once."""
    journal = tmp_path / "run.journal"
    with JournalWriter(journal, INFO) as writer:
        first = writer.size
        writer.block(block(0))
        writer.block(block(100))
    content = bytearray(journal.read_bytes())
    layout = content.index(b'"layout"')
    for position in (first // 2, layout):
        content[position] ^= 0xFF
    journal.write_bytes(content)
    recording = open_recording(recover(journal))
    assert recording.info.subject == "P07"
    assert np.array_equal(recording.stream("pressure").value, np.arange(200))
    assert "journal_damage" in {event.code for event in recording.events}


def test_two_programs_on_one_target(tmp_path: Path) -> None:
    first = Recorder(tmp_path / "run.h5", INFO, (), print)
    with pytest.raises(FileExistsError, match=r"run\.journal: exists already; another run is being recorded there"):
        Recorder(tmp_path / "run.h5", INFO, (), print)
    os.close(first._writer.descriptor)  # the first one is killed
    with pytest.raises(FileExistsError, match=r"left by a crash: acquire recover .*run\.journal"):
        Recorder(tmp_path / "run.h5", INFO, (), print)
