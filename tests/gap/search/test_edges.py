"""The beginning and the end of an event are found where a fit alone stays at the edges that it began with."""

from __future__ import annotations

import numpy as np
import pytest

from gap.inference.hypothesis import to_unit
from gap.inference.least_squares import fit
from gap.search.edges import moved, sharpened
from sim_devices.chain import Parameter
from sim_devices.effects.any_sensor import LATER
from sim_devices.effects.build import MOMENT, for_a_while, shape
from sim_devices.stages import laws
from tests.gap.conftest import LinearProblem, candidate

TRUE = {"a": 6.0, "moment": 20.33, "duration": 0.86}


def changed(values) -> np.ndarray:
    """An offset for a while of a signal that answers at once, in bins of .1 s that begin 20.3, 20.4 … s: between the
    edges of a bin nothing tells them apart."""
    time = np.arange(0.0, 60.0, 0.02)
    signal = values["a"] * laws.spell(time, values["moment"], values["duration"])
    return signal.reshape(-1, 5).mean(axis=1)


@pytest.mark.parametrize("off", [{"moment": 20.0}, {"duration": 1.25}, {"moment": 20.65, "duration": 0.6}])
def test_edges_are_found_from_some_tenths_of_a_second_away(off: dict[str, float]) -> None:
    y = 3.0 + changed(TRUE) + 0.1 * np.random.default_rng(0).normal(size=600)
    problem = LinearProblem(y / 0.1, np.full((600, 1), 10.0), {"event": lambda v: changed(v) / 0.1})
    event = candidate("event", Parameter("a", "1", -10.0, 10.0), *for_a_while())
    unit = np.array([to_unit(p, (TRUE | off)[p.name]) for p in event.parameters])
    found = sharpened(problem, fit(problem, (event,), unit))
    values = event.values(found.unit)
    assert values["moment"] == pytest.approx(TRUE["moment"], abs=0.01)
    assert values["duration"] == pytest.approx(TRUE["duration"], abs=0.02)
    assert found.chi2 < 1.2 * 600


def stairs(band: float) -> np.ndarray:
    """The answer to a rising command of a valve that follows it, wholly, once it is more than ``band`` off: for most
    thresholds the answer is the same as for the next one."""
    command, held, answer = np.repeat([0.0, 3.0, 7.0, 15.0, 18.0, 30.0, 31.0, 44.0], 50), 0.0, []
    for wanted in command:
        held = wanted if abs(wanted - held) > band else held
        answer.append(held)
    return np.asarray(answer)


def test_a_threshold_is_found_where_no_derivative_leads() -> None:
    y = stairs(10.0) + 0.1 * np.random.default_rng(0).normal(size=400)
    problem = LinearProblem(y / 0.1, np.full((400, 1), 10.0), {"valve": lambda v: stairs(v["band"]) / 0.1})
    valve = candidate("valve", Parameter("band", "1", 0.1, 40.0, 0.0, 1.0, "log"))
    at = fit(problem, (valve,), np.array([to_unit(valve.parameters[0], 14.5)]))
    found = sharpened(problem, at)
    assert at.chi2 > 5 * 400
    assert found.chi2 < 1.2 * 400


@pytest.mark.parametrize("off", [0.7, 1.2])
def test_what_happens_after_each_start_is_found_from_some_tenths_of_a_second_away(off: float) -> None:
    time, marks = np.arange(0.0, 60.0, 0.1), (0.0, 31.0)

    def jumped(v) -> np.ndarray:
        return laws.jump_each_time(time, np.zeros_like(time), v["a"], v["later"], *marks) / 0.1

    y = 30.0 + jumped({"a": 4.0, "later": 9.13}) + np.random.default_rng(0).normal(size=len(time))
    problem = LinearProblem(y, np.full((len(time), 1), 10.0), {"jump": jumped})
    jump = candidate("jump", Parameter("a", "1", -10.0, 10.0), LATER)
    unit = np.array([to_unit(p, {"a": 4.0, "later": 9.13 - off}[p.name]) for p in jump.parameters])
    assert jump.values(sharpened(problem, fit(problem, (jump,), unit)).unit)["later"] == pytest.approx(9.13, abs=0.03)


def test_samples_that_are_lost_elsewhere_are_found_by_what_the_fit_leaves() -> None:
    """A burst of .1 s, 4 s beside where tissue fitted without it showed one, was told a growing desynchronisation."""
    time, rng = np.arange(600.0), np.random.default_rng(0)

    def waves(shift: np.ndarray | float) -> np.ndarray:
        return (np.sin(0.13 * (time + shift)) + np.sin(0.061 * (time + shift))) / 0.02

    def change(v) -> np.ndarray:
        return waves(np.where(time > v["moment"], v["lost"], 0.0)) - waves(0.0)

    y = change({"lost": 1.0, "moment": 336.0}) + rng.normal(size=len(time))
    tissue = np.column_stack([np.sin(0.13 * time), np.cos(0.13 * time)]) / 0.02
    problem = LinearProblem(y, tissue, {"burst": change}, np.full(2, 0.5))
    burst = candidate("burst", Parameter("lost", "s", 0.02, 30.0, 0.0, 2.0, "log"), shape(*MOMENT))
    unit = np.array([to_unit(p, {"lost": 0.6, "moment": 180.0}[p.name]) for p in burst.parameters])
    begun = fit(problem, (burst,), unit)
    found = moved(problem, begun)
    assert begun.chi2 > 2 * len(time)
    assert found.chi2 < 1.2 * len(time)
    assert burst.values(found.unit)["lost"] == pytest.approx(1.0, rel=0.02)
    assert burst.values(found.unit)["moment"] == pytest.approx(336.0, abs=3.0)
