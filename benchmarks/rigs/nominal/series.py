"""Forward models on whole series: a tap is asked once for all samples."""

from __future__ import annotations

import numpy as np
from numba import njit

from benchmarks.rigs.nominal.dynamics import first_order, lin, log, second_order


class Valve:
    """Spool voltage to the speed and thereby the position of a cylinder."""

    name = "hydraulic axis"
    channels = ("position",)
    stages = {"valve": "actuator", "position": "sensor"}
    units = {"valve": "V", "position": "m"}
    parameters = (log("speed_gain", "m/(V s)", 0.005, 0.5), lin("null", "V", 0.5), lin("start", "m", 0.1))

    def simulate(self, time, data, parameters, tap):
        speed = parameters["speed_gain"] * (tap("valve", data["command"]) - parameters["null"])
        moved = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(time))])
        return {"position": tap("position", parameters["start"] + moved, velocity=speed)}


class Motor:
    """Voltage to speed of a DC motor: first order."""

    name = "DC motor"
    channels = ("speed",)
    stages = {"voltage": "actuator", "speed": "sensor"}
    units = {"voltage": "V", "speed": "1/s"}
    parameters = (log("gain", "1/(V s)", 2, 50), log("tau", "s", 0.02, 0.5), lin("start", "1/s", 10))

    def simulate(self, time, data, parameters, tap):
        drive = parameters["gain"] * tap("voltage", data["voltage"])
        return {"speed": tap("speed", first_order(drive, time[1] - time[0], parameters["tau"], parameters["start"]))}


class Gear:
    """Angle behind a gear."""

    name = "gear train"
    channels = ("load_angle",)
    stages = {"motor_angle": "interface", "load_angle": "sensor"}
    units = {"motor_angle": "1", "load_angle": "1"}
    parameters = (lin("ratio", "1", 0.02, 0.2), lin("zero", "1", 0.1))

    def simulate(self, time, data, parameters, tap):
        angle = data["motor_angle"]
        out = parameters["ratio"] * tap("motor_angle", angle, velocity=np.gradient(angle, time)) + parameters["zero"]
        return {"load_angle": tap("load_angle", out)}


class Dryer:
    """Heater power to the temperature of the air."""

    name = "hair dryer"
    channels = ("temperature",)
    stages = {"heater": "actuator", "temperature": "sensor"}
    units = {"heater": "W", "temperature": "K"}
    parameters = (log("gain", "K/W", 0.02, 2), log("tau", "s", 0.1, 3), lin("ambient", "K", 5, 295))

    def simulate(self, time, data, parameters, tap):
        heat = np.interp(time - parameters.get("delay", 0.0), time, tap("heater", data["heater"]))
        warmer = first_order(
            parameters["gain"] * heat, time[1] - time[0], parameters["tau"], parameters["gain"] * heat[0]
        )
        return {"temperature": tap("temperature", parameters["ambient"] + warmer)}


class DryerWithDelay(Dryer):
    name = "hair dryer with its delay"
    parameters = (*Dryer.parameters, log("delay", "s", 0.05, 2))


class Actuator:
    """Command to position over a field bus; the controller makes it a second-order system."""

    name = "networked actuator"
    channels = ("position",)
    stages = {"command": "timing", "position": "sensor"}
    units = {"command": "m", "position": "m"}
    parameters = (log("natural", "rad/s", 10, 100), log("damping", "1", 0.3, 1.5), lin("offset", "m", 1e-3))

    def simulate(self, time, data, parameters, tap):
        command = tap("command", data["command"])
        y = second_order(command, time[1] - time[0], parameters["natural"], parameters["damping"], command[0])
        return {"position": tap("position", y + parameters["offset"])}


class Regulator:
    """Set-point to pressure of a clamped volume."""

    name = "clamp"
    channels = ("pressure",)
    stages = {"volume": "actuator", "pressure": "sensor"}
    units = {"volume": "Pa", "pressure": "Pa"}
    parameters = (lin("gain", "1", 0.05, 1.0), log("tau", "s", 0.02, 1.0), lin("zero", "Pa", 2e3))

    def simulate(self, time, data, parameters, tap):
        goal = parameters["gain"] * data["setpoint_pressure"]
        p = tap("volume", first_order(goal, time[1] - time[0], parameters["tau"], goal[0]))
        return {"pressure": tap("pressure", p + parameters["zero"])}


class Follower:
    """A mechanism that follows its command by a first-order lag."""

    name = "control valve"
    channels = ("opening",)
    stages = {"command": "actuator", "stem": "actuator", "opening": "sensor"}
    units = {"command": "1", "stem": "1", "opening": "1"}
    parameters = (lin("gain", "1", 0.1, 1.0), log("tau", "s", 0.02, 1.0), lin("zero", "1", 0.05))

    def simulate(self, time, data, parameters, tap):
        goal = parameters["gain"] * tap("command", data["command"])
        y = tap("stem", first_order(goal, time[1] - time[0], parameters["tau"], goal[0]))
        return {"opening": tap("opening", y + parameters["zero"])}


class Shaker:
    """Amplifier input to acceleration of a resonant structure."""

    name = "shaker"
    channels = ("response",)
    stages = {"amplifier": "actuator", "response": "sensor"}
    units = {"amplifier": "V", "response": "V"}
    parameters = (log("natural", "rad/s", 50, 500), log("damping", "1", 0.05, 0.8), log("gain", "1", 0.3, 10),
                  lin("zero", "V", 0.1))  # fmt: skip

    def simulate(self, time, data, parameters, tap):
        drive = tap("amplifier", parameters["gain"] * data["input"])
        y = second_order(drive, time[1] - time[0], parameters["natural"], parameters["damping"])
        return {"response": tap("response", y + parameters["zero"])}


class Cascade:
    """Two tanks, the lower one's level measured."""

    name = "two tanks"
    channels = ("level",)
    stages = {"pump": "actuator", "level": "sensor"}
    units = {"pump": "V", "level": "m"}
    parameters = (
        log("gain", "m/(V s)", 5e-4, 2e-2),
        log("outlet_1", "m^0.5/s", 2e-3, 0.1),
        log("outlet_2", "m^0.5/s", 2e-3, 0.1),
        lin("upper", "m", 0.1, 0.2),
        lin("lower", "m", 0.1, 0.2),
    )

    def simulate(self, time, data, parameters, tap):
        pump = tap("pump", data["pump"])
        pump = 0.5 * (pump + np.append(pump[1:], pump[-1]))
        return {"level": tap("level", _levels(pump, time[1] - time[0], *(parameters[p.name] for p in self.parameters)))}


@njit
def _levels(pump, dt, gain, outlet_1, outlet_2, upper, lower):
    out = np.empty(pump.size)
    for i in range(pump.size):
        out[i] = lower
        for _ in range(5):
            flow_1, flow_2 = outlet_1 * np.sqrt(max(upper, 0.0)), outlet_2 * np.sqrt(max(lower, 0.0))
            upper += dt / 5 * (gain * pump[i] - flow_1)
            lower += dt / 5 * (flow_1 - flow_2)
    return out
