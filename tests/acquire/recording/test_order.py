"""Whatever order and number a link delivers blocks in, a recording's time never goes back and every count is true."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import replace
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
    RunInfo,
    load,
    open_recording,
    read_journal,
    recover,
    write_bundle,
    write_recording,
)
from acquire.recording.model import difference
from acquire.recording.order import Missing
from acquire.report.summary import delivery
from drivers.signals import Block, Channel, Frame
from tests.acquire.recording.samples import sample_recording

INFO = RunInfo("r", "some rig", "2026-01-01T12:00:00+00:00")
CHANNELS = (Channel("a", "V", "sensor"), Channel("b", "V", "sensor"))
SIZE = 10  # samples in a block


def block(number: int, *, shift: float = 0.0, value: float = 0.0) -> Block:
    seq = np.arange(number * SIZE, (number + 1) * SIZE)
    values = {"a": seq + value, "b": np.where(seq % 7, seq * 2.0, np.nan)}
    return Block(values, seq, seq / 100.0 + shift, seq / 100.0)


def recorded(folder: Path, blocks: list[Block], frames: tuple[Frame, ...] = ()) -> Recording:
    with JournalWriter(folder / "run.journal", INFO, CHANNELS) as writer:
        for each in blocks:
            writer.block(each)
        for frame in frames:
            writer.frame(frame)
    return open_recording(recover(folder / "run.journal"))


@settings(max_examples=30, deadline=None)
@given(arrival=st.lists(st.integers(0, 8), min_size=1, max_size=20))
def test_any_arrival(tmp_path_factory: pytest.TempPathFactory, arrival: list[int]) -> None:
    """Blocks that are lost, doubled and reordered at will: kept once, in order, counted, and the bundle comes back."""
    folder = tmp_path_factory.mktemp("order")
    recording = recorded(folder, [block(number) for number in arrival])
    unique = sorted(set(arrival))
    stream = recording.stream("a")
    assert np.array_equal(stream.seq, np.concatenate([block(n).seq for n in unique]))  # type: ignore[arg-type]
    assert np.array_equal(stream.value, np.concatenate([block(n).values["a"] for n in unique]))
    assert np.all(np.diff(stream.time) > 0)
    firsts = list(dict.fromkeys(arrival))
    expected = Counter(
        lost=SIZE * (unique[-1] - unique[0] + 1 - len(unique)),
        duplicate=SIZE * (len(arrival) - len(unique)),
        late=SIZE * sum(number < max(firsts[:place]) for place, number in enumerate(firsts) if place),
    )
    assert Counter(delivery(recording)) == expected
    live = Missing()
    for number in [0, *arrival]:
        live.take(block(number).seq)
    assert live.count == SIZE * (unique[-1] - len(set(unique) - {0}))
    assert difference(recording, load(write_bundle(recording, folder / "bundle"))) == ""


def test_what_contradicts_itself_is_left_out_and_the_journal_stays(tmp_path: Path) -> None:
    recording = recorded(tmp_path, [block(0), block(1), block(1, value=0.5), block(2, shift=-0.15), block(3)])
    assert recording.stream("a").value.tolist() == [*range(20), *range(30, 40)]
    counts = delivery(recording)
    assert (counts["conflict"], counts["misdated"], counts["lost"]) == (10, 10, 10)
    recover(tmp_path / "run.journal", tmp_path / "again.h5", keep=False)
    assert (tmp_path / "run.journal").exists()


def test_one_wild_stamp_costs_one_sample(tmp_path: Path) -> None:
    wild = block(1)
    wild.time[4] = 1e9
    wild.time[7] = np.nan
    recording = recorded(tmp_path, [block(0), wild, block(2)])
    assert len(recording.stream("a").value) == 28
    assert delivery(recording)["misdated"] == 2


def test_frames(tmp_path: Path) -> None:
    def frame(number: int, grey: int | None = None) -> Frame:
        image = np.full((4, 6), number if grey is None else grey, np.uint8)
        return Frame(image, number, number / 25.0, 0.0)

    frames = (frame(0), frame(2), frame(1), frame(1), frame(5), frame(5, 9))
    recording = recorded(tmp_path, [block(0)], frames)
    assert recording.frames is not None
    assert recording.frames.seq is not None
    assert recording.frames.seq.tolist() == [0, 1, 2, 5]
    assert [int(image[0, 0]) for image in recording.frames.data] == [0, 1, 2, 5]
    counts = delivery(recording)
    assert (counts["duplicate"], counts["late"], counts["conflict"], counts["lost"]) == (1, 1, 1, 2)


def test_a_recording_of_an_earlier_version_is_put_in_order(tmp_path: Path) -> None:
    path = write_recording(replace(sample_recording(300, frames=0), derived={}), tmp_path / "run.h5")
    with h5py.File(path, "r+") as file:
        group = file["entry/streams/pressure"]
        file["entry"].visititems(_without_checksum)
        del file["entry"].attrs["checksum"]
        for name in ("value", "time", "time_host", "seq"):
            data = group[name][()]
            group[name][...] = np.concatenate([data[:100], data[150:200], data[100:150], data[200:]])
        # Without counts, too.
        events = file["entry/events"][()][["time", "level", "code", "text"]]
        del file["entry/events"]
        file["entry/events"] = events
    recording = open_recording(path)
    pressure = recording.stream("pressure")
    assert np.array_equal(pressure.seq, np.arange(300))  # type: ignore[arg-type]
    assert delivery(recording)["late"] == 50
    assert difference(recording, load(write_bundle(recording, tmp_path / "bundle"))) == ""


def _without_checksum(name: str, item: h5py.HLObject) -> None:
    item.attrs.pop("crc32", None)


def test_time_that_goes_back_is_not_written(tmp_path: Path) -> None:
    recording = sample_recording(10, frames=0)
    back = {name: replace(series, time=-series.time) for name, series in recording.streams.items()}
    with pytest.raises(RecordingError, match="stream pressure: time goes back after"):
        write_recording(replace(recording, streams=back), tmp_path / "run.h5")


def test_counts_are_shown(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recorded(tmp_path, [block(0), block(3), block(3), block(2)])
    assert run(["show", str(tmp_path / "run.h5")]) == 0
    assert "links: 10 samples lost, 10 came twice, 10 came late" in capsys.readouterr().out
    assert run(["show", "--json", str(tmp_path / "run.h5")]) == 0
    assert json.loads(capsys.readouterr().out)["delivery"]["duplicate"] == 10
    with h5py.File(tmp_path / "run.h5") as file:
        counts = {row["code"].decode(): int(row["count"]) for row in file["entry/events"][()]}
    assert counts == {"lost": 10, "duplicate": 10, "late": 10}


def test_many_gaps_make_few_events(tmp_path: Path) -> None:
    recording = read_journal(_sparse(tmp_path))
    lost = [event for event in recording.events if event.code == "lost"]
    assert len(lost) == 201
    assert delivery(recording)["lost"] == 299 * 9


def _sparse(folder: Path) -> Path:
    with JournalWriter(folder / "run.journal", INFO) as writer:
        for number in range(300):
            seq = np.array([number * 10])
            writer.block(Block({"a": seq * 1.0}, seq, seq / 10.0, seq / 10.0))
    return folder / "run.journal"


def test_the_live_count_forgives_the_late() -> None:
    missing = Missing()
    for seq in (range(5), range(10, 15), range(20, 25), range(8, 10), range(5, 7), range(5, 7), range(2)):
        missing.take(np.array(seq))
    assert missing.count == 1 + 5
