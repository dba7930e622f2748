"""The analyst's side of the window: what stays in the folder after a recovery."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from acquire.gui.reading import KEPT, RECOVERED, recovered
from acquire.recording import JournalWriter, RunInfo, open_recording


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
