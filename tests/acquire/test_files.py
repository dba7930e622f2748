"""No half file under a final name, whatever the disk does."""

from __future__ import annotations

import os
import resource
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from acquire.cli.app import run
from acquire.files import CannotWrite, whole_file, whole_folder, write_text
from acquire.recording import JournalWriter, RunInfo, write_recording
from drivers.signals import Block, Channel
from tests.acquire.recording.samples import sample_recording


@contextmanager
def full(limit: int = 40_000) -> Iterator[None]:
    """No file may grow beyond ``limit`` bytes: the system refuses as it does on a full disk, also under HDF5."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.fixture
def journal(tmp_path: Path) -> Path:
    path = tmp_path / "run.journal"
    noise = np.random.default_rng(0)
    with JournalWriter(path, RunInfo("run", "cutometer", ""), [Channel("pressure", "Pa", "actuator")]) as writer:
        for number in range(100):
            seq = np.arange(100 * number, 100 * number + 100)
            writer.block(Block({"pressure": noise.normal(size=100)}, seq, seq / 1e3, seq / 1e3))
    return path


@pytest.mark.parametrize(
    "command",
    [
        ["recover", "run.journal"],
        ["export", "run.journal", "-o", "out.csv"],
        ["export", "run.journal", "-o", "out.mat"],
        ["export", "run.journal", "-o", "out"],
        ["report", "run.journal", "-o", "out.html"],
        ["show", "run.journal", "--png", "out.png"],
        ["show", "run.journal", "--png", "out.pdf"],
    ],
    ids=lambda command: " ".join((command[0], command[-1])),
)
def test_a_full_disk_leaves_no_half_file(
    command: list[str], journal: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(journal.parent)
    run(["show", "run.journal"])  # what is made once in a process (fonts, caches) is made before
    with full(4096):
        assert run(command) == 2
    said = capsys.readouterr().err
    assert "cannot be written: File too large" in said
    assert "Traceback" not in said
    assert [path.name for path in journal.parent.iterdir()] == ["run.journal"]
    assert run(command) == 0


def test_what_is_there_survives_a_failure(tmp_path: Path) -> None:
    path = write_recording(sample_recording(50, frames=0), tmp_path / "run.h5")
    before = path.read_bytes()
    with full(), pytest.raises(CannotWrite, match=r"run\.h5: cannot be written: "):
        write_recording(sample_recording(20_000, frames=0), path, overwrite=True)
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == ["run.h5"]


def test_a_link_in_the_target_s_place_is_not_followed(tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    victim.write_text("precious")
    for name in ("run.h5.partial", "page.html", "run.h5"):
        (tmp_path / name).symlink_to(victim)
    write_text(tmp_path / "page.html", "<p>")
    write_recording(sample_recording(50, frames=0), tmp_path / "run.h5", overwrite=True)
    assert victim.read_text() == "precious"
    assert not (tmp_path / "page.html").is_symlink()
    assert not (tmp_path / "run.h5").is_symlink()
    assert (tmp_path / "run.h5.partial").is_symlink()
    (tmp_path / "run.journal").symlink_to(tmp_path / "nowhere")
    with pytest.raises(FileExistsError):
        JournalWriter(tmp_path / "run.journal", RunInfo("r", "x", ""))


def test_a_name_that_was_taken_meanwhile(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"

    def write() -> None:
        with whole_file(path, overwrite=False) as file:
            path.write_text("another program's")
            file.write(b"ours")

    with pytest.raises(FileExistsError, match="not overwritten"):
        write()
    assert path.read_text() == "another program's"
    assert os.listdir(tmp_path) == ["a.csv"]


def test_a_swapped_partial_file_is_not_renamed(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"

    def write() -> None:
        with whole_file(path) as file:
            os.remove(file.name)
            Path(file.name).write_text("not ours")

    with pytest.raises(CannotWrite, match="another program replaced"):
        write()
    assert os.listdir(tmp_path) == []


def test_folders_are_whole_too(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with whole_folder(tmp_path / "empty") as folder:
        (folder / "a").write_text("a")
    assert (tmp_path / "empty" / "a").read_text() == "a"
    with pytest.raises(CannotWrite, match="is not empty"), whole_folder(tmp_path / "empty"):
        pass

    def fail() -> None:
        with whole_folder(tmp_path / "new") as folder:
            (folder / "a").write_text("a")
            raise KeyError

    with pytest.raises(KeyError):
        fail()
    (tmp_path / "link").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(CannotWrite), whole_folder(tmp_path / "link"):
        pass
    assert sorted(os.listdir(tmp_path)) == ["empty", "link"]


def test_a_folder_that_is_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write_recording(sample_recording(50, frames=0), tmp_path / "run.h5")
    assert run(["export", str(path), "-o", str(path / "a.csv")]) == 2
    assert "cannot be written: Not a directory" in capsys.readouterr().err


def test_no_text_and_no_picture_takes_the_place_of_a_recording(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A report with the name of a recording was written over it, without a word."""
    recording, journal = tmp_path / "a.h5", tmp_path / "a.journal"
    write_recording(sample_recording(50, frames=0), recording)
    journal.write_bytes(b"samples")
    kept = recording.read_bytes()
    assert run(["report", str(recording), "-o", str(recording)]) == 2
    assert "a.h5: is a recording; it is not overwritten" in capsys.readouterr().err
    with pytest.raises(CannotWrite, match="is a recording"):
        write_text(journal, "{}")
    assert recording.read_bytes() == kept
    assert journal.read_bytes() == b"samples"
