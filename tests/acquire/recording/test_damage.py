"""Journal or recording damaged at any byte: what is sound is found, what is not is named, nothing crashes."""

from __future__ import annotations

import json
import os
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acquire.cli.app import run
from acquire.recording import (
    JournalWriter,
    Recording,
    RecordingError,
    faults,
    load,
    open_recording,
    read_journal,
    salvage,
    write_recording,
)
from acquire.recording.model import difference
from drivers.signals import Block, Frame
from tests.acquire.recording.samples import sample_recording

flips = st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(1, 255)), min_size=1, max_size=4)


def damaged(content: bytes, changes: list[tuple[float, int]]) -> bytes:
    new = bytearray(content)
    for place, bits in changes:
        new[int(place * len(new))] ^= bits
    return bytes(new)


def frames_read(recording: Recording) -> None:
    for image in recording.frames.data if recording.frames is not None else ():
        assert image.shape


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_recording(sample_recording(1500), tmp_path_factory.mktemp("damage") / "run.h5")


@settings(max_examples=60, deadline=None)
@given(changes=flips)
def test_a_recording(original: Path, changes: list[tuple[float, int]]) -> None:
    path = original.with_name("damaged.h5")
    path.write_bytes(damaged(original.read_bytes(), changes))
    refused = ""
    try:
        read = open_recording(path)
        frames_read(read)
    except RecordingError as error:
        refused = str(error)
    if refused:
        assert str(path) in refused
    else:
        told = any(event.code == "checksum" for event in read.events)
        assert told or difference(sample_recording(1500), read) == ""
    try:
        rest = salvage(path)
    except RecordingError:
        return
    for name, series in rest.streams.items():
        assert np.array_equal(series.value, sample_recording(1500).streams[name].value)


@settings(max_examples=60, deadline=None)
@given(changes=flips)
def test_a_journal(tmp_path_factory: pytest.TempPathFactory, changes: list[tuple[float, int]]) -> None:
    path = tmp_path_factory.mktemp("journal") / "run.journal"
    with JournalWriter(path, sample_recording().info) as writer:
        for number in range(30):
            seq = np.arange(20 * number, 20 * number + 20)
            writer.block(Block({"a": seq * 1.0}, seq, seq / 100.0, seq / 100.0))
            writer.frame(Frame(np.full((12, 16), number, np.uint8), number, number / 5.0, 0.0))
    content = path.read_bytes()
    path.write_bytes(damaged(content, changes))
    # The identity is there twice: a single change cannot cost the journal.
    try:
        found = read_journal(path)
    except RecordingError:
        if len(changes) == 1:
            raise
        return
    if path.read_bytes() != content:
        assert "journal_damage" in {event.code for event in found.events}
    stream = found.streams.get("a")
    if stream is not None:
        assert np.array_equal(stream.value, stream.seq)
        assert len(stream.value) >= 20 * (30 - 2 * len(changes))
    for image, number in zip(found.frames.data, found.frames.seq, strict=True) if found.frames else ():
        assert np.all(image == number)


def spoil(path: Path, name: str) -> None:
    """Change one value of a dataset as a bad sector would: behind the back of HDF5."""
    with h5py.File(path, "r") as file:
        offset = file[name].id.get_offset() or file[name].id.get_chunk_info(0).byte_offset
    content = bytearray(path.read_bytes())
    content[offset + 3] ^= 0x40
    path.write_bytes(content)


def test_a_damaged_stream_is_named_and_the_others_are_saved(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recording = sample_recording(900)
    path = write_recording(recording, tmp_path / "run.h5")
    assert faults(path) == []
    assert run(["show", "--verify", str(path)]) == 0
    assert "sound" in capsys.readouterr().out
    spoil(path, "entry/streams/apex_height/value")
    spoil(path, "entry/frames/data")
    assert run(["show", str(path)]) == 2
    assert "/entry/streams/apex_height/value is damaged" in capsys.readouterr().err
    assert run(["show", "--verify", "--json", str(path)]) == 2
    told = json.loads(capsys.readouterr().out)
    assert not told["sound"]
    assert [("apex_height" in text, "frame 0" in text) for text in told["faults"]] == [(True, False), (False, True)]
    assert list(salvage(path).streams) == ["pressure"]


def test_salvage_makes_a_file_of_what_is_sound(tmp_path: Path) -> None:
    path = write_recording(sample_recording(900, frames=0), tmp_path / "run.h5")
    before = path.read_bytes()
    spoil(path, "entry/streams/apex_height/value")
    assert run(["recover", str(path)]) == 0
    saved = load(tmp_path / "run-salvaged.h5")
    assert list(saved.streams) == ["pressure"]
    (told,) = (event.text for event in saved.events if event.code == "damage")
    assert "/entry/streams/apex_height/value is damaged" in told
    assert len(path.read_bytes()) == len(before)


def test_a_disk_that_cannot_read_costs_what_lies_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "run.journal"
    with JournalWriter(path, sample_recording().info) as writer:
        for number in range(100):
            seq = np.arange(20 * number, 20 * number + 20)
            writer.block(Block({"a": seq * 1.0}, seq, seq / 100.0, seq / 100.0))
    bad, real = 5 * 4096 + 100, os.read

    def read(file: int, length: int) -> bytes:
        start = os.lseek(file, 0, os.SEEK_CUR)
        if start <= bad < start + length:
            raise OSError(5, "Input/output error")
        return real(file, length)

    monkeypatch.setattr(os, "read", read)
    found = read_journal(path)
    assert 2000 - 20 * 10 < len(found.stream("a").value) < 2000
    assert any("Input/output error" in event.text for event in found.events)
