"""The README's examples work."""

from __future__ import annotations

import runpy
from pathlib import Path

import numpy as np
import pytest

from skinrig_solver import Experiment


def test_a_law_of_ones_own_runs_and_differentiates() -> None:
    model = runpy.run_path(str(Path(__file__).parents[1] / "examples" / "demiray.py"))["MODEL"]
    time = np.linspace(0.0, 2.0, 11)
    run = Experiment("cutometer", time, {"pressure": np.where(time > 0.0, -20e3, 0.0)})
    result = model.simulate(run, {}, ["a", "tau"])
    assert np.all(np.diff(result.channels["apex_height"][1:]) > 0.0)  # it creeps
    for j, (symbol, value) in enumerate({"a": 2e4, "tau": 2.0}.items()):
        up, down = (model.simulate(run, {symbol: value * f}).channels["apex_height"][-1] for f in (1.002, 0.998))
        exact = result.sensitivities["apex_height"][-1, j]
        assert exact == pytest.approx((up - down) / (0.004 * value), rel=1e-3)
