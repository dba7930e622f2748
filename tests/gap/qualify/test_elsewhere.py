"""Bundles of a laboratory that never saw our code, through import, qualification by recordings, and diagnosis."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from acquire.cli.app import NOT_PASSED, run
from acquire.qualifications import Qualification, load_qualification
from tests.gap.qualify.elsewhere import SKIN, STANDARD, Bench

pytestmark = pytest.mark.slow


def imported(bundles: list[Path], runs: Path) -> Path:
    """The folder ``runs`` with recordings of the bundles."""
    for bundle in bundles:
        assert run(["import", str(bundle), "-o", str(runs)]) == 0
    assert len(list(runs.glob("*.h5"))) == len(bundles)
    return runs


def qualified(bench: Bench, folder: Path) -> tuple[int, Qualification, Path]:
    """Exit status and qualification of a rig by its recordings of references, and the file."""
    runs, file = imported(bench.write(folder / "bundles", STANDARD, 1), folder / "references"), folder / "q.yaml"
    given = ["qualify", "cutometer", "--recordings", str(runs), "--serial", "C7", "--jobs", "1", "-o", str(file)]
    return run(given), load_qualification(file), file


def diagnosed(runs: Path, out: Path, *more: str) -> dict[str, Any]:
    assert run(["gap", "diagnose", str(runs), "--jobs", "1", "-o", str(out), *more]) == 0
    return dict(json.loads((out / "gap.json").read_text()))


def test_a_sound_rig_passes_and_its_skin_has_no_finding(tmp_path: Path) -> None:
    bench = Bench()
    status, q, file = qualified(bench, tmp_path)
    assert (status, q.passed, q.findings, q.doubts) == (0, True, (), ())
    assert {s.partition(" (")[0] for s in q.checked} == {
        "rigid block", "gauge step", "reference membrane", "manometer",
    }  # fmt: skip
    runs = imported(bench.write(tmp_path / "skin", SKIN, 2), tmp_path / "runs")
    report = diagnosed(runs, tmp_path / "gap", "--qualification", str(file))
    assert report["verdict"] in ("none", "undetectable")
    assert report["qualification"]["believed"]


def test_a_gauge_that_reads_too_much_is_named(tmp_path: Path) -> None:
    status, q, _ = qualified(Bench(gauge_gain=0.06), tmp_path)
    assert (status, q.passed) == (NOT_PASSED, False)
    assert [f.effect for f in q.findings] == ["gauge_gain"]
    assert q.findings[0].parameters["error"]["value"] == pytest.approx(0.06, abs=0.005)


def test_what_skin_could_hide_is_claimed_of_it_once_references_have_shown_it(tmp_path: Path) -> None:
    bench = Bench(late=0.15)
    status, q, file = qualified(bench, tmp_path)
    assert status == NOT_PASSED
    assert [f.effect for f in q.findings] == ["sensor_low_pass"]
    runs = imported(bench.write(tmp_path / "skin", SKIN, 2), tmp_path / "runs")
    report = diagnosed(runs, tmp_path / "gap", "--qualification", str(file))
    assert report["verdict"] == "effect"
    assert report["causes"][0]["effects"] == ["sensor_low_pass"]
    assert report["causes"][0]["parameters"]["tau"]["value"] == pytest.approx(0.15, rel=0.1)
    assert any("was not passed (sensor_low_pass)" in remark for remark in report["remarks"])
