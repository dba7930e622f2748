"""Nominal models of the benchmark's rigs, each written as its owner would from docs/gap.md: without the hidden effect.

Used as ``--model benchmarks/rigs/models.py:Name``. Units are those of the recordings (SI).
"""

# ruff: noqa: RUF012  (a user's model is plain Python)
from __future__ import annotations

import numpy as np
from numba import njit
from scipy.linalg import expm
from scipy.signal import butter, filtfilt, lfilter

from sim_devices.chain import Parameter


def log(name: str, unit: str, low: float, high: float) -> Parameter:
    """A positive parameter known within a range; its default is the middle of the logarithms."""
    return Parameter(name, unit, low, high, None, float(np.sqrt(low * high)), "log")


def lin(name: str, unit: str, half: float, centre: float = 0.0) -> Parameter:
    """A parameter known to ``centre`` ± ``half``."""
    return Parameter(name, unit, centre - half, centre + half, None, centre)


def first_order(values, dt, tau, start):
    """A lag of time constant ``tau`` s, exact for values that run linearly between samples."""
    a = np.exp(-dt / tau)
    late = 1 - (1 - a) * tau / dt
    early = 1 - a - late
    driven = late * values
    driven[1:] += early * values[:-1]
    driven[0] = start
    return lfilter([1], [1, -a], driven)


def transition(matrix, inputs, dt):
    """Exact step of ``x' = A x + B u`` with ``u`` linear between samples: x+ = F x + G0 u + G1 u+."""
    n, m = inputs.shape
    whole = np.zeros((n + 2 * m, n + 2 * m))
    whole[:n, :n], whole[:n, n : n + m] = matrix * dt, inputs * dt
    whole[n : n + m, n + m :] = np.eye(m)
    e = expm(whole)
    late = e[:n, n + m :]
    return e[:n, :n], e[:n, n : n + m] - late, late


@njit
def _run(f, g0, g1, u, x, v):
    out = np.empty(u.size)
    out[0] = x
    for i in range(1, u.size):
        x, v = (
            f[0, 0] * x + f[0, 1] * v + g0[0] * u[i - 1] + g1[0] * u[i],
            f[1, 0] * x + f[1, 1] * v + g0[1] * u[i - 1] + g1[1] * u[i],
        )
        out[i] = x
    return out


def second_order(values, dt, natural, damping, start=0.0, speed=0.0):
    """An oscillator of unit gain, ``natural`` rad/s, driven by ``values``."""
    a = np.array([[0.0, 1.0], [-(natural**2), -2 * damping * natural]])
    f, g0, g1 = transition(a, np.array([[0.0], [natural**2]]), dt)
    return _run(f, g0[:, 0], g1[:, 0], np.ascontiguousarray(values), start, speed)


def smooth(time, values, cut_off):
    """Zero-phase low-pass at ``cut_off`` Hz."""
    return filtfilt(*butter(4, cut_off * 2 * (time[1] - time[0])), values)


# --- drives: inverse models, from measured motion to force ----------------------------------------------------------
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


# --- forward models with the tap inside the loop --------------------------------------------------------------------
class Cart:
    """Motor force to speed; the resistance is tapped, so an effect adds to it."""

    name = "cart"
    channels = ("speed",)
    stages = {"resistance": "actuator", "speed": "sensor"}
    units = {"resistance": "N", "speed": "m/s"}
    parameters = (log("mass", "kg", 0.5, 20), log("drag", "N s/m", 0.5, 20), lin("start", "m/s", 0.2))

    def simulate(self, time, data, parameters, tap):
        dt, m, d = time[1] - time[0], parameters["mass"], parameters["drag"]
        push = data["force"]
        push = 0.5 * (push + np.append(push[1:], push[-1]))  # mean over the step to come
        v, x, out = parameters["start"], 0.0, np.empty(time.size)
        for i in range(time.size):
            out[i] = v
            force = self.net(push[i], d * v, v, x, tap)
            v_new = v + dt * force / (m + 0.5 * dt * d)
            x, v = x + 0.5 * dt * (v + v_new), v_new
        return {"speed": tap("speed", out)}

    def net(self, push, resistance, v, x, tap):
        return push - tap("resistance", resistance, velocity=v, position=x)


class CartNet(Cart):
    """The same, the net force being tapped."""

    name = "cart, net force tapped"
    stages = {"net_force": "actuator", "speed": "sensor"}
    units = {"net_force": "N", "speed": "m/s"}

    def net(self, push, resistance, v, x, tap):
        return tap("net_force", push - resistance, velocity=v, position=x)


class Oscillator:
    """Force to displacement of a mass on a spring; the spring's and damper's force is tapped."""

    name = "mass on a spring"
    channels = ("displacement",)
    stages = {"force": "actuator", "restoring_force": "tissue", "displacement": "sensor"}
    units = {"force": "N", "restoring_force": "N", "displacement": "m"}
    parameters = (log("mass", "kg", 0.5, 8), log("damping", "N s/m", 1, 100), log("stiffness", "N/m", 500, 50000))

    def simulate(self, time, data, parameters, tap):
        m, c, k = (parameters[p.name] for p in self.parameters)
        out = self.loop(time, tap("force", data["force"]), m, c, k, tap, "restoring_force")
        return {"displacement": tap("displacement", out)}

    @staticmethod
    def loop(time, force, m, c, k, tap, name):
        """The linear part exactly; what the tap ``name`` adds to the restoring force by Adams and Bashforth."""
        f, g0, g1 = transition(np.array([[0, 1], [-k / m, -c / m]]), np.array([[0.0], [1 / m]]), time[1] - time[0])
        (f00, f01), (f10, f11) = f.tolist()
        held0, held1 = (g0 + g1)[:, 0].tolist()
        after = np.append(force[1:], force[-1])
        push0, push1 = (g0 @ force[None] + g1 @ after[None]).tolist()
        x = v = before = 0.0
        out = np.empty(time.size)
        for i in range(time.size):
            out[i] = x
            spring = k * x + c * v
            now = tap(name, spring, velocity=v, position=x) - spring
            extra, before = 1.5 * now - 0.5 * before, now
            x, v = f00 * x + f01 * v + push0[i] - held0 * extra, f10 * x + f11 * v + push1[i] - held1 * extra
        return out


class Silverbox:
    """The electrical analogue of a mass on a spring; everything in volts."""

    name = "electronic oscillator"
    channels = ("voltage",)
    stages = {"input": "actuator", "feedback": "tissue", "voltage": "sensor"}
    units = {"input": "V", "feedback": "V", "voltage": "V"}
    parameters = (log("natural", "rad/s", 200, 800), log("damping", "1", 0.01, 0.4), log("gain", "1", 0.2, 5))

    def simulate(self, time, data, parameters, tap):
        w = parameters["natural"]
        drive = parameters["gain"] * tap("input", data["input"])
        out = Oscillator.loop(time, drive, 1 / w**2, 2 * parameters["damping"] / w, 1.0, tap, "feedback")
        return {"voltage": tap("voltage", out)}


class Tank:
    """A pump fills a tank that empties through an outlet; the level is tapped step by step."""

    name = "tank"
    channels = ("level",)
    stages = {"pump": "actuator", "tank": "tissue", "level": "sensor"}
    units = {"pump": "V", "tank": "m", "level": "m"}
    parameters = (
        log("gain", "m/(V s)", 5e-4, 2e-2),
        log("outlet", "m^0.5/s", 2e-3, 0.1),
        lin("start", "m", 0.2, 0.25),
    )

    def simulate(self, time, data, parameters, tap):
        dt = time[1] - time[0]
        inflow = parameters["gain"] * tap("pump", data["pump"])
        inflow = 0.5 * (inflow + np.append(inflow[1:], inflow[-1]))
        h, out = parameters["start"], np.empty(time.size)
        for i in range(time.size):
            h = float(tap("tank", h))
            out[i] = h
            for _ in range(2):
                h = max(h + dt / 2 * (inflow[i] - parameters["outlet"] * max(h, 0.0) ** 0.5), 0.0)
        return {"level": tap("level", out)}


# --- forward models on whole series ---------------------------------------------------------------------------------
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


# --- static models --------------------------------------------------------------------------------------------------
class Static:
    """Base: output = gain x input + zero, both ends tapped."""

    source, target = "input", "output"
    middle = "actuator"

    def __init__(self) -> None:
        self.channels = (self.target,)
        self.stages = {self.source: self.middle, self.target: "sensor"}

    def simulate(self, time, data, parameters, tap):
        x = data[self.source]
        v = np.gradient(x, time)
        y = parameters["gain"] * tap(self.source, x, velocity=v) + parameters["zero"]
        return {self.target: tap(self.target, y, velocity=v, position=x)}


class Piezo(Static):
    name = "piezo stack"
    source, target = "voltage", "displacement"
    units = {"voltage": "V", "displacement": "m"}
    parameters = (log("gain", "m/V", 5e-8, 5e-7), lin("zero", "m", 5e-6))


class Magnet(Static):
    name = "magnetic actuator"
    source, target = "current", "force"
    units = {"current": "A", "force": "N"}
    parameters = (log("gain", "N/A", 1, 100), lin("zero", "N", 5))


class Bearing(Static):
    """Lead-rubber bearing: stiffness and viscous damping."""

    name = "isolator bearing"
    source, target = "shear", "force"
    middle = "tissue"
    units = {"shear": "m", "force": "N"}
    parameters = (log("stiffness", "N/m", 1e5, 1e7), log("damping", "N s/m", 1e3, 1e6), lin("zero", "N", 1e3))

    def simulate(self, time, data, parameters, tap):
        x = data["shear"]
        v = np.gradient(x, time)
        y = parameters["stiffness"] * x + parameters["damping"] * v
        y = tap("shear", y, velocity=v, position=x)
        return {"force": tap("force", y + parameters["zero"])}


class LoadCell(Static):
    name = "load cell"
    source, target = "load", "bridge"
    middle = "interface"
    units = {"load": "N", "bridge": "V"}
    parameters = (log("gain", "V/N", 1e-5, 1e-3), lin("zero", "V", 1e-3))


class Polymer:
    """Stress to strain of a bar, elastic."""

    name = "polymer bar"
    channels = ("strain",)
    stages = {"elastic": "tissue", "strain": "sensor"}
    units = {"elastic": "1", "strain": "1"}
    parameters = (log("modulus", "Pa", 1e8, 1e10), lin("zero", "1", 1e-4))

    def simulate(self, time, data, parameters, tap):
        strain = tap("elastic", data["stress"] / parameters["modulus"], velocity=np.gradient(data["stress"], time))
        return {"strain": tap("strain", strain + parameters["zero"])}


class Rubber:
    """Stretch to stress, neo-Hooke with a viscous part."""

    name = "rubber strip"
    channels = ("stress",)
    stages = {"rubber": "tissue", "stress": "sensor"}
    units = {"rubber": "Pa", "stress": "Pa"}
    parameters = (log("modulus", "Pa", 1e5, 1e7), log("viscosity", "Pa s", 1e3, 1e6), lin("zero", "Pa", 5e3))

    def simulate(self, time, data, parameters, tap):
        stretch = data["stretch"]
        v = np.gradient(stretch, time)
        elastic = parameters["modulus"] * (stretch - stretch**-2)
        stress = tap("rubber", elastic + parameters["viscosity"] * v, velocity=v, position=stretch - 1)
        return {"stress": tap("stress", stress + parameters["zero"])}


class Tissue:
    """Indentation to force of soft tissue, exponential."""

    name = "indented tissue"
    channels = ("force",)
    stages = {"tissue": "tissue", "force": "sensor"}
    units = {"tissue": "N", "force": "N"}
    parameters = (log("stiffness", "N/m", 20, 2000), log("stiffening", "1/m", 30, 600), lin("zero", "N", 0.02))

    def simulate(self, time, data, parameters, tap):
        depth = data["depth"]
        b = parameters["stiffening"]
        force = parameters["stiffness"] / b * np.expm1(b * depth)
        force = tap("tissue", force, velocity=np.gradient(depth, time), position=depth)
        return {"force": tap("force", force + parameters["zero"])}


class TwoAxis:
    """A two-axis force sensor against a reference."""

    name = "two-axis force sensor"
    channels = ("signal_x", "signal_y")
    stages = {"x": "sensor", "y": "sensor"}
    units = {"x": "V", "y": "V"}
    parameters = (log("gain_x", "V/N", 0.01, 1), log("gain_y", "V/N", 0.01, 1), lin("zero_x", "V", 0.1),
                  lin("zero_y", "V", 0.1))  # fmt: skip

    def simulate(self, time, data, parameters, tap):
        x, y = data["force_x"], data["force_y"]
        return {
            "signal_x": tap("x", parameters["gain_x"] * x + parameters["zero_x"], other=y),
            "signal_y": tap("y", parameters["gain_y"] * y + parameters["zero_y"], other=x),
        }


class Thermocouple:
    """Oven temperature by a reference thermometer to the thermocouple's reading, without a lag of its own."""

    name = "thermocouple"
    channels = ("reading",)
    stages = {"junction": "sensor", "reading": "processing"}
    units = {"junction": "K", "reading": "K"}
    parameters = (lin("gain", "1", 0.03, 1.0), lin("zero", "K", 3))

    def simulate(self, time, data, parameters, tap):
        junction = tap("junction", data["reference"] - 300)
        return {"reading": tap("reading", 300 + parameters["gain"] * junction + parameters["zero"])}


class Encoder:
    """Stage position by laser to the reading of the stage's own encoder."""

    name = "stage with encoder"
    channels = ("encoder",)
    stages = {"stage": "interface", "encoder": "sensor"}
    units = {"stage": "m", "encoder": "m"}
    parameters = (lin("scale", "1", 0.01, 1.0), lin("zero", "m", 1e-3))

    def simulate(self, time, data, parameters, tap):
        x = data["laser"]
        y = parameters["scale"] * tap("stage", x, velocity=np.gradient(x, time)) + parameters["zero"]
        return {"encoder": tap("encoder", y)}


class Balance:
    """A beam on two calibrated cells under a travelling weight: nothing but the zeros and the weight is free."""

    name = "beam on two cells"
    channels = ("left", "right")
    stages = {"left": "sensor", "right": "sensor"}
    units = {"left": "N", "right": "N"}
    parameters = (log("weight", "N", 2, 200), lin("zero_left", "N", 2), lin("zero_right", "N", 2))

    def simulate(self, time, data, parameters, tap):
        share = data["place"]
        return {
            "left": tap("left", parameters["weight"] * (1 - share) + parameters["zero_left"]),
            "right": tap("right", parameters["weight"] * share + parameters["zero_right"]),
        }


class Circuit:
    """RC low-pass."""

    name = "RC circuit"
    channels = ("output",)
    stages = {"input": "actuator", "output": "sensor"}
    units = {"input": "V", "output": "V"}
    parameters = (lin("gain", "1", 0.1, 1.0), log("tau", "s", 1e-3, 0.1), lin("zero", "V", 0.2), lin("start", "V", 3))

    def simulate(self, time, data, parameters, tap):
        drive = parameters["gain"] * tap("input", data["input"])
        y = first_order(drive, time[1] - time[0], parameters["tau"], parameters["start"])
        return {"output": tap("output", y + parameters["zero"])}
