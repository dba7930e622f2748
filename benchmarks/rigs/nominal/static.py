"""Static models: gain and zero between two tapped signals."""

from __future__ import annotations

import numpy as np

from benchmarks.rigs.nominal.dynamics import first_order, lin, log


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
