"""Frames are compressed without loss while the run goes on, and every reader of HDF5 can unpack them."""

from __future__ import annotations

import zlib
from pathlib import Path

import h5py
import numpy as np
import pytest

from acquire.recording import JournalWriter, RecordingError, RunInfo, finalise, open_recording, read_journal
from acquire.recording.lazy import pack, unpack
from drivers.signals import Frame

INFO = RunInfo("r", "aspiration", "2026-01-01T12:00:00+00:00")


def picture(number: int) -> np.ndarray:
    """A soft gradient with a little noise, as a camera sees it."""
    noise = np.random.default_rng(number).normal(0, 2, (48, 64))
    return np.clip(120 + 0.5 * np.arange(64) + noise, 0, 255).astype(np.uint8)


def test_a_run_s_frames_come_back_bit_by_bit(tmp_path: Path) -> None:
    writer = JournalWriter(tmp_path / "run.journal", INFO)
    before = writer.size
    for number in range(20):
        # Now and then the recorder has no time to compress; noise cannot be compressed at all.
        writer.frame(Frame(picture(number), number, number / 25.0, 0.0), quickly=number == 7)
    assert writer.size - before < 0.8 * 20 * 48 * 64
    read = read_journal(writer.path).frames
    assert read is not None
    assert np.array_equal(np.asarray(read.data), [picture(number) for number in range(20)])
    path = finalise(writer, tmp_path / "run.h5")
    found = open_recording(path).frames
    assert found is not None
    assert np.array_equal(np.asarray(found.data), [picture(number) for number in range(20)])
    with h5py.File(path) as file:  # without anything of ours
        data = file["entry/frames/data"]
        assert data.compression == "gzip"
        assert np.array_equal(data[7], picture(7))
        assert np.array_equal(data[19], picture(19))
        assert [data.id.read_direct_chunk((k, 0, 0))[0] for k in (6, 7)] == [0, 1]


def test_frames_of_an_earlier_version_are_read(tmp_path: Path) -> None:
    """Neither journal nor recording had them compressed."""
    writer = JournalWriter(tmp_path / "run.journal", INFO)
    for number in range(3):
        writer.frame(Frame(picture(number), number, number / 25.0, 0.0), quickly=True)
    path = finalise(writer, tmp_path / "run.h5")
    with h5py.File(path, "r+") as file:
        group = file["entry/frames"]
        pixels = group["data"][()]
        del group["data"]
        group.create_dataset("data", data=pixels, chunks=(1, 48, 64))
    found = open_recording(path).frames
    assert found is not None
    assert np.array_equal(np.asarray(found.data), pixels)


def test_noise_is_stored_as_it_is() -> None:
    noise = np.random.default_rng(0).integers(0, 256, (48, 64), dtype=np.uint8)
    stored = pack(noise)
    assert not stored.packed
    assert stored.content == noise.tobytes()


def test_a_stream_that_holds_another_size_is_refused() -> None:
    assert unpack(zlib.compress(b"abcd"), 4) == b"abcd"
    for content, size in ((zlib.compress(b"abcd"), 3), (zlib.compress(b"abcd"), 5), (b"no stream", 4), (b"", 4)):
        with pytest.raises(ValueError, match=r"\w"):
            unpack(content, size)


def test_a_chunk_that_reads_back_otherwise_is_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    writer = JournalWriter(tmp_path / "run.journal", INFO)
    writer.frame(Frame(picture(0), 0, 0.0, 0.0))
    answers = iter([pack(picture(0)), pack(picture(1))])  # one is written, the other expected
    monkeypatch.setattr("acquire.recording.journal_reader.JournalFrames.stored", lambda frames, index: next(answers))
    with pytest.raises(RecordingError, match="does not read back: frame 0 differs"):
        finalise(writer, tmp_path / "run.h5")
    assert [path.name for path in tmp_path.iterdir()] == ["run.journal"]
    writer.close()
