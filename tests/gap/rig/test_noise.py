"""The noise of a rig's channels: from the residual of its model, its counts, or as stated."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest
from scipy.signal import lfilter

from gap.diagnosis import diagnose
from gap.rig.model import ModelError
from gap.rig.problem import RigProblem
from sim_devices.chain import Parameter
from tests.gap.rig.springs import TIME, Spring, lagging


class Driven:
    """A first-order lag behind what drives it, on rows of 20 ms."""

    name, channels = "follower", ("place",)
    stages: ClassVar = {"place": "sensor"}
    parameters = (Parameter("tau", "s", 0.02, 1.0, None, 0.2, "log"),)

    def simulate(self, time, data, parameters, tap):
        return {"place": tap("place", lagging(data["drive"], time[1] - time[0], parameters["tau"], 0.0))}


def driven(recording, size: float, **more):
    rng, time = np.random.default_rng(6), 0.02 * np.arange(4000)
    drive = np.sign(rng.normal(size=800)).repeat(5)
    place = lagging(drive, 0.02, 0.1, 0.0) + size * rng.normal(size=len(time))
    made = recording({"place": place, "drive": drive}, time, instrument="follower")
    return replace(made, streams={**made.streams, "place": replace(made.streams["place"], **more)})


def test_a_broad_excitation_is_no_noise(recording) -> None:
    """Its own roughness is the signal's: a residual ten times the noise passed for noise."""
    problem = RigProblem([driven(recording, 2e-3)], Driven())
    problem.start()
    assert problem.sigma[0] == pytest.approx(2e-3, rel=0.3)


def test_stated_noise_is_taken(recording) -> None:
    told = RigProblem([driven(recording, 2e-3, noise=5e-3)], Driven())
    told.start()
    assert np.all(told.sigma == 5e-3)

    class Quiet(Driven):
        noise: ClassVar = {"place": 1e-3}

    assert np.all(RigProblem([driven(recording, 2e-3, noise=5e-3)], Quiet()).sigma == 1e-3)
    Quiet.noise = {"velocity": 1e-3}
    with pytest.raises(ModelError, match="noise of 'velocity'"):
        RigProblem([driven(recording, 2e-3)], Quiet())


def test_coarse_counts_are_the_gap_and_not_its_noise(stretched) -> None:
    rng = np.random.default_rng(3)
    smooth = stretched(lambda force, x, v: 0 * force)  # noise of 5e-3 only
    coarse = stretched(lambda force, x, v: 0.12 * np.round(force / 0.12) + 1e-3 * rng.normal(size=len(x)))
    fine = smooth.streams["force"].value
    coarse.streams["force"].value[:] -= fine  # what is left has the noise on its counts alone
    problem = RigProblem([coarse], Spring())
    assert problem.sigma[0] == pytest.approx(1e-3, rel=0.1)
    right = problem.coordinates({"stiffness": 20.0})
    step = next(c for c in problem.candidates if c.key == "quantisation@force")
    assert step.parameters[0].default == pytest.approx(0.12, rel=0.02)
    before = problem.evaluate(right, {}).residual
    after = problem.evaluate(right, {step: {"step": step.parameters[0].default}}).residual
    assert np.std(before) > 25
    assert np.mean(np.abs(after) < 3) > 0.97  # all but the samples next to an edge


def test_a_sound_rig_whose_noise_forgets_slowly_is_not_unknown(recording) -> None:
    """Half of the variance with a correlation over ten samples is missing in the high band: a gap of 1.34."""
    rng, x = np.random.default_rng(0), 0.1 * np.sin(2 * TIME) * np.exp(-0.1 * TIME)
    white, slow = rng.normal(size=(2, len(TIME)))
    noise = 5e-3 * np.sqrt(0.5) * (white + lfilter([np.sqrt(1 - 0.9**2)], [1, -0.9], slow))
    made = recording({"force": 20.0 * x + noise, "extension": x}, TIME, instrument="spring")
    said = diagnose([made], Spring(), propose_term=False)
    assert said.gap_before > 1.3
    assert said.verdict.verdict in ("undetectable", "none")
