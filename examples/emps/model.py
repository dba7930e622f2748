"""A servo drive as a user would write it, without dry friction.

Motor force = mass x acceleration + viscous drag x velocity + offset.

    python examples/emps/make_bundle.py -o out/emps
    acquire gap diagnose out/emps/record out/emps/pulses --model examples/emps/model.py:Servo -o out/emps/gap

The model is an *inverse* one: it reads the measured position and predicts the force. Differentiating a measured
position amplifies its noise, so everything passes one and the same zero-phase low-pass filter, prediction and data
alike (parallel filtering, M. Gautier 1997).
"""

from __future__ import annotations

import numpy as np
from scipy.signal import butter, filtfilt

from sim_devices.chain import Parameter

CUT_OFF = 50.0  # Hz; the motion has nothing above


class Servo:
    """The carriage of the EMPS benchmark."""

    name = "servo drive"
    channels = ("motor_force",)
    stages = {"drive_force": "actuator", "motor_force": "sensor"}
    units = {"drive_force": "N", "motor_force": "N"}
    parameters = (
        Parameter("mass", "kg", 10, 1000, None, 100.0, "log", "moving mass"),
        Parameter("drag", "N s/m", 10, 2000, None, 200.0, "log", "viscous drag"),
        Parameter("offset", "N", -50, 50, None, 0.0, "linear", "offset of the amplifier"),
    )

    def observe(self, time, data):
        return {"motor_force": self._filtered(time, data["motor_force"])}

    def simulate(self, time, data, parameters, tap):
        dt = time[1] - time[0]
        position = self._filtered(time, data["position"])
        velocity = np.gradient(position, dt)
        acceleration = np.gradient(velocity, dt)
        force = parameters["mass"] * acceleration + parameters["drag"] * velocity + parameters["offset"]
        force = self._filtered(time, tap("drive_force", force, velocity=velocity, position=position))
        return {"motor_force": tap("motor_force", force)}

    @staticmethod
    def _filtered(time, values):
        return filtfilt(*butter(4, CUT_OFF * 2 * (time[1] - time[0])), values)
