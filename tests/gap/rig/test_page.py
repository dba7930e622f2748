"""The examples of docs/rigs.md, run as they stand there, and what the page says of taps, edges and recordings."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import cont2discrete

from acquire.recording.model import Recording, RunInfo, Series
from gap.data.splits import splits_of_a_rig
from gap.rig.model import ModelError
from gap.rig.problem import RigProblem

PAGE = Path(__file__).parents[3] / "docs/rigs.md"
DT = 0.002
TIME = DT * np.arange(2000)


@pytest.fixture(scope="module")
def page() -> SimpleNamespace:
    """The names that the page's Python defines."""
    names: dict = {}
    for code in re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL):
        exec(code, names)
    return SimpleNamespace(**names)


def recorded(channels: dict[str, np.ndarray], setpoints: dict[str, tuple] | None = None, name: str = "r") -> Recording:
    return Recording(
        RunInfo(name, "rig", ""),
        {n: Series(v, TIME[: len(v)], "1") for n, v in channels.items()},
        {n: Series(np.array(v, float), np.array(t, float), "1") for n, (t, v) in (setpoints or {}).items()},
    )


def held_force(seed: int) -> np.ndarray:
    force = np.repeat(np.random.default_rng(seed).uniform(-1.0, 1.0, 40), 50)
    force[:100] = 0.0
    return force


def moved(force: np.ndarray, mass: float = 0.3, drag: float = 2.0, stiffness: float = 700.0) -> np.ndarray:
    """The exact motion under a force that is held from each sample to the next."""
    system = (
        np.array([[0.0, 1.0], [-stiffness / mass, -drag / mass]]), np.array([[0.0], [1.0 / mass]]), np.eye(2),
        np.zeros((2, 1)),
    )  # fmt: skip
    a, b, *_ = cont2discrete(system, DT)
    state, out = np.zeros(2), np.empty(len(force))
    for i, f in enumerate(force):
        out[i] = state[0]
        state = a @ state + b[:, 0] * f
    return out


def test_lags_are_exact_for_held_inputs_and_for_lines(page) -> None:
    fine = np.arange(0.0, 1.0, 1e-4)
    coarse = fine[::100]
    held = np.where(coarse < 0.3, 0.0, 2.0)
    exact = np.where(coarse < 0.3, 0.0, -2.0 * np.expm1(-(coarse - 0.3) / 0.05))
    assert page.lag_of_held(held, 0.05, 0.01, 0.0) == pytest.approx(exact, abs=1e-12)
    ramp = 3.0 * coarse
    behind = 3.0 * (coarse - 0.05) + 0.15 * np.exp(-coarse / 0.05)
    assert page.lag_of_lines(ramp, 0.05, 0.01, 0.0) == pytest.approx(behind, abs=1e-12)


def test_the_leapfrog_is_exact_to_the_square_of_its_step(page) -> None:
    force = held_force(1)
    exact = moved(force)
    given = {"mass": 0.3, "drag": 2.0, "stiffness": 700.0}

    def off(steps: int) -> float:
        stage = page.Stage()
        stage.steps = steps
        made = stage.simulate(TIME, {"force": force, "position": exact}, given, lambda name, y, **related: y)
        return float(np.max(np.abs(made["position"] - exact)) / np.ptp(exact))

    assert off(4) < 1e-3
    assert off(8) == pytest.approx(off(4) / 4.0, rel=0.05)


def test_the_models_and_the_effect_of_the_page_can_be_diagnosed(page) -> None:
    rng = np.random.default_rng(2)
    runs = []
    for seed in (3, 4):
        force = held_force(seed)
        position = moved(force) + 1e-6 * rng.standard_normal(len(force))
        runs.append(recorded({"position": position, "force": force}, name=f"r{seed}"))
    problem = RigProblem(runs, page.Stage(), [page.RIPPLE])
    keys = {c.key for c in problem.candidates}
    assert {"screw_ripple@bearing", "coulomb_friction@bearing", "breakaway@bearing", "delay@position"} <= keys
    assert "screw_ripple@position" not in keys  # that tap gives no position
    assert not problem.seen["bearing"].opposes  # a net force
    ripple = next(c for c in problem.candidates if c.key == "screw_ripple@bearing")
    at = problem.coordinates({"mass": 0.3, "drag": 2.0, "stiffness": 700.0})
    sound = problem.evaluate(at, {}, want_jacobian=False).residual
    assert np.mean(np.square(sound)) < 1.5
    acting = {ripple: {"size": 0.1, "pitch": 1e-3}}
    assert np.mean(np.square(problem.evaluate(at, acting, want_jacobian=False).residual)) > 10.0

    motion = 0.1 * np.sin(3.0 * TIME)
    servo = RigProblem(
        [recorded({"motor_force": rng.standard_normal(len(TIME)), "position": motion})], page.Servo(), [page.RIPPLE]
    )
    assert servo.seen["drive_force"].opposes  # a resistance: its motion is an input


class Spring:
    name = "spring"
    channels = ("force",)
    stages = {"factor": "actuator"}  # noqa: RUF012
    parameters = ()

    def __init__(self, edge: int = 0, short: bool = False) -> None:
        self.edge, self.short, self.seen = edge, short, []

    def observe(self, time, data):
        force = data["force"].copy()
        force[len(force) - self.edge :] = np.nan
        return {"force": force[1:] if self.short else force}

    def simulate(self, time, data, parameters, tap):
        self.seen.append(data)
        factor = tap("factor", np.full_like(time, 20.0), position=data["x"])
        return {"force": factor * data["x"]}


def spring_run(setpoints: dict | None = None, name: str = "r") -> Recording:
    x = 0.1 * np.sin(5.0 * TIME)
    return recorded(
        {"force": 20.0 * x + 1e-3 * np.random.default_rng(5).standard_normal(len(x)), "x": x}, setpoints, name
    )


def test_edges_that_are_no_number_are_not_compared_and_lengths_are() -> None:
    assert len(RigProblem([spring_run()], Spring(edge=50)).measured) == len(TIME) - 50
    with pytest.raises(ModelError, match="observe returned force of shape"):
        RigProblem([spring_run()], Spring(short=True))


def test_a_constant_with_a_position_may_depend_on_it() -> None:
    keys = {c.key for c in RigProblem([spring_run()], Spring()).candidates}
    assert "position_dependent_gain@factor" in keys
    assert not {"hysteresis@factor", "backlash@factor", "saturation@factor"} & keys


def test_set_points_are_lines_and_at_a_step_the_later_value() -> None:
    model = Spring()
    table = ([0.0, 1.0, 1.0, 2.0], [0.0, 0.0, 5.0, 7.0])
    RigProblem([spring_run({"command": table, "x": table})], model)
    data = model.seen[0]
    at = np.searchsorted(TIME, 1.0 - 1e-9)
    assert TIME[at] == pytest.approx(1.0)
    assert data["command"][at - 1] == 0.0
    assert data["command"][at] == pytest.approx(5.0, abs=0.01)
    assert data["setpoint_command"][-1] == 7.0
    assert np.ptp(data["x"]) < 1.0  # the channel has the name
    assert data["setpoint_x"][-1] == 7.0


def test_a_constant_set_point_tells_initial_conditions_apart() -> None:
    ends = [0.0, float(TIME[-1])]
    near, far = ({"release": (ends, [angle, angle])} for angle in (0.2, 0.4))
    assert splits_of_a_rig([spring_run(near), spring_run(far), spring_run(far)]) == {"waveform": {0}, "repeat": {2}}
    assert splits_of_a_rig([spring_run(near), spring_run(near)]) == {"repeat": {1}}
