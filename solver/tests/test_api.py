"""The contract types: bad input is refused by name, models are listed without being imported."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys

import numpy as np
import pytest

from skinrig_solver import Experiment, Model, Parameter, SolverError, models
from skinrig_solver.plugin import SkinrigSolver


def test_experiment_names_the_bad_drive() -> None:
    time = np.linspace(0.0, 1.0, 5)
    with pytest.raises(ValueError, match="'pressure' has shape"):
        Experiment("cutometer", time, {"pressure": np.zeros(4)})
    with pytest.raises(ValueError, match="not finite at sample 2"):
        Experiment("cutometer", time, {"pressure": np.array([0, 0, np.nan, 0, 0])})
    with pytest.raises(ValueError, match="strictly increasing"):
        Experiment("cutometer", time[::-1], {"pressure": np.zeros(5)})


def test_parameter_bounds_hold_the_default() -> None:
    with pytest.raises(ValueError, match="G: default"):
        Parameter("G", "Pa", 1.0, 2.0, 3.0, "", "")
    with pytest.raises(ValueError, match="log scale"):
        Parameter("G", "Pa", 0.0, 2.0, 1.0, "", "", "log")


def test_solver_error_says_where_and_survives_pickling() -> None:
    error = SolverError("did not converge", time=1.5, load={"pressure": -3e4}, element=7)
    again = pickle.loads(pickle.dumps(error))
    assert str(again) == str(error) == "did not converge (at t = 1.5 s, pressure = -30000, element 7)"
    assert again.element == 7


def test_listing_models_imports_no_kernels() -> None:
    code = "import sys; from skinrig_solver import models; list(models()); assert 'numba' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_unknown_model_and_parameter_are_named() -> None:
    with pytest.raises(KeyError, match="no model 'skin'"):
        models()["skin"]
    model = models()["suction_rubin_bodner"]
    assert isinstance(model, Model)
    with pytest.raises(ValueError, match=r"no parameter 'mu0'.*skin\.mu0"):
        model.info.complete({"mu0": 1.0})
    with pytest.raises(ValueError, match=r"skin\.q: -1"):
        model.info.complete({"skin.q": -1.0})


def test_plugin_serves_the_registry() -> None:
    plugin = SkinrigSolver()
    assert set(plugin.models()) == set(models())
    run = Experiment("cutometer", np.linspace(0.0, 1.0, 3), {"pressure": np.zeros(3)})
    assert np.allclose(plugin.simulate("suction_rubin_bodner", run, {}).channels["apex_height"], 0.0, atol=2e-7)


@pytest.mark.parametrize(("chosen", "level"), [(None, "2"), ("3", "3")])
def test_kernels_are_compiled_at_the_second_level_unless_told_otherwise(chosen: str | None, level: str) -> None:
    environment = {k: v for k, v in os.environ.items() if k != "NUMBA_OPT"} | ({"NUMBA_OPT": chosen} if chosen else {})
    code = "import skinrig_solver, numba; print(int(numba.config.OPT))"
    found = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert found.stdout.strip() == level
