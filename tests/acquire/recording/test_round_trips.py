"""Whatever a recording holds comes back from HDF5, from a bundle and from the journal."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from acquire.recording import (
    Event,
    JournalWriter,
    Recording,
    RunInfo,
    Series,
    load,
    open_recording,
    read_bundle,
    read_journal,
    write_bundle,
    write_recording,
)
from acquire.recording.model import difference
from acquire.report.summary import summarise
from drivers.signals import Block, Channel
from tests.acquire.recording.samples import sample_recording

texts = st.text(st.characters(blacklist_categories=("Cs", "Cc")), max_size=20)
names = st.from_regex(r"[a-z][a-z0-9_]{0,12}", fullmatch=True).filter(lambda n: n not in ("time", "seq", "time_host"))
units = st.sampled_from(["Pa", "m", "N", "V", "s", "1", "rad", "K", "kg/s"])
numbers = st.floats(-1e6, 1e6, allow_subnormal=False)


@st.composite
def all_series(draw: st.DrawFn) -> Series:
    count = draw(st.integers(1, 40))
    value = draw(arrays.arrays(np.float64, count, elements=numbers))
    steps = draw(arrays.arrays(np.float64, count, elements=st.floats(0, 1)))
    first = draw(st.integers(0, 5))
    return Series(value, np.cumsum(steps), draw(units), None, np.arange(first, first + count), draw(texts))


@st.composite
def recordings(draw: st.DrawFn) -> Recording:
    info = RunInfo(
        id=draw(names),
        instrument="some rig",
        start_time="2026-01-01T00:00:00+00:00",
        subject=draw(texts),
        notes=draw(texts),
        repeat=draw(st.integers(0, 99)),
        protocol=draw(texts.map(lambda text: f"{text}\nfree: text\n")),
        status=draw(st.sampled_from(["completed", "aborted", "tripped"])),
    )
    events = draw(st.lists(st.builds(Event, numbers, st.sampled_from(["info", "trip"]), names, texts), max_size=3))
    streams = draw(st.dictionaries(names, all_series(), min_size=1, max_size=4))
    return Recording(info, streams, events=tuple(events))


@settings(max_examples=20, deadline=None)
@given(recording=recordings())
def test_hdf5_and_bundle(tmp_path_factory: pytest.TempPathFactory, recording: Recording) -> None:
    folder = tmp_path_factory.mktemp("round")
    assert difference(recording, open_recording(write_recording(recording, folder / "run.h5"))) == ""
    assert difference(recording, load(write_bundle(recording, folder / "bundle"))) == ""


@settings(max_examples=20, deadline=None)
@given(series=all_series(), cuts=st.lists(st.integers(1, 39), max_size=4))
def test_journal(tmp_path_factory: pytest.TempPathFactory, series: Series, cuts: list[int]) -> None:
    path: Path = tmp_path_factory.mktemp("journal") / "run.journal"
    edges = [0, *sorted({cut for cut in cuts if cut < len(series.value)}), len(series.value)]
    with JournalWriter(path, RunInfo("r", "some rig", ""), [Channel("a", series.unit, series.stage)]) as writer:
        for start, end in pairwise(edges):
            part = slice(start, end)
            assert series.seq is not None
            writer.block(Block({"a": series.value[part]}, series.seq[part], series.time[part], series.time[part]))
    found = read_journal(path).stream("a")
    assert np.array_equal(found.value, series.value)
    assert np.array_equal(found.time, series.time)
    assert np.array_equal(found.seq, series.seq)
    assert (found.unit, found.stage) == (series.unit, series.stage)


def test_consent_is_a_fact_of_the_recording(tmp_path: Path) -> None:
    sample = sample_recording(20, frames=0)
    recording = replace(sample, info=replace(sample.info, consent="C12, images included"))
    file = write_recording(recording, tmp_path / "run.h5")
    again = read_bundle(write_bundle(open_recording(file), tmp_path / "bundle"))
    assert again.info.consent == "C12, images included"
    assert summarise(sample)["consent"] == "not stated"
