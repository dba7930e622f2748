"""Recordings of simulated runs: they open on their default plot and come back from export and import."""

from __future__ import annotations

from pathlib import Path

import pytest
from nexusformat.nexus import nxload

from acquire.cli.app import DONE, run
from acquire.recording import load
from acquire.recording.model import difference

pytestmark = pytest.mark.real_time


@pytest.mark.parametrize(("protocol", "plot"), [("demo-cutometer", "apex_height"), ("demo-microrobot", "force_x")])
def test_run_export_import(tmp_path: Path, protocol: str, plot: str) -> None:
    path, bundle, back = tmp_path / "run.h5", tmp_path / "bundle", tmp_path / "back.h5"
    assert run(["run", protocol, "--sim", "--speed", "40", "-o", str(path)]) == DONE
    assert nxload(path).plottable_data.nxsignal.nxname == plot
    assert run(["export", str(path), "-o", str(bundle)]) == DONE
    assert run(["import", str(bundle), "-o", str(back)]) == DONE
    assert difference(load(path), load(back)) == ""
    assert load(path).info == load(back).info
