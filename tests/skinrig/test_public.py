"""The public package: every name of it is there, and a run is made, read and diagnosed through it alone."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import skinrig


def test_every_name_is_there_and_no_other() -> None:
    assert all(getattr(skinrig, name) is not None for name in skinrig.__all__)
    assert dir(skinrig) == sorted(skinrig.__all__)
    with pytest.raises(AttributeError, match="no attribute 'fitt'"):
        skinrig.fitt  # noqa: B018


@pytest.mark.real_time
def test_a_run_is_recorded_and_read(tmp_path: Path) -> None:
    outcome = skinrig.run("demo-cutometer", skinrig.simulated_station(seed=2), out=tmp_path, speed=50, subject="P07")
    recording = skinrig.load(outcome.recording)
    assert recording.info.subject == "P07"
    assert set(recording.streams) >= {"pressure", "apex_height"}


def test_a_fit_is_the_solver_s(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("skinrig_solver")
    with pytest.raises(ValueError, match="no model 'springs'"):
        skinrig.fit([], model="springs")
    monkeypatch.setattr("acquire.plugins.plugins", lambda group: {})
    with pytest.raises(ValueError, match=r"no solver plugin.*pip install \./solver"):
        skinrig.fit([], model="springs")


def test_it_imports_nothing_before_it_is_used() -> None:
    code = "import sys, skinrig; print([m for m in sys.modules if m.split('.')[0] in ('numpy', 'acquire', 'gap')])"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert said.stdout.strip() == "[]"


@pytest.mark.parametrize("arguments", [["--help"], ["doctor", "--help"]])
def test_the_command_line_has_a_second_name(arguments: list[str]) -> None:
    said = subprocess.run([sys.executable, "-m", "skinrig", *arguments], capture_output=True, text=True, check=False)
    assert said.returncode == 0
    assert "Usage: " in said.stdout
