"""A spring for models of a user's own, and a first-order lag."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from gap.rig.generic import GenericEffect
from sim_devices.chain import Parameter

TIME = np.linspace(0.0, 4.0, 801)


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


def lagging(goal: np.ndarray, step: float, tau: float, begin: float) -> np.ndarray:
    """The response to ``goal`` (n,), at every ``step`` s, within ``tau`` s from ``begin`` on."""
    x, out = begin, np.empty_like(goal)
    for k, there in enumerate(goal):
        out[k] = x
        x = there + (x - there) * np.exp(-step / tau)
    return out
