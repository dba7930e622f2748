"""Frames go into the recording's file while the run goes on; whatever happens to that file, the recording is whole."""

from __future__ import annotations

import errno
import os
import zlib
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from acquire.engine.recorder import Recorder
from acquire.recording import RunInfo, open_recording, recovery
from acquire.recording.draft import Draft
from acquire.recording.lazy import Packed
from drivers.signals import Frame

INFO = RunInfo("r", "aspiration", "2026-01-01T12:00:00+00:00")
COUNT = 600  # more than the dataset grows by


def picture(number: int) -> np.ndarray:
    """A picture that nobody takes for another; noise, which cannot be compressed, now and then."""
    random = np.random.default_rng(number)
    return random.integers(0, 256 if number % 50 == 0 else 4, (16, 20), dtype=np.uint8)


@pytest.fixture(autouse=True)
def nameless(tmp_path: Path) -> None:
    try:
        Draft(tmp_path).close()
    except OSError as error:
        pytest.skip(f"no nameless files here: {error}")


def recorded(
    path: Path, during: Callable[[Recorder], None] = lambda recorder: None, order: list[int] | None = None
) -> Path:
    """The recording of a run of `COUNT` frames; ``during`` is called in its midst."""
    failures: list[str] = []
    recorder = Recorder(path, INFO, (), failures.append)
    recorder.start()
    for place, number in enumerate(order or range(COUNT)):
        recorder.put(Frame(picture(number), number, number / 25.0, 0.0))
        if place == COUNT // 2:
            during(recorder)
    found = recorder.finish("completed", "").result(60)
    recorder.join()
    assert not failures
    return found


def check(path: Path) -> None:
    """Every frame is there, and nothing else in the folder."""
    frames = open_recording(path).frames
    assert frames is not None
    assert np.array_equal(np.asarray(frames.data), [picture(number) for number in range(COUNT)])
    assert [p.name for p in path.parent.iterdir()] == [path.name]
    assert path.stat().st_mode & 0o777 == 0o600


def test_after_the_run_no_frame_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*given: object) -> None:
        raise AssertionError("written as a whole")

    monkeypatch.setattr(recovery, "write_recording", refuse)
    path = recorded(tmp_path / "run.h5")
    check(path)
    with h5py.File(path) as file:  # without anything of ours
        assert list(file) == ["entry"]
        data = file["entry/frames/data"]
        assert np.array_equal(data[COUNT - 1], picture(COUNT - 1))
        assert file["entry/frames/crc"][7] == zlib.crc32(picture(7).tobytes())


@pytest.mark.parametrize("place", ["begin", "run", "end"])
def test_a_draft_that_fails_costs_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: str) -> None:
    full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def fail(*given: object) -> None:
        raise full

    def during(recorder: Recorder) -> None:
        if place == "run":
            monkeypatch.setattr(Draft, "add", fail)

    if place != "run":
        monkeypatch.setattr(Draft, "__init__" if place == "begin" else "frames", fail)
    check(recorded(tmp_path / "run.h5", during))


def test_frames_out_of_order_are_written_in_order(tmp_path: Path) -> None:
    order = list(range(COUNT))
    order[10], order[11] = order[11], order[10]
    check(recorded(tmp_path / "run.h5", order=order))


def test_a_draft_that_differs_from_the_journal_is_not_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    add = Draft.add

    def otherwise(draft: Draft, shape: tuple[int, ...], frame: Packed) -> None:
        add(draft, shape, Packed(zlib.compress(bytes(320)), frame.crc, True) if len(draft) == 3 else frame)

    monkeypatch.setattr(Draft, "add", otherwise)
    check(recorded(tmp_path / "run.h5"))


def test_a_name_that_was_taken_meanwhile_stays(tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    found = recorded(path, lambda recorder: path.write_text("somebody else's") and None)
    assert found.name == "run-2.h5"
    assert path.read_text() == "somebody else's"
