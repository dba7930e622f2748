"""Effects that any rig can have, and rigs of a user's own: taps, models, and what is wrong with a model."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from gap.generic import GENERIC, GenericEffect
from gap.rig import ModelError, RigProblem, load_model
from sim_devices.chain import Parameter

TIME = np.linspace(0.0, 4.0, 801)
SIGNAL = 2.0 * np.sin(3 * TIME) + 0.5 * TIME
RELATED = {"velocity": np.gradient(SIGNAL, TIME), "position": SIGNAL, "other": np.cos(TIME)}


def acted(effect: GenericEffect, values: dict[str, float], chunks: int = 1) -> np.ndarray:
    state: dict[str, float] = {}
    parts = np.array_split(np.arange(len(TIME)), chunks)
    return np.concatenate(
        [effect.act(state, TIME[k], SIGNAL[k], {n: v[k] for n, v in RELATED.items()}, values) for k in parts]
    )


@pytest.mark.parametrize("effect", GENERIC, ids=lambda e: e.name)
def test_an_effect_without_strength_does_nothing(effect: GenericEffect) -> None:
    values = {p.name: p.default if p.null is None else p.null for p in effect.parameters}
    if effect.name in ("saturation", "lower_saturation"):
        values["limit"] = 100.0 if effect.name == "saturation" else -100.0
    if effect.name in ("low_pass", "quantisation", "slew_limit"):
        values[effect.parameters[0].name] = 1e-9 if effect.name != "slew_limit" else 1e9  # their limit, not 0
    assert acted(effect, values) == pytest.approx(SIGNAL, abs=1e-6)


# A delay and a numbered sample need what lies before the chunk: they act on whole series only.
@pytest.mark.parametrize("effect", [e for e in GENERIC if e.name != "delay"], ids=lambda e: e.name)
def test_chunks_join_without_a_seam(effect: GenericEffect) -> None:
    values = {p.name: p.default for p in effect.parameters}
    if effect.name == "slew_limit":
        values["rate"] = 1.0
    whole = acted(effect, values)
    assert acted(effect, values, chunks=7) == pytest.approx(whole, rel=1e-9, abs=1e-9)
    assert np.ptp(whole - SIGNAL) > 0 or effect.name in ("offset", "saturation", "lower_saturation")


def test_known_forms() -> None:
    named = {e.name: e for e in GENERIC}
    v = RELATED["velocity"]
    friction = acted(named["coulomb_friction"], {"level": 3.0, "sharpness": 1e-9}) - SIGNAL
    assert friction == pytest.approx(3.0 * np.sign(v))
    play = acted(named["backlash"], {"gap": 0.4})
    assert np.abs(play - SIGNAL).max() == pytest.approx(0.2)
    delayed = acted(named["delay"], {"time": 0.1})
    assert delayed[100:] == pytest.approx(np.interp(TIME[100:] - 0.1, TIME, SIGNAL))
    assert acted(named["saturation"], {"limit": 1.0}).max() == 1.0
    lag = acted(named["low_pass"], {"tau": 0.2})
    rate = np.gradient(lag, TIME)
    assert 0.2 * rate[5:-5] + lag[5:-5] == pytest.approx(SIGNAL[5:-5], abs=2e-3)


class Spring:
    """Force = stiffness · extension, with a tap on the force and one on the sensor."""

    name = "spring"
    channels = ("force",)
    stages: ClassVar = {"spring_force": "actuator", "force": "sensor"}
    units: ClassVar = {"spring_force": "N", "force": "N"}
    parameters = (Parameter("stiffness", "N/m", 1.0, 1e3, None, 30.0, "log"),)
    effects = (
        GenericEffect(
            "hum", "mains hum", "shield",
            (Parameter("size", "signal", 1e-3, 1.0, 0.0, 0.05, "log"),),
            lambda state, time, y, related, p: y + p["size"] * np.sin(2 * np.pi * 1.3 * time),
        ),
    )  # fmt: skip

    def simulate(self, time, data, parameters, tap):
        x = data["extension"]
        force = tap("spring_force", parameters["stiffness"] * x, position=x, velocity=np.gradient(x, time))
        return {"force": tap("force", force)}


@pytest.fixture
def stretched(recording):
    def make(change=lambda force, x, v: force, seed: int = 0):
        x = 0.1 * np.sin(2 * TIME) * np.exp(-0.1 * TIME)
        force = change(20.0 * x, x, np.gradient(x, TIME))
        noise = 5e-3 * np.random.default_rng(seed).normal(size=len(TIME))
        return recording({"force": force + noise, "extension": x}, TIME, instrument="spring", name=f"s{seed}")

    return make


def test_a_rig_is_its_model_plus_taps(stretched) -> None:
    problem = RigProblem([stretched()], Spring())
    keys = {c.key for c in problem.candidates}
    assert {"coulomb_friction@spring_force", "saturation@force", "hum@force"} <= keys
    assert not any(k.startswith("coulomb_friction@force") for k in keys)  # no velocity at that tap
    right = np.array([np.log(20.0 / 30.0) / problem._scale[0]])
    assert problem.parameters(right)["stiffness"] == pytest.approx(20.0)
    residual = problem.evaluate(right, {}).residual
    assert np.mean(residual**2) == pytest.approx(1.0, rel=0.15)


def test_priors_are_scaled_to_the_rig(stretched) -> None:
    problem = RigProblem([stretched()], Spring())
    level = next(c for c in problem.candidates if c.key == "coulomb_friction@spring_force").parameters[0]
    span = np.ptp(30.0 * stretched().streams["extension"].value)
    assert (level.low, level.high, level.unit) == (pytest.approx(1e-3 * span), pytest.approx(span), "N")


def write(folder: Path, text: str) -> Path:
    path = folder / "rig.py"
    path.write_text(text)
    return path


COMPLETE = """
class Rig:
    name, channels, stages, parameters = "rig", ("force",), {stages}, ()
    def simulate(self, time, data, parameters, tap):
        return {made}
"""


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
