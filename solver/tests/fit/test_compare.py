"""Laws compared by their evidence, against the closed form of models that are linear in their parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pytest
from recovery import Info, Recording, Series

from skinrig_solver import Cost, Experiment, ModelInfo, Parameter, Result
from skinrig_solver.fit.compare import DECISIVE, compare

pytest.importorskip("emcee")
SPAN = 4e-3  # m between a parameter's bounds
TIME = np.linspace(0.0, 1.0, 200)


@dataclass(frozen=True)
class Polynomial:
    """height = sum of p_k s^k, s the time in units of the whole run."""

    info: ModelInfo

    def simulate(
        self, experiment: Experiment, parameters: Mapping[str, float], sensitivities: Sequence[str] = ()
    ) -> Result:
        p, s = self.info.complete(parameters), experiment.time / experiment.time[-1]
        height = np.sum([p[name] * s ** int(name[1:]) for name in self.info.symbols], axis=0)
        slopes = [s ** int(name[1:]) for name in sensitivities]
        wanted = {"apex_height": np.stack(slopes, axis=1)} if slopes else None
        return Result(experiment.time, {"apex_height": height}, tuple(sensitivities), wanted, Cost())


def law(name: str, *powers: int) -> Polynomial:
    parameters = tuple(Parameter(f"p{k}", "m", -0.5 * SPAN, 0.5 * SPAN, 1e-4, "", "test") for k in powers)
    return Polynomial(ModelInfo(name, "suction", parameters, ("apex_height",), "a test", "test"))


KNOWN = {name: {"zero": "fixed"} for name in ("line", "parabola", "cubic", "square")}  # as the closed form has it
LINE, PARABOLA, CUBIC = law("line", 1), law("parabola", 1, 2), law("cubic", 1, 2, 3)


def suction(height: np.ndarray) -> Recording:
    streams = {"pressure": Series(TIME, -1e4 * TIME, "Pa"), "apex_height": Series(TIME, height, "m")}
    return Recording(Info("run", "cutometer"), streams)


def recorded(bend: float, noise: float = 1e-5) -> Recording:
    height = 3e-4 * TIME + bend * TIME**2 + noise * np.random.default_rng(4).standard_normal(TIME.size)
    return suction(height)


def closed(recording: Recording, model: Polynomial, sd: float) -> float:
    """Log evidence under flat priors that are wide against the errors."""
    design = np.stack([TIME ** int(s[1:]) for s in model.info.symbols], axis=1)
    height = recording.streams["apex_height"].value
    left = height - design @ np.linalg.lstsq(design, height, rcond=None)[0]
    m, information = design.shape[1], design.T @ design / sd**2
    likelihood = -0.5 * TIME.size * np.log(2 * np.pi * sd**2) - 0.5 * left @ left / sd**2
    return float(likelihood + 0.5 * (m * np.log(2 * np.pi) - np.linalg.slogdet(information)[1]) - m * np.log(SPAN))


@pytest.mark.slow
def test_a_bent_curve_speaks_for_the_parabola_by_as_much_as_the_closed_form_says() -> None:
    recording = recorded(bend=4e-5)
    found = compare([recording], [LINE, CUBIC, PARABOLA], KNOWN)
    best = found.laws[0]
    assert best.name == "parabola"
    exact = {m.info.name: closed(recording, m, found.noise[0]) for m in (LINE, PARABOLA, CUBIC)}
    for other in found.laws:
        wanted = exact["parabola"] - exact[other.name]
        assert best.log_evidence - other.log_evidence == pytest.approx(wanted, abs=0.3)
    assert exact["parabola"] - exact["line"] > DECISIVE
    assert found.as_dict()["laws"][0]["below_best"] == 0.0
    assert found.in_words().splitlines()[1].startswith("parabola")


@pytest.mark.slow
def test_words_tell_a_draw_and_a_misfit() -> None:
    wave = suction(3e-4 * TIME + 1e-4 * np.sin(9.0 * TIME))
    words = compare([wave], [LINE, law("square", 2)], KNOWN).in_words()
    assert "the data do not tell " in words
    assert "none of these laws is the right one" in words


def test_one_law_is_no_comparison() -> None:
    with pytest.raises(ValueError, match="two laws at least"):
        compare([recorded(0.0)], [LINE])
