"""The journal: what is written is found again, whatever moment the process, the disk or the file comes to grief."""

from __future__ import annotations

import contextlib
import errno
import multiprocessing
import os
import random
import signal
import time
from collections.abc import Callable
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acquire.recording import (
    Event,
    JournalFull,
    JournalWriter,
    Recording,
    RecordingError,
    finalise,
    open_recording,
    read_journal,
    recover,
)
from acquire.recording.journal import MAGIC
from acquire.recording.model import difference
from drivers.signals import Block, Channel, Frame
from protocols.setpoints import Segment, Setpoints
from tests.acquire.recording import journal_child
from tests.acquire.recording.samples import sample_recording

CHANNELS = (
    Channel("pressure", "Pa", "actuator", (-5e4, 0.0), 100.0),
    Channel("apex_height", "m", "sensor", (0.0, 4e-3), 1e-5),
)
STEP = Setpoints(
    (
        Segment(0.0, {"pressure": 0.0}, {"pressure": -3e4}),
        Segment(15.0, {"pressure": -3e4}, {"pressure": -3e4}),
        Segment(0.0, {"pressure": -3e4}, {"pressure": 0.0}),
    )
)


def write(path: Path, recording: Recording, *, close: bool = True, block: int = 100) -> None:
    """Write ``recording`` as an engine would: blocks and frames and events, one after the other."""
    writer = JournalWriter(path, replace(recording.info, end_time="", status=""), CHANNELS)
    writer.setpoints(STEP)
    first = next(iter(recording.streams.values()))
    assert first.seq is not None
    assert first.time_host is not None
    for event in recording.events:
        writer.event(event)
    for start in range(0, len(first.time), block):
        part = slice(start, start + block)
        values = {name: series.value[part] for name, series in recording.streams.items()}
        writer.block(Block(values, first.seq[part], first.time[part], first.time_host[part]))
    if recording.frames is not None:
        for number, image in enumerate(recording.frames.data):
            writer.frame(Frame(image, number + 3, recording.frames.time[number], 0.0))
    if close:
        writer.close("completed", end_time=recording.info.end_time)
    else:
        os.close(writer._file)


def test_finalise_gives_the_recording_and_removes_the_journal(tmp_path: Path) -> None:
    recording = replace(sample_recording(), derived={})
    journal = tmp_path / "run.journal"
    write(journal, recording)
    path = finalise(journal, tmp_path / "run.h5")
    read = open_recording(path)
    assert recording.frames is not None
    # Without a scale the frames are kept, and nothing is measured in them.
    expected = replace(
        recording, setpoints=read.setpoints, segments=read.segments, frames=replace(recording.frames, scale=0.0)
    )
    assert difference(expected, read) == ""
    assert np.array_equal(read.setpoints["pressure"].time, [0, 0, 0, 15, 15, 15])
    assert np.array_equal(read.setpoints["pressure"].value, [0, -3e4, -3e4, -3e4, -3e4, 0])
    assert read.setpoints["pressure"].unit == "Pa"
    assert read.frames is not None
    assert recording.frames is not None
    assert np.array_equal(np.asarray(read.frames.data), recording.frames.data)
    assert read.streams["pressure"].range == (-5e4, 0.0)
    assert not journal.exists()


def test_finalise_reads_the_frames(tmp_path: Path) -> None:
    rows, columns = np.mgrid[:120, :160]
    time = np.arange(20) / 25.0
    with JournalWriter(tmp_path / "run.journal", sample_recording().info, CHANNELS, frame_scale=2e-5) as writer:
        writer.setpoints(STEP, start=0.4)
        for number, moment in enumerate(time):
            top = 90.0 - (40.0 if moment > 0.4 else 0.0)
            dome = rows > top + (columns - 80) ** 2 / 60
            writer.frame(Frame(np.where(dome, 30, 200).astype(np.uint8), number, moment, moment))
    recording = open_recording(finalise(tmp_path / "run.journal", tmp_path / "run.h5"))
    height = recording.stream("apex_height")
    assert height.value[5] == pytest.approx(0.0, abs=4e-6)
    assert height.value[-1] == pytest.approx(40 * 2e-5, abs=2e-5)
    assert set(recording.derived) == {"apex_low", "apex_high", "profile", "contour_confidence"}
    assert recording.derived["profile"].value.shape == (20, 160)
    assert recording.info.calibration["gvt"]["apex"] == "up"


def test_a_crash_after_the_rename_changes_nothing(tmp_path: Path) -> None:
    journal = tmp_path / "run.journal"
    write(journal, sample_recording())
    path = finalise(journal, tmp_path / "run.h5", keep=True)
    before = path.read_bytes()
    assert recover(journal) == path
    assert path.read_bytes() == before
    other = tmp_path / "other.journal"
    write(other, sample_recording(run_id="another"))
    with pytest.raises(RecordingError, match="holds run 20260101-120000-cutometer, not another"):
        finalise(other, path)
    assert path.read_bytes() == before


def test_a_journal_is_never_overwritten(tmp_path: Path) -> None:
    journal = tmp_path / "run.journal"
    write(journal, sample_recording())
    with pytest.raises(FileExistsError):
        JournalWriter(journal, sample_recording().info)


@settings(max_examples=25, deadline=None)
@given(fraction=st.floats(0.0, 1.0))
def test_cut_anywhere_what_is_whole_is_recovered(tmp_path_factory: pytest.TempPathFactory, fraction: float) -> None:
    folder = tmp_path_factory.mktemp("cut")
    recording = sample_recording()
    write(folder / "whole.journal", recording, close=False)
    content = (folder / "whole.journal").read_bytes()
    cut = folder / "cut.journal"
    cut.write_bytes(content[: int(fraction * len(content))])
    if len(cut.read_bytes()) < content.find(MAGIC, 4):  # within the first record
        with pytest.raises(RecordingError, match="not a journal, or its first record is damaged"):
            read_journal(cut)
        return
    found = read_journal(cut)
    assert found.info.status == "recovered"
    for name, series in found.streams.items():
        assert np.array_equal(series.value, recording.streams[name].value[: len(series.value)])
        assert len(series.value) % 100 == 0


def test_damage_in_the_middle_costs_one_record_and_is_told(tmp_path: Path) -> None:
    journal = tmp_path / "run.journal"
    recording = sample_recording()
    write(journal, recording)
    content = bytearray(journal.read_bytes())
    content[len(content) // 2] ^= 0xFF
    journal.write_bytes(content)
    found = read_journal(journal)
    assert found.info.status == "completed"
    assert len(found.stream("pressure").value) == 2900
    assert [e.code for e in found.events if e.level == "warning"] == ["late", "journal_damage", "lost"]
    assert "skipped" in found.events[-2].text
    assert found.events[-1].count == 100


@pytest.mark.parametrize("content", [b"", b"SRJ1", b"not a journal at all, but long enough to be one" * 20])
def test_what_is_no_journal_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "x.journal"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=r"x\.journal: not a journal"):
        read_journal(path)


def test_setpoints_are_replaced_from_their_start_on(tmp_path: Path) -> None:
    journal = tmp_path / "run.journal"
    ramp = Setpoints((Segment(10.0, {"pressure": 0.0}, {"pressure": -1e4}),))
    with JournalWriter(journal, sample_recording().info, CHANNELS) as writer:
        writer.setpoints(ramp)
        writer.setpoints(Setpoints((Segment(2.0, {"pressure": 0.0}, {"pressure": 0.0}),)), start=4.0)
    commanded = read_journal(journal).setpoints["pressure"]
    assert np.array_equal(commanded.time, [0, 4, 4, 6])
    assert np.array_equal(commanded.value, [0, -4e3, 0, 0])


def test_blocks_of_several_links_and_a_channel_that_changes_company(tmp_path: Path) -> None:
    def block(names: str, seq: range) -> Block:
        counts = np.array(seq)
        return Block({n: counts * 1.0 for n in names}, counts, counts / 10.0, counts / 10.0)

    journal = tmp_path / "run.journal"
    with JournalWriter(journal, sample_recording().info) as writer:
        writer.block(block("ab", range(5)))
        writer.block(block("c", range(3)))
        writer.block(block("a", range(5, 8)))
    streams = read_journal(journal).streams
    assert {name: len(series.value) for name, series in streams.items()} == {"a": 8, "b": 5, "c": 3}
    assert np.array_equal(streams["a"].value, np.arange(8))


def test_a_full_disk_loses_nothing_so_far(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    journal = tmp_path / "run.journal"
    writer = JournalWriter(journal, sample_recording().info, CHANNELS)
    seq = np.arange(100)
    block = Block({"pressure": seq * 1.0}, seq, seq / 100.0, seq / 100.0)
    writer.block(block)
    real = os.write
    calls = 0

    def partial(file: int, data: bytes) -> int:
        nonlocal calls
        calls += 1
        if calls > 1:
            raise OSError(errno.ENOSPC, "No space left on device")
        return real(file, data[: len(data) // 2])

    with monkeypatch.context() as patch:
        patch.setattr(os, "write", partial)
        with pytest.raises(JournalFull, match="the disk is full"):
            writer.block(block)
    with pytest.raises(JournalFull):
        writer.event(Event(1.0, "info", "x", "y"))
    writer.close("failed")
    found = read_journal(journal)
    assert len(found.stream("pressure").value) == 100
    assert not found.events
    assert found.info.status == "recovered"


def kill_child(work: Callable[[Path, Connection], None], journal: Path, delay: float) -> int:
    """Start ``work`` in a process, kill -9 it ``delay`` s after its first record; returns the number it said last."""
    # A server that has imported everything forks the children: starting fifty interpreters would take a minute.
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([journal_child.__name__])
    ours, theirs = context.Pipe(duplex=False)
    child = context.Process(target=work, args=(journal, theirs))
    child.start()
    theirs.close()
    with ours:
        said = ours.recv()
        time.sleep(delay)
        child.kill()
        with contextlib.suppress(EOFError, OSError):
            while True:
                said = ours.recv()
    child.join()
    assert child.exitcode == -signal.SIGKILL
    child.close()
    return int(said)


def test_thirty_kills_while_recording(tmp_path: Path) -> None:
    chance = random.Random(2026)
    for number in range(30):
        journal = tmp_path / f"{number}.journal"
        begun = kill_child(journal_child.record, journal, chance.uniform(0.0, 0.08))
        if begun == 0:
            continue  # killed within its first record: there may be nothing yet
        recording = open_recording(recover(journal))
        assert recording.info.status == "recovered"
        pressure = recording.stream("pressure")
        assert np.array_equal(pressure.value, np.arange(len(pressure.value))), "nothing is missing inside"
        # A record holds 10 ms. Only the one in hand may be lost: ten times better than the 100 ms allowed.
        assert 10 * begun <= len(pressure.value) <= 10 * begun + 10


def test_twenty_kills_while_finalising(tmp_path: Path) -> None:
    chance = random.Random(2027)
    for number in range(20):
        folder = tmp_path / str(number)
        folder.mkdir()
        begun = kill_child(journal_child.finalise_again_and_again, folder / "run.journal", chance.uniform(0.0, 0.08))
        whole = sorted(folder.glob("*.h5"))
        assert begun <= len(whole) <= begun + 1
        for path in [*whole, recover(folder / "run.journal")]:
            assert len(open_recording(path).stream("pressure").value) == 1000


def test_set_points_never_go_back(tmp_path: Path) -> None:
    """Durations told by a device may be negative by an ulp; the recording is exported and imported all the same."""
    pieces = Setpoints(tuple(Segment(d, {"pressure": 0.0}, {"pressure": 0.0}) for d in (0.6, 1.0, -4.4e-16, 8.0)))
    with JournalWriter(tmp_path / "run.journal", sample_recording().info, CHANNELS) as writer:
        writer.setpoints(pieces, start=0.76)
    assert np.all(np.diff(read_journal(tmp_path / "run.journal").setpoints["pressure"].time) >= 0)
