"""Forward models with a tap inside the loop: asked at every step of the integration."""

from __future__ import annotations

import numpy as np

from benchmarks.rigs.nominal.dynamics import lin, log, transition


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
