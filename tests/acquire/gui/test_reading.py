"""The analyst's side of the window: what stays in the folder after a recovery."""

from __future__ import annotations

import math
import os
import shutil
import time
from pathlib import Path

import numpy as np
import pytest

from acquire.engine.recorder import Recorder
from acquire.gui.feed import Disk
from acquire.gui.reading import recovered
from acquire.recording import JournalWriter, RunInfo, open_recording
from acquire.recording.recovery import KEPT, RECOVERED
from drivers.signals import Frame


def crashed(path: Path, torn: int) -> Path:
    """A journal without an end, its last ``torn`` bytes missing."""
    writer = JournalWriter(path.with_suffix(".alive"), RunInfo(path.stem, "cutometer", "2026-01-01T12:00:00+00:00"))
    writer._repeat()
    path.write_bytes(writer.path.read_bytes()[: writer.size - torn])
    writer.close()
    writer.path.unlink()
    return path


@pytest.mark.parametrize("torn", [0, 9])
def test_a_journal_stays_only_where_bytes_of_it_are_damaged(tmp_path: Path, torn: int) -> None:
    path = recovered(crashed(tmp_path / "run.journal", torn))
    assert open_recording(path).info.status == "recovered"
    left = [p.name for p in tmp_path.glob("*journal*")]
    assert left == ([f"run{RECOVERED}"] if torn else [])


def test_damaged_journals_are_removed_in_the_end(tmp_path: Path) -> None:
    old = time.time() - (KEPT + 1) * 86400
    for name in ("with", "without"):
        recovered(crashed(tmp_path / f"{name}.journal", 9))
        os.utime(tmp_path / f"{name}{RECOVERED}", (old, old))
    (tmp_path / "without.h5").unlink()
    journal = crashed(tmp_path / "new.journal", 9)
    os.utime(journal, (old, old))  # the count begins with the recovery
    recovered(journal)
    assert sorted(p.name for p in tmp_path.glob(f"*{RECOVERED}")) == [f"new{RECOVERED}", f"without{RECOVERED}"]


def test_the_disk_lasts_by_what_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not by what arrives: a camera's pictures are kept in a third of their bytes."""
    clock = [100.0]
    monkeypatch.setattr("acquire.gui.feed.time.monotonic", lambda: clock[0])
    disk, free = Disk(), shutil.disk_usage(tmp_path).free
    assert math.isnan(disk.left(0, tmp_path))
    clock[0] += 2.0
    assert disk.left(2_000_000, tmp_path / "not" / "made") == pytest.approx(free / 1e6, rel=0.2)
    clock[0] += 2.0
    assert math.isnan(disk.left(2_000_000, tmp_path))
    recorder = Recorder(tmp_path / "run.h5", RunInfo("r", "aspiration", "2026-01-01T12:00:00+00:00"), (), print)
    before = recorder.written
    recorder.start()
    for number in range(20):
        recorder.put(Frame(np.full((480, 640), number, np.uint8), number, number / 25.0, 0.0))
    recorder.finish("completed", "").result(30)
    recorder.join()
    assert 0 < recorder.written - before < 20 * 480 * 640 / 10
