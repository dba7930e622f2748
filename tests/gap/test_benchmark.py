"""The full blind benchmark in the small: it runs, goes on where it stopped, and prints every figure of the table."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

from gap.batch import diagnose_cases

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
TABLE = (
    "top-1", "top-3", "stage", "top-1, delta > 30", "false alarms T0", "false alarms T6", "calibration error",
    "unknown found at 5 % false, delta >= 10", "both of a pair in the top three", "power at delta = 6",
    "shrink on another waveform (median; truth: 1)", "seconds a case (median)",
)  # fmt: skip


@pytest.fixture(scope="module")
def benchmark() -> ModuleType:
    spec = importlib.util.spec_from_file_location("blind_benchmark", ROOT / "benchmarks/blind/run.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_a_small_benchmark_prints_the_whole_table_and_resumes(benchmark: ModuleType, tmp_path: Path) -> None:
    arguments = (["T0", "T3"], 1, [3], ["aspiration"], 1, "dense")
    card = benchmark.run(tmp_path, *arguments)
    text = card.as_text()
    assert (card.cases, card.missing) == (2, 0)
    assert all(name in text for name in TABLE)
    reports = sorted((tmp_path / "reports").glob("*.json"))
    assert len(reports) == 2  # cases of different tiers never share a name
    written = [r.stat().st_mtime_ns for r in reports]
    reports[0].unlink()
    benchmark.run(tmp_path, *arguments)
    assert reports[0].exists()
    assert reports[1].stat().st_mtime_ns == written[1]


def test_folders_without_cases_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="no such folder of cases"):
        diagnose_cases(tmp_path / "none", tmp_path / "out")
    with pytest.raises(FileNotFoundError, match="no case folder"):
        diagnose_cases(tmp_path, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_the_benchmark_of_other_rigs_runs_and_counts(tmp_path: Path) -> None:
    def run(*arguments: str) -> str:
        command = [sys.executable, *arguments]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True, timeout=240)
        return done.stdout

    run("benchmarks/rigs/make.py", "-o", str(tmp_path), "--only", "two_axis", "--seeds", "1")
    text = run("benchmarks/rigs/run.py", str(tmp_path))
    assert "1 cases with an effect, 0 without" in text
    assert "exact 1/1" in text
    assert "crashes: none" in text
