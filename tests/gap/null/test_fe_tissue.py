"""Finite-element tissue in the diagnosis: what the surrogate promises, and what is said where a solver is missing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from acquire.plugins import Plugin
from gap.design.simulated import step_hold, suction_session, triangle
from gap.effects.load import library
from gap.inference.least_squares import fit
from gap.null import fe_solver
from gap.null.fe_law import FREE, creep, moduli, moduli_slopes
from gap.null.fe_solver import FeModel, fe_model
from gap.null.fe_tissue import FeHeightBlock
from gap.null.groups import GroupedSession
from gap.null.suction import suction_problems
from gap.null.suction_pressure import PressureBlock
from sim_devices.stages.kernels import evaluate, prony


class Spring:
    """A closed-form skin with a solver's interface: h = a s/G (1 + s c20/G²)^-½, s the suction crept."""

    info = SimpleNamespace(
        problem="suction", symbols=(*FREE, "friction", "spring_force"), channels=("apex_height",),
        defaults={"G": 2e4},
    )  # fmt: skip

    def simulate(self, experiment: Any, parameters: Mapping[str, float], sensitivities: Sequence[str] = ()) -> Any:
        height = self._height(experiment, parameters)
        slopes = []
        for symbol in sensitivities:
            step = 1e-5 * max(abs(parameters[symbol]), 1e-3)
            up, down = ({**parameters, symbol: parameters[symbol] + s * step} for s in (1, -1))
            slopes.append((self._height(experiment, up) - self._height(experiment, down)) / (2 * step))
        columns = np.column_stack(slopes) if slopes else None
        return SimpleNamespace(channels={"apex_height": height}, sensitivities={"apex_height": columns})

    @staticmethod
    def _height(experiment: Any, p: Mapping[str, float]) -> np.ndarray:
        if p["G"] <= 0:
            raise RuntimeError("a modulus must be positive")
        memory = creep(np.array([p[f"g{i}"] for i in (1, 2, 3)]), np.array([p[f"tau{i}"] for i in (1, 2, 3)]))
        load = -evaluate(prony, experiment.time, experiment.drive["pressure"], *memory) / p["G"]
        return np.asarray(2e-4 * load / np.sqrt(1.0 + load * (p["c20"] + 0.1 * p["c30"]) / p["G"]))


def test_creep_undoes_relaxation() -> None:
    time = np.linspace(0.0, 60.0, 6001)
    load = np.interp(time, [0, 1, 20, 21, 60], [0, 3.0, 3.0, 0.5, 2.0])
    shares, times = np.array([0.2, 0.15, 0.3]), np.array([0.3, 3.0, 30.0])
    crept = evaluate(prony, time, load, *creep(shares, times))
    relaxed = evaluate(prony, time, crept, 1.0, *(x for g, t in zip(-shares, times, strict=True) for x in (g, t)))
    np.testing.assert_allclose(relaxed, load, atol=2e-3)


def test_relaxing_shares_stay_below_one() -> None:
    law = moduli(np.array([0.0, 0, 0, 3.0, 3.0, 3.0, 0, 0, 0]), 1e4)
    assert 0.9 < sum(law[f"g{i}"] for i in (1, 2, 3)) < 1.0


def test_slopes_of_the_moduli() -> None:
    x = np.array([0.1, -0.2, 0.3, 0.2, -0.1, 0.4, 0.1, -0.3, 0.2])
    step = 1e-4 * np.arange(1, 10)
    change = [moduli(x + step, 3e4)[s] - moduli(x - step, 3e4)[s] for s in FREE]
    np.testing.assert_allclose(moduli_slopes(x, 3e4) @ (2 * step), change, rtol=1e-4)


@pytest.fixture(scope="module")
def block() -> FeHeightBlock:
    legs = [step_hold(-30e3, 6.0, 4.0), step_hold(-15e3, 6.0, 4.0), triangle(-30e3, 4.0, 1, 3.0)]
    recordings = suction_session("cutometer", np.random.default_rng(3), legs=legs, pause=5.0)
    session = GroupedSession(recordings, ("pressure",))
    effects = library("cutometer")
    return FeHeightBlock(session, effects, PressureBlock(session, effects), FeModel("spring", Spring()))


def test_a_known_law_is_followed_exactly(block: FeHeightBlock) -> None:
    fitted = fit(block)
    assert fitted.chi2 / len(fitted.residual) < 1.5
    assert block.surrogate_error(fitted) < 0.3
    assert block.model.solves > 2


def test_jacobian_agrees_with_differences(block: FeHeightBlock) -> None:
    c = block.start()
    here = block.evaluate(c, {})
    for k in (0, 1, 4):
        moved = c.copy()
        moved[k] += 1e-2
        there = block.evaluate(moved, {}, want_jacobian=False).residual
        change = here.residual - there
        expected = 1e-2 * here.jacobian[:, k]
        assert np.linalg.norm(change - expected) < 0.05 * np.linalg.norm(expected)


def test_a_model_of_another_kind_is_refused() -> None:
    recordings = suction_session("cutometer", np.random.default_rng(3), legs=[step_hold(-30e3, 3.0, 2.0)])
    other = SimpleNamespace(info=SimpleNamespace(problem="sheet", symbols=("mu1",)))

    def height(session: Any, effects: Any, pressure: Any) -> FeHeightBlock:
        return FeHeightBlock(session, effects, pressure, FeModel("sheet_ogden", other))

    with pytest.raises(ValueError, match="sheet_ogden"):
        suction_problems(recordings, library("cutometer"), height)


def test_no_plugin_is_said_plainly(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fe_solver, "plugins", lambda group: {})
    with pytest.raises(ValueError, match="needs a solver plug-in"):
        fe_model("suction_yeoh_qlv")


def test_what_there_is_and_what_is_broken_is_listed(monkeypatch: pytest.MonkeyPatch) -> None:
    good = Plugin("acquire.solvers", "good", "good:S", SimpleNamespace(models=lambda: {"spring": Spring()}))
    bad = Plugin("acquire.solvers", "bad", "bad:S", error="ImportError: no scipy")
    monkeypatch.setattr(fe_solver, "plugins", lambda group: {"good": good, "bad": bad})
    assert fe_model("spring").problem == "suction"
    with pytest.raises(ValueError, match=r"no finite-element model 'x'; there are spring; bad:S does not load: Import"):
        fe_model("x")


def test_a_solve_that_fails_says_which_model() -> None:
    run = fe_solver.Experiment("cutometer", np.arange(3.0), {"pressure": np.zeros(3)})
    with pytest.raises(ValueError, match="finite elements spring: a modulus"):
        FeModel("spring", Spring()).simulate(run, {"G": -1.0})
