"""The compiler's knowledge of a protocol stays with the recording, and nobody has to guess it again."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import protocols
from acquire.analysis.cycles import commanded_cycles, find_cycles, suction_cycles
from acquire.recording import (
    JournalWriter,
    RecordingError,
    RunInfo,
    SegmentRecord,
    Series,
    load,
    open_recording,
    read_journal,
    write_bundle,
    write_recording,
)
from acquire.recording.model import difference
from acquire.recording.segments import from_columns, kinks, of_setpoints, to_columns
from acquire.session import Session
from protocols import Limits, Setpoints, compile_protocol
from protocols.catalogue import library
from protocols.limits import Range
from tests.acquire.recording.samples import sample_recording

names = st.from_regex(r"[a-z][a-z0-9_]{0,8}", fullmatch=True)
numbers = st.floats(-1e6, 1e6, allow_subnormal=False)
words = st.text(st.characters(blacklist_categories=("Cs", "Cc")), min_size=1, max_size=10) | st.just("=1+1")


def compiled(name: str) -> Setpoints:
    protocol = protocols.load(library()[name])
    return compile_protocol(protocol, Limits({q: Range(-1e9, 1e9) for q in protocol.quantities}))


@st.composite
def all_segments(draw: st.DrawFn) -> tuple[SegmentRecord, ...]:
    quantities = draw(st.lists(names, min_size=1, max_size=3, unique=True))
    moment, segments = draw(numbers), []
    for _ in range(draw(st.integers(1, 6))):
        end = moment + draw(st.floats(0, 100))
        start, finish = ({q: draw(numbers) for q in quantities} for _ in range(2))
        labels = draw(st.dictionaries(names, words, max_size=3))
        phase = draw(st.sampled_from(["load", "hold", "unload", "rest"]))
        segments.append(SegmentRecord(moment, end, phase, draw(words), start, finish, labels))
        moment = end
    return tuple(segments)


@settings(max_examples=20, deadline=None)
@given(segments=all_segments())
def test_hdf5_and_bundle(tmp_path_factory: pytest.TempPathFactory, segments: tuple[SegmentRecord, ...]) -> None:
    folder = tmp_path_factory.mktemp("segments")
    recording = replace(sample_recording(50, frames=0), segments=segments)
    assert from_columns(to_columns(segments)) == segments
    assert difference(recording, open_recording(write_recording(recording, folder / "run.h5"))) == ""
    assert difference(recording, load(write_bundle(recording, folder / "bundle"))) == ""


@pytest.mark.parametrize("name", sorted(n for n in library() if n.startswith(("cutometer", "aspiration", "fingertip"))))
def test_cycles_are_those_of_the_set_points(name: str) -> None:
    setpoints = compiled(name)
    time, values = setpoints.table()
    guessed = find_cycles(Series(values["pressure"], time + 1.5, "Pa"), threshold=0.02)
    known = commanded_cycles(of_setpoints(setpoints, 1.5))
    assert len(known) == len(guessed) > 0
    for a, b in zip(known, guessed, strict=True):
        assert vars(a) == pytest.approx(vars(b))


def test_a_suction_too_small_for_a_threshold_is_a_cycle_all_the_same() -> None:
    def ramp(begin: float, a: float, b: float) -> SegmentRecord:
        return SegmentRecord(begin, begin + 1, "load", "0", {"pressure": a}, {"pressure": b})

    segments = (ramp(0, 0, -300), ramp(1, -300, 0), ramp(2, 0, 0), ramp(3, 0, -5e4), ramp(4, -5e4, 0))
    assert [cycle.level for cycle in commanded_cycles(segments)] == [-300, -5e4]


def test_the_compiler_s_words_in_numbers() -> None:
    first, second, *_ = of_setpoints(compiled("aspiration-linear-15"))
    assert (second.phase, second.level, second.rate) == ("load", -15_000.0, 1_500.0)
    assert second.slopes == {"pressure": -1_500.0}
    robot = of_setpoints(compiled("demo-microrobot"))
    moving = next(s for s in robot if s.direction is not None and s.rate > 0)
    assert math.hypot(*(moving.direction or ())) == pytest.approx(1.0)
    reached = np.array([moving.finish[f"probe_{axis}"] for axis in "xyz"])
    assert np.allclose(reached, moving.level * np.array(moving.direction))
    assert moving.cycle == 1
    assert math.isnan(replace(first, labels={"level": "high"}).level)


def test_kinks_are_where_the_command_is_not_smooth() -> None:
    def piece(begin: float, end: float, a: float, b: float) -> SegmentRecord:
        return SegmentRecord(begin, end, "load", "0", {"pressure": a}, {"pressure": b})

    line = (piece(0, 1, 0, -1), piece(1, 3, -1, -3), piece(3, 4, -3, -3), piece(4, 4, -3, 0), piece(4, 5, 0, 0))
    assert kinks(line).tolist() == [3, 4]
    assert kinks(()).tolist() == []


def test_a_journal_replaces_them_from_a_start_on(tmp_path: Path) -> None:
    setpoints = compiled("demo-cutometer")
    with JournalWriter(tmp_path / "run.journal", RunInfo("r", "cutometer", "")) as writer:
        writer.setpoints(setpoints)
        writer.setpoints(setpoints, start=1.25)
    segments = read_journal(tmp_path / "run.journal").segments
    assert segments[-len(setpoints.segments) :] == of_setpoints(setpoints, 1.25)
    assert segments[0].end <= 1.25
    assert [s.end for s in segments[:-1]] == [s.begin for s in segments[1:]]


def test_a_run_records_what_was_executed(skinrig_session: Callable[..., Session]) -> None:
    outcome = skinrig_session().run("demo-cutometer")
    recording = open_recording(outcome.recording)  # type: ignore[arg-type]
    ours = [s for s in recording.segments if s.step]
    expected = compiled("demo-cutometer").segments
    assert [(s.phase, s.step, s.labels) for s in ours] == [(s.phase, s.step, s.labels) for s in expected]
    assert [s.duration for s in ours] == pytest.approx([s.duration for s in expected], abs=0.02)
    commanded = recording.setpoints["pressure"]
    assert np.array_equal(commanded.time[::2], [s.begin for s in recording.segments])
    assert len(suction_cycles(recording)) == 2
    known = [cycle.onset for cycle in suction_cycles(replace(recording, segments=()))]
    assert [cycle.onset for cycle in suction_cycles(recording)] == pytest.approx(known)


def test_a_recording_of_an_earlier_version_has_none(tmp_path: Path) -> None:
    recording = sample_recording(50, frames=0)
    path = write_recording(recording, tmp_path / "run.h5")
    with h5py.File(path, "r") as file:
        assert "segments" not in file["entry/setpoints"]
    assert open_recording(path).segments == ()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("begin,end", "begin,finish"), "no column 'end'"),
        (("0.0,1.0", "zero,1.0"), "segment 1: could not convert"),
        (("0.0,1.0", "2.0,1.0"), "segment 1: from 2 to 1 s"),
        (("0.0,1.0", "nan,1.0"), "segment 1"),
    ],
)
def test_a_bundle_s_table_that_makes_no_sense_is_named(change: tuple[str, str], words: str, tmp_path: Path) -> None:
    segment = SegmentRecord(0.0, 1.0, "load", "0", {"pressure": 0.0}, {"pressure": -1.0}, {})
    folder = write_bundle(replace(sample_recording(50, frames=0), segments=(segment,)), tmp_path / "bundle")
    table = folder / "segments.csv"
    table.write_text(table.read_text().replace(*change))
    with pytest.raises(RecordingError, match=rf"segments\.csv: .*{words}"):
        load(folder)
