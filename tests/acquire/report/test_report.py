"""Reports: the summary's facts, figures without losing extremes, a page that is whole and harmless."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from acquire.recording import Recording, load
from acquire.report.figures import frame_strip, overview, save, thinned
from acquire.report.page import render, write_page
from acquire.report.summary import in_words, summarise
from acquire.words import shown
from tests.acquire.recording.samples import sample_recording
from tests.conftest import Folder
from tests.standins import example


def tanks(data: Path, folder: Path) -> Recording:
    return load(example("cascaded_tanks").make_bundle("estimation", folder / "tanks", data))


def test_summary_is_json_and_words() -> None:
    summary = summarise(sample_recording())
    assert json.loads(json.dumps(summary, allow_nan=False)) == summary
    assert summary["channels"]["pressure"]["rate"] == pytest.approx(100.0)
    assert summary["parameters"]["R0"] == pytest.approx(2e-4, rel=0.01)
    words = in_words(summary)
    for fact in (
        "subject P07",
        "forehead",
        "pressure",
        "mbar",
        "R0 0.2 mm",
        "no sample is missing",
        "a sample came late",
    ):
        assert fact in words, fact


def test_saturation_of_a_real_sensor_is_seen(public_data: Folder, tmp_path: Path) -> None:
    words = in_words(summarise(tanks(public_data("cascaded_tanks"), tmp_path)))
    assert "level stays at its extreme in 4.6 % of the samples" in words


def test_saturation_of_a_sensor_is_seen(stand_in: Folder, tmp_path: Path) -> None:
    recording = tanks(stand_in("cascaded_tanks"), tmp_path)
    share = 100 * np.mean(recording.stream("level").value == 10.0)
    assert f"level stays at its extreme in {share:.2g} % of the samples" in in_words(summarise(recording))


def test_values_are_shown_in_pleasant_units() -> None:
    assert shown(-3e4, "Pa") == "-300 mbar"
    assert shown(1.5e-4, "m") == "0.15 mm"
    assert shown(None, "m") == "–"
    assert shown(float("nan"), "1") == "–"
    assert shown(0.5, "1") == "0.5"


def test_thinning_keeps_extremes() -> None:
    time = np.arange(100_000.0)
    value = np.zeros(100_000)
    value[77_777], value[12_345] = 1.0, -1.0
    thin_time, thin_value = thinned(time, value, 200)
    assert len(thin_time) <= 402
    assert (thin_value.max(), thin_value.min()) == (1.0, -1.0)
    assert thin_time[0] == 0
    assert thin_time[-1] == 99_999
    assert np.all(np.diff(thin_time) > 0)


@pytest.mark.parametrize("kind", ["suction", "frames", "empty", "tanks"])
def test_every_kind_of_recording_has_a_figure(kind: str, stand_in: Folder, tmp_path: Path) -> None:
    recording = sample_recording(frames=5 if kind == "frames" else 0)
    if kind == "tanks":
        recording = tanks(stand_in("cascaded_tanks"), tmp_path)
    if kind == "empty":
        recording = replace(recording, streams={}, setpoints={}, events=())
    path = save(overview(recording), tmp_path / "a.png")
    assert path.read_bytes().startswith(b"\x89PNG")
    assert (frame_strip(recording) is not None) == (kind == "frames")


def test_page_is_self_contained_and_escapes(tmp_path: Path) -> None:
    evil = "<script>alert(1)</script>"
    recording = sample_recording()
    recording = replace(recording, info=replace(recording.info, notes=evil, subject=evil, protocol=evil))
    path = write_page(
        [recording, replace(recording, info=replace(recording.info, id="second"))], tmp_path / "p" / "a.html"
    )
    html = path.read_text(encoding="utf-8")
    assert "<script" not in html
    assert "&lt;script&gt;" in html
    sources = re.findall(r'(?:src|href)="([^"]{0,30})', html)
    assert sources
    assert all(source.startswith("data:image/") for source in sources)
    assert "2 recordings" in html
    assert "this project&#39;s reading" in html


def test_no_recordings() -> None:
    with pytest.raises(ValueError, match="at least one"):
        render([])
