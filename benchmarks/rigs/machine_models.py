"""Nominal models of the machines in `worlds.machines`, as `models` has those of the other rigs: linear, imperfect,
without the hidden effect.

Used as ``--model benchmarks/rigs/machine_models.py:Name``.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

from benchmarks.rigs.nominal.drives import Cylinder, Inverse
from benchmarks.rigs.nominal.dynamics import first_order, lin, log, second_order


class GearedServo:
    """Command to angle: a second-order servo and a gear."""

    name = "geared servo"
    channels = ("angle",)
    stages = {"command": "actuator", "gear": "interface", "angle": "sensor"}
    units = {"command": "1", "gear": "1", "angle": "1"}
    parameters = (log("natural", "rad/s", 5, 80), log("damping", "1", 0.3, 1.5), lin("zero", "1", 0.05))

    def simulate(self, time, data, parameters, tap):
        command = tap("command", data["command"])
        dt = time[1] - time[0]
        motor = second_order(command, dt, parameters["natural"], parameters["damping"], command[0])
        load = tap("gear", motor, velocity=np.gradient(motor, time), position=motor)
        return {"angle": tap("angle", load + parameters["zero"])}


class Loggers:
    """Input on one logger, output of a first-order circuit on another."""

    name = "two loggers"
    channels = ("output",)
    stages = {"input": "timing", "output": "timing"}
    units = {"input": "V", "output": "V"}
    parameters = (log("gain", "1", 0.2, 5), log("tau", "s", 0.02, 0.4), lin("zero", "V", 0.05))

    def simulate(self, time, data, parameters, tap):
        drive = parameters["gain"] * tap("input", data["input"])
        y = first_order(drive, time[1] - time[0], parameters["tau"], drive[0])
        return {"output": tap("output", y + parameters["zero"])}


class Rack(Cylinder):
    name = "steering rack"


class Damper(Inverse):
    """Force of a damper by the motion of the test bench."""

    name = "hydraulic damper"
    parameters = (log("drag", "N s/m", 100, 5000), log("stiffness", "N/m", 100, 10000), lin("preload", "N", 200))

    def law(self, p, x, v, a):
        return p["drag"] * v + p["stiffness"] * x + p["preload"]


class Propeller:
    """Throttle to thrust with the square of the speed; the motor follows at once."""

    name = "propeller"
    channels = ("thrust",)
    stages = {"throttle": "actuator", "thrust": "sensor"}
    units = {"throttle": "1", "thrust": "N"}
    parameters = (log("gain", "N", 1, 50), lin("zero", "N", 1))

    def simulate(self, time, data, parameters, tap):
        speed = tap("throttle", data["throttle"])
        return {"thrust": tap("thrust", parameters["gain"] * speed * np.abs(speed) + parameters["zero"])}


class Battery:
    """Current to terminal voltage: a resistance and a charge that falls."""

    name = "battery cell"
    channels = ("voltage",)
    stages = {"resistance": "actuator", "voltage": "sensor"}
    units = {"resistance": "V", "voltage": "V"}
    parameters = (log("resistance", "Ohm", 0.003, 0.2), log("slope", "V/(A s)", 1e-5, 5e-4), lin("rest", "V", 0.2, 3.7))

    def simulate(self, time, data, parameters, tap):
        current = data["current"]
        charge = np.concatenate([[0.0], np.cumsum(0.5 * (current[1:] + current[:-1]) * np.diff(time))])
        fall = tap("resistance", parameters["resistance"] * current)
        return {"voltage": tap("voltage", parameters["rest"] - fall - parameters["slope"] * charge)}


class Swinging:
    """A body let go: the restoring term is the subclass's, the resistance is tapped step by step."""

    def simulate(self, time, data, parameters, tap):
        dt, w = time[1] - time[0], parameters["natural"]
        seen = data[self.channels[0]]
        x, v, out = seen[0] - parameters["zero"], parameters["speed"], np.empty(time.size)
        drag = 2 * parameters["damping"] * w
        parts = 2
        h = dt / parts
        for i in range(time.size):
            out[i] = x
            for _ in range(parts):
                v_half = v - 0.5 * h * self.pull(w, x, v, drag, tap)
                x = x + h * v_half
                v = v_half - 0.5 * h * self.pull(w, x, v_half, drag, tap)
        return {self.channels[0]: tap(self.channels[0], out + parameters["zero"])}


class Swing(Swinging):
    name = "pendulum let go"
    channels = ("angle",)
    stages = {"resistance": "actuator", "angle": "sensor"}
    units = {"resistance": "1/s^2", "angle": "1"}
    parameters = (log("natural", "rad/s", 2, 10), log("damping", "1", 1e-3, 0.1), lin("speed", "1/s", 0.2),
                  lin("zero", "1", 0.02))  # fmt: skip

    def pull(self, w, x, v, drag, tap):
        return w**2 * np.sin(x) + tap("resistance", drag * v, velocity=v, position=x)


class Plucked(Swinging):
    name = "mass plucked"
    channels = ("position",)
    stages = {"resistance": "actuator", "position": "sensor"}
    units = {"resistance": "m/s^2", "position": "m"}
    parameters = (log("natural", "rad/s", 10, 120), log("damping", "1", 3e-3, 0.1), lin("speed", "m/s", 0.05),
                  lin("zero", "m", 2e-4))  # fmt: skip

    def pull(self, w, x, v, drag, tap):
        return tap("resistance", w**2 * x + drag * v, velocity=v, position=x)


class FlowLoop:
    """Demand on a valve to flow."""

    name = "flow loop"
    channels = ("flow",)
    stages = {"stem": "actuator", "flow": "sensor"}
    units = {"stem": "1", "flow": "1"}
    parameters = (log("gain", "1", 0.2, 4), log("tau", "s", 0.5, 10), lin("zero", "1", 2), lin("start", "1", 30, 50))

    def simulate(self, time, data, parameters, tap):
        stem = tap("stem", data["demand"], velocity=np.gradient(data["demand"], time), position=data["demand"])
        y = first_order(parameters["gain"] * stem, time[1] - time[0], parameters["tau"], parameters["start"])
        return {"flow": tap("flow", y + parameters["zero"])}
