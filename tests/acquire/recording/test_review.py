"""Whether a run counts: by how it ended, by a person's word beside it, and everywhere the same."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from acquire.cli import app
from acquire.recording import Event, Recording, RunInfo, Series, counted, decide, left_out, load, write_recording
from acquire.recording.review import beside
from acquire.report.figures import comparison
from acquire.report.page import render


def run(name: str, **more: object) -> Recording:
    time = np.linspace(0, 2, 200)
    suction = np.where((time > 0.5) & (time < 1.5), -3e4, 0.0)
    height = np.where((time > 0.5) & (time < 1.5), 1e-3, 2e-4) * (2.0 if name == "odd" else 1.0)
    events = more.pop("events", ())
    info = RunInfo(name, "cutometer", "2026-01-01T00:00:00", protocol_name="p", device="left", **more)  # type: ignore[arg-type]
    streams = {"pressure": Series(suction, time, "Pa"), "apex_height": Series(height, time, "m")}
    return Recording(info, streams, {"pressure": streams["pressure"]}, events=events)  # type: ignore[arg-type]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return write_recording(run("one"), tmp_path / "one.h5")


def test_by_default_only_whole_runs_count() -> None:
    pause = (Event(1.0, "info", "pause", ""),)
    assert [left_out(run("a", status=status)) for status in ("completed", "imported")] == ["", ""]
    for status in ("aborted", "tripped", "failed", "recovered"):
        assert left_out(run("a", status=status, trip_reason="why")) == f"the run {status}: why"
    assert "paused" in left_out(run("a", events=pause))
    kept, lines = counted([run("a"), run("b", status="aborted")])
    assert [r.info.id for r in kept] == ["a"]
    assert lines == ["b is left out: the run aborted"]


def test_the_last_decision_holds_all_are_kept_and_the_recording_is_not_touched(path: Path) -> None:
    before = path.read_bytes()
    decide(path, include=False, reason="slipped", by="AK")
    decide(path, include=True, reason="not really")
    decide(path, include=False, reason="it\ndid")
    recording = load(path)
    assert [(d.include, d.reason, d.by) for d in recording.decisions] == [
        (False, "slipped", "AK"), (True, "not really", ""), (False, "it did", ""),
    ]  # fmt: skip
    assert left_out(recording) == "left out: it did"
    assert path.read_bytes() == before
    assert recording.info.device == "left"
    with pytest.raises(ValueError, match="reason"):
        decide(path, include=True, reason="  ")


def test_a_line_that_cannot_be_read_leaves_the_run_out(path: Path) -> None:
    decide(path, include=True, reason="fine")
    with beside(path).open("ab") as file:
        file.write(b'{"id": "one", "incl')  # a crash in the middle of a line
    assert "cannot be read" in left_out(load(path))
    decide(path, include=True, reason="looked again")  # on a line of its own
    assert left_out(load(path)) == ""
    with beside(path).open("a") as file:
        file.write(json.dumps({"id": "two", "include": False, "reason": "", "by": "", "time": ""}) + "\n")
    assert left_out(load(path)) == ""  # of another run


def test_means_bands_and_scatter_are_of_runs_that_count() -> None:
    whole = [run("a"), run("b"), run("c")]
    figure = comparison([*whole, run("odd", status="tripped", trip_reason="too far")])
    labels = [line.get_label() for line in figure.axes[0].lines]
    assert "mean of 3, 95 % band" in labels
    assert "odd (repeat 1, left out)" in labels
    page = render([*whole, run("odd", status="tripped", trip_reason="too far")])
    assert "odd is left out: the run tripped: too far" in page
    alone = render(whole)
    assert page[page.index('<div class="cells">') :][:400] == alone[alone.index('<div class="cells">') :][:400]


def test_the_command_line_respects_it(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert app.run(["review", str(path), "--exclude", "--reason", "slipped", "--by", "AK"]) == 0
    assert "left out by AK: slipped" in capsys.readouterr().out
    assert app.run(["review", str(path), "--exclude"]) == 2
    assert app.run(["show", str(path)]) == 0
    assert "does not count with others: left out by AK: slipped" in capsys.readouterr().out
    assert app.run(["show", str(path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["left_out"] == "left out by AK: slipped"
    assert app.run(["ls", "-d", str(path.parent), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)[0]["left_out"] == "left out by AK: slipped"
    assert app.run(["gap", "diagnose", str(path)]) == 2
    assert "one is left out" in capsys.readouterr().err
    assert app.run(["review", str(path), "--include", "--reason", "it was another one", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["left_out"] == ""
