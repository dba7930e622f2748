"""Recordings named on the command line."""

from __future__ import annotations

from pathlib import Path

import pytest

from acquire.cli.app import run
from acquire.cli.inputs import found


def test_what_is_named_twice_counts_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A recording and itself were taken for a session with a repeat."""
    for name in ("b.h5", "a.h5", "c/d.h5"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    monkeypatch.chdir(tmp_path)
    a, b, d = Path("a.h5"), Path("b.h5"), Path("c/d.h5")
    assert found([b, a, b]) == [b, a]
    assert found([Path("c"), a, tmp_path / "c" / "d.h5"]) == [d, a]
    Path("empty").mkdir()
    with pytest.raises(FileNotFoundError, match="empty: no recording"):
        found([Path("empty")])


def test_a_folder_that_is_not_there_is_no_word_to_look_for(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["ls", "/nonexistent/folder"]) == 2
    assert "there is no folder /nonexistent/folder" in capsys.readouterr().err
