"""Inverse models of drives: from the measured motion to the force that it takes."""

from __future__ import annotations

import numpy as np

from benchmarks.rigs.nominal.dynamics import lin, log, smooth


class Inverse:
    """Base of models that differentiate a measured position and filter prediction and data alike."""

    cut_off = 40.0  # Hz
    channel = "motor_force"
    unit = "N"

    def __init__(self) -> None:
        self.channels = (self.channel,)
        self.stages = {"load": "actuator", self.channel: "sensor"}
        self.units = {"load": self.unit, self.channel: self.unit}

    def observe(self, time, data):
        return {self.channel: smooth(time, data[self.channel], self.cut_off)}

    def simulate(self, time, data, parameters, tap):
        dt = time[1] - time[0]
        x = smooth(time, data["position"], self.cut_off)
        v = np.gradient(x, dt)
        force = self.law(parameters, x, v, np.gradient(v, dt))
        force = smooth(time, tap("load", force, velocity=v, position=x), self.cut_off)
        return {self.channel: tap(self.channel, force)}


class Servo(Inverse):
    name = "ball-screw servo"
    parameters = (log("mass", "kg", 5, 500), log("drag", "N s/m", 5, 500), lin("offset", "N", 20))

    def law(self, p, x, v, a):
        return p["mass"] * a + p["drag"] * v + p["offset"]


class Joint(Inverse):
    name = "robot joint"
    channel, unit = "torque", "N m"
    parameters = (
        log("inertia", "kg m^2", 0.1, 10),
        log("drag", "N m s", 0.1, 10),
        log("gravity", "N m", 1, 100),
        lin("angle", "1", 0.2),
    )

    def law(self, p, x, v, a):
        return p["inertia"] * a + p["drag"] * v + p["gravity"] * np.cos(x + p["angle"])


class JointWithFriction(Inverse):
    name = "robot joint with friction"
    channel, unit = "torque", "N m"
    parameters = (*Joint.parameters, log("friction", "N m", 0.1, 10))

    def law(self, p, x, v, a):
        return Joint.law(self, p, x, v, a) + p["friction"] * np.tanh(v / 0.05)


class Cylinder(Inverse):
    name = "pneumatic cylinder"
    channel = "pressure_force"
    cut_off = 25.0
    parameters = (log("mass", "kg", 0.5, 50), log("drag", "N s/m", 5, 500), lin("load", "N", 50))

    def law(self, p, x, v, a):
        return p["mass"] * a + p["drag"] * v + p["load"]


class Stage(Inverse):
    """A flexure stage without any damping model: stiffness and mass only."""

    name = "flexure stage"
    parameters = (log("mass", "kg", 0.1, 10), log("stiffness", "N/m", 20, 2000), lin("offset", "N", 1))

    def law(self, p, x, v, a):
        return p["mass"] * a + p["stiffness"] * x + p["offset"]


class Pendulum(Inverse):
    name = "pendulum, small angles"
    channel, unit = "torque", "N m"
    parameters = (log("inertia", "kg m^2", 0.02, 2), log("drag", "N m s", 0.01, 1), log("gravity", "N m", 0.5, 50),
                  lin("offset", "N m", 0.3))  # fmt: skip

    def law(self, p, x, v, a):
        return p["inertia"] * a + p["drag"] * v + p["gravity"] * x + p["offset"]


class Tow(Inverse):
    name = "towing carriage"
    cut_off = 8.0
    parameters = (log("mass", "kg", 5, 500), log("drag", "N s/m", 2, 200), lin("offset", "N", 10))

    law = Servo.law


class VoiceCoil:
    """Current that a motion of a sprung moving coil takes."""

    name = "voice coil"
    channels = ("current",)
    stages = {"current_needed": "actuator", "current": "sensor"}
    units = {"current_needed": "A", "current": "A"}
    parameters = (log("mass", "kg", 0.05, 0.5), log("drag", "N s/m", 0.5, 20), log("stiffness", "N/m", 50, 2000))
    force_constant = 8.0  # N/A, data sheet

    def observe(self, time, data):
        return {"current": smooth(time, data["current"], 30)}

    def simulate(self, time, data, parameters, tap):
        dt = time[1] - time[0]
        x = smooth(time, data["position"], 30)
        v = np.gradient(x, dt)
        force = parameters["mass"] * np.gradient(v, dt) + parameters["drag"] * v + parameters["stiffness"] * x
        current = tap("current_needed", force / self.force_constant, velocity=v, position=x)
        return {"current": tap("current", smooth(time, current, 30))}
