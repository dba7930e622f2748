"""Rigs whose effects are small against a signal, and show all the same."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import pytest

from gap.diagnosis import diagnose
from gap.rig import generic_laws as laws
from sim_devices.chain import Parameter
from tests.gap.rig.springs import lagging

pytestmark = pytest.mark.slow


def test_a_limit_of_a_rate_that_few_moments_meet_is_found(recording) -> None:
    """The prior ended at the rate that only a hundredth of all samples exceeds, and its last start far below that."""
    time = np.arange(0.0, 60.0, 0.02)
    command = np.select([time % 20 > 12, time % 20 > 6], [2.0, 6.0], 4.0)
    limited = laws.slew({}, time, command, {}, {"rate": 12.0})

    class Valve:
        name, channels = "valve", ("flow",)
        stages: ClassVar = {"command": "command", "flow": "sensor"}
        parameters = (Parameter("tau", "s", 0.02, 2.0, None, 0.2, "log"),)

        def simulate(self, time, data, parameters, tap):
            return {"flow": tap("flow", lagging(tap("command", data["set"]), 0.02, parameters["tau"], 4.0))}

    flow = lagging(limited, 0.02, 0.3, 4.0) + 0.02 * np.random.default_rng(0).normal(size=len(time))
    run = recording({"flow": flow}, time, {"set": (time, command)}, instrument="valve")
    diagnosis = diagnose([run], Valve(), propose_term=False)
    assert diagnosis.verdict.verdict == "effect"
    assert diagnosis.verdict.causes[0].names[0] == "slew_limit"


def test_a_dead_zone_shows_in_a_position_though_it_is_a_thousandth_of_the_speed(recording) -> None:
    time = np.arange(0.0, 40.0, 0.02)
    spool = np.sin(0.9 * time) + 0.4 * np.sin(2.3 * time)

    class Cylinder:
        name, channels = "cylinder", ("position",)
        stages: ClassVar = {"spool": "actuator", "position": "sensor"}
        parameters = (Parameter("gain", "m/s", 0.02, 2.0, None, 0.2, "log"),)

        def simulate(self, time, data, parameters, tap):
            speed = parameters["gain"] * tap("spool", data["valve"])
            way = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1])) * 0.02])
            return {"position": tap("position", way)}

    real = laws.dead_zone({}, time, spool, {}, {"half_width": 2e-3, "centre": 0.0})
    way = 0.2 * np.concatenate([[0.0], np.cumsum(0.5 * (real[1:] + real[:-1])) * 0.02])
    noise = 2e-5 * np.random.default_rng(1).normal(size=len(time))
    run = recording({"position": way + noise}, time, {"valve": (time, spool)}, instrument="cylinder")
    diagnosis = diagnose([run], Cylinder(), propose_term=False)
    assert diagnosis.verdict.verdict == "effect"
    assert "dead_zone" in diagnosis.verdict.causes[0].names
