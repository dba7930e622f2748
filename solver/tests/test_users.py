"""A user's model reaches a fit by name, and a bad file gets one clear error."""

from __future__ import annotations

from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest

from skinrig_solver import Experiment, models, users
from skinrig_solver.fit import read_spec
from skinrig_solver.users import UserModelError

FILE = """\
from skinrig_solver import Parameter
from skinrig_solver.materials.hyperelastic import hyperelastic
from skinrig_solver.suction import one_layer
from skinrig_solver.trace import exp

def energy(C, p):
    return p["a"] / (2.0 * p["b"]) * (exp(p["b"] * (C.trace() - 3.0)) - 1.0)

LAW = hyperelastic("mine", ("a", "b"), energy, lambda p: p["a"], terms=1)
MINE = one_layer(
    "suction_mine", LAW,
    (
        Parameter("a", "Pa", 1e2, 1e6, 2e4, "shear modulus", "me", "log"),
        Parameter("b", "", 1e-3, 50, 2, "stiffening", "me"),
    ),
    "Fung's exponential", "me",
)
NUMBER = 3
"""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    file = tmp_path / "mine.py"
    file.write_text(FILE)
    return file


def test_a_model_of_a_file_runs_and_is_free_in_a_specification(path: Path) -> None:
    name = f"{path}:MINE"
    model = models()[name]
    assert name in models()
    spec = read_spec({"model": name, "parameters": {"a": {"start": "12 kPa"}, "b": "free"}})
    assert spec.variables(model.info).symbols == ("a", "b")
    time = np.linspace(0.0, 1.0, 6)
    run = Experiment("cutometer", time, {"pressure": -1e4 * time}, {"mesh": 0.5, "steps": 0.5})
    assert model.simulate(run, {}, ["a"]).channels["apex_height"][-1] > 1e-5


@pytest.mark.parametrize(
    ("text", "name", "words"),
    [
        (None, "MINE", "no such file"),
        ("x = (", "MINE", ":1: does not load: SyntaxError"),
        ("x = 1\ny = x / 0\n", "MINE", ":2: does not load: ZeroDivisionError"),
        ("import no_such_package_of_mine\n", "MINE", ":1: does not load: ModuleNotFoundError"),
        ("raise SystemExit(3)\n", "MINE", ":1: does not load: SystemExit"),
        (FILE, "OTHER", "has no 'OTHER'; its models are MINE"),
        (FILE, "NUMBER", "NUMBER is a int, not a model"),
    ],
)
def test_a_bad_file_is_named_in_one_error(tmp_path: Path, text: str | None, name: str, words: str) -> None:
    file = tmp_path / "bad.py"
    if text is not None:
        file.write_text(text)
    with pytest.raises(UserModelError) as caught:
        models()[f"{file}:{name}"]
    assert words in str(caught.value)
    assert str(caught.value).startswith(str(file))


def test_an_installed_package_adds_models_and_a_broken_one_says_so(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(path.parent)
    found = {
        "suction_mine": EntryPoint("suction_mine", "mine:MINE", users.GROUP),
        "broken": EntryPoint("broken", "no_such_package_of_mine:X", users.GROUP),
    }
    monkeypatch.setattr(users, "installed", lambda: found)
    users.from_package.cache_clear()
    assert {"suction_mine", "broken", "suction_yeoh_qlv"} <= set(models())
    assert models()["suction_mine"].info.name == "suction_mine"
    with pytest.raises(UserModelError, match=r"model broken \(no_such_package_of_mine:X\) does not load"):
        models()["broken"]
    users.from_package.cache_clear()
