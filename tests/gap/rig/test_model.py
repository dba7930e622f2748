"""Models of a user's own that cannot be used, fail or diverge, and the messages about them."""

from __future__ import annotations

import math
import warnings
from pathlib import Path

import numpy as np
import pytest

from gap.rig.model import ModelError, load_model
from gap.rig.problem import DIVERGED, RigProblem
from sim_devices.chain import Parameter
from tests.gap.rig.springs import Spring

COMPLETE = """
class Rig:
    name, channels, stages, parameters = "rig", ("force",), {stages}, ()
    def simulate(self, time, data, parameters, tap):
        return {made}
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "rig.py"
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x = 1", "defines no Rig"),
        ("import nothing_of_this_name", "fails on import: ModuleNotFoundError"),
        ("class Rig:\n    name = 'rig'", "lacks channels, stages, parameters, simulate"),
    ],
)
def test_a_model_that_cannot_be_used_is_named_with_its_file(tmp_path: Path, text: str, message: str) -> None:
    path = write(tmp_path, text)
    with pytest.raises(ModelError, match=message) as error:
        load_model(f"{path}:Rig")
    assert f"{path}:Rig" in str(error.value)


def test_a_model_is_given_as_file_and_name(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r"give it as file\.py:Name"):
        load_model("rig.py")
    with pytest.raises(ModelError, match="there is no file"):
        load_model(f"{tmp_path}/none.py:Rig")
    path = write(tmp_path, "class Rig:\n    pass\n\n\nclass Other(Rig):\n    pass")
    for where in (str(path), f"{path}:", f"{path}:Wrong"):
        with pytest.raises(ModelError, match=r"it defines Rig, Other$"):
            load_model(where)


def test_the_only_class_of_a_file_need_not_be_named(tmp_path: Path) -> None:
    path = write(tmp_path, "class Rig:\n    name = 'rig'")
    for where in (str(path), f"{path}:"):
        with pytest.raises(ModelError, match="lacks channels"):  # it was made
            load_model(where)


@pytest.mark.parametrize(
    ("stages", "made", "message"),
    [
        ("{}", "{'other': time}", "model rig: simulate returned no force"),
        ("{}", "{'force': tap('somewhere', time)}", "model rig: taps somewhere have no stage"),
        ("{}", "{'force': time * float('nan')}", "model rig: no sample has both"),
    ],
)
def test_what_a_model_does_wrong_is_told(tmp_path: Path, stretched, stages: str, made: str, message: str) -> None:
    path = write(tmp_path, COMPLETE.replace("{stages}", stages).replace("{made}", made))
    with pytest.raises(ModelError, match=message):
        RigProblem([stretched()], load_model(f"{path}:Rig"))


def test_a_model_that_diverges_is_a_bad_fit_and_no_crash(stretched) -> None:
    class Explosive(Spring):
        def simulate(self, time, data, parameters, tap):
            force = parameters["stiffness"] * data["extension"]
            return {"force": force if parameters["stiffness"] < 40 else np.full_like(force, np.inf)}

    problem = RigProblem([stretched()], Explosive())
    assert np.all(np.isfinite(problem.evaluate(np.array([5.0]), {}).residual))


def test_a_model_that_fails_away_from_its_defaults_is_a_bad_fit_there(stretched) -> None:
    class Rooted(Spring):
        def simulate(self, time, data, parameters, tap):
            return {"force": math.sqrt(40.0 - parameters["stiffness"]) * data["extension"]}

    problem = RigProblem([stretched()], Rooted())
    assert np.all(problem.evaluate(problem.coordinates({"stiffness": 50.0}), {}).residual == DIVERGED)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{'force': data['velocity']}", r"simulate fails: KeyError: 'velocity' \(data: force, extension\)"),
        ("{'force': time[:5]}", r"simulate returned force of shape \(5,\), not \(801,\)"),
    ],
)
def test_what_a_simulation_cannot_do_is_told_with_what_there_is(tmp_path: Path, stretched, text, message) -> None:
    path = write(tmp_path, COMPLETE.replace("{stages}", "{}").replace("{made}", text))
    with pytest.raises(ModelError, match=message):
        RigProblem([stretched()], load_model(f"{path}:Rig"))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"channels": "force"}, "channels should be a tuple of names"),
        ({"channels": ("pressure",)}, "recording s0 has no channel pressure; it has force, extension"),
        ({"stages": {"spring_force": "motor", "force": "sensor"}}, "stage 'motor'; there are timing, command"),
        ({"parameters": (Parameter("k", "N/m", 0.0, 9.0, None, 1.0, "log"),)}, "parameter k has the range 0 … 9"),
        ({"parameters": (Parameter("k", "N/m", 1.0, 9.0, None, 20.0),)}, "the default 20"),
    ],
)
def test_a_model_whose_words_make_no_sense_is_told_so(stretched, change: dict, message: str) -> None:
    with pytest.raises(ModelError, match=message):
        RigProblem([stretched()], type("Odd", (Spring,), change)())


def test_what_diverges_to_huge_numbers_stays_finite_and_silent(stretched) -> None:
    class Explosive(Spring):
        def simulate(self, time, data, parameters, tap):
            force = parameters["stiffness"] * data["extension"]
            return {"force": force * (1e250 if parameters["stiffness"] > 40 else 1.0) * np.exp(0 * force)}

    class Overflowing(Spring):
        def simulate(self, time, data, parameters, tap):
            grown = 10.0 ** (400 if parameters["stiffness"] > 40 else 1)
            return {"force": grown * data["extension"]}

    for model in (Explosive(), Overflowing()):
        problem = RigProblem([stretched()], model)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            evaluation = problem.evaluate(np.array([5.0]), {})
            beyond = problem.evaluate(np.array([1e6]), {})
        assert np.isfinite(float(evaluation.residual @ evaluation.residual))
        assert np.all(np.isfinite(evaluation.jacobian.T @ evaluation.jacobian))
        assert np.all(np.isfinite(beyond.residual))
