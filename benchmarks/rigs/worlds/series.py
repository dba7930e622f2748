"""Worlds in a row, from a command to a reading: valves, motors, gears, pipes, amplifiers."""

from __future__ import annotations

import numpy as np

from benchmarks.rigs.worlds.effects import dead, late, memoryless, play
from benchmarks.rigs.worlds.tools import FINE, Array, Run, Step, World, chirp, levels, lti, multisine, ode, soft, spread


def dead_valve(rng: np.random.Generator, size: float) -> World:
    gain, start, a = spread(rng, 0.02, 0.1), rng.uniform(-0.05, 0.05), rng.uniform(0.8, 1.2)
    effect = dead(size * a, size * (2 - a), 0.1 * size + 1e-9)
    runs = []
    for kind in ("multisine", "steps"):
        run = Run(rng, 2000, 0.01)
        t, h = run.fine, run.dt / FINE
        u = multisine(rng, t, 0.1, 1.5) if kind == "multisine" else levels(rng, t, 1.0, -2, 2)
        q = lti([1.0], [0.001, 1.0], np.vectorize(effect)(u) if size else u, h)
        x = start + gain * np.cumsum(q - 0.1) * h
        run.put("position", x, "m", 0.004 * gain, 0.3, step=0.001 * gain)
        run.command("command", u, "V")
        runs.append(run)
    return World(runs, {"valve": memoryless(effect)} if size else {})


def valve_null(rng: np.random.Generator, size: float) -> World:
    return dead_valve(rng, 0.0)


def dead_motor(rng: np.random.Generator, size: float, ripple: float = 0.003) -> World:
    gain, tau = spread(rng, 5, 20), spread(rng, 0.05, 0.2)
    a = rng.uniform(0.85, 1.15)
    effect = dead(size * a, size * (2 - a), 0.15 * size + 1e-9)
    runs = []
    for kind in ("steps", "chirp"):
        run = Run(rng, 2000, 0.005)
        t, h = run.fine, run.dt / FINE
        u = 1.5 * np.minimum(1, 3 * t) * (levels(rng, t, 0.5, -1, 1) if kind == "steps" else chirp(t, 0.2, 3))
        w = lti([gain], [3e-4 * tau, tau + 3e-4, 1.0], np.vectorize(effect)(u) if size else u, h)
        w = w * (1 + ripple * np.sin(np.cumsum(w) * h * 6))
        run.put("speed", w, "1/s", 0.008 * np.std(w), 0.3)
        run.command("voltage", u, "V")
        runs.append(run)
    return World(runs, {"voltage": memoryless(effect)} if size else {})


def motor_null(rng: np.random.Generator, size: float) -> World:
    """A small electrical time constant, ripple of the commutator: right for `Motor`."""
    return dead_motor(rng, 0.0, ripple=0.006)


def gear(rng: np.random.Generator, size: float) -> World:
    """The load hangs on teeth with play, a stiff damped contact, and rubs a little so that it stays put."""
    ratio, gap, wc = 0.2, size, spread(rng, 300, 600)
    runs = []
    for kind in ("moves", "sines"):
        run = Run(rng, 2000, 0.005)
        t = run.fine
        angle = levels(rng, t, 1.0, -2, 2, 0.7) if kind == "moves" else multisine(rng, t, 0.1, 0.8)

        def rhs(x: Array, motor: Array) -> list[float]:
            off = ratio * motor[0] - x[0]
            tooth = np.copysign(max(abs(off) - 0.5 * ratio * gap, 0.0), off)
            damping = 0.6 * wc * (ratio * motor[1] - x[1]) if tooth else 0.0
            return [x[1], wc**2 * tooth + damping - 10.0 * np.tanh(x[1] / 2e-3)]

        y = ode(rhs, run, np.stack([angle, np.gradient(angle, t)], axis=1), [ratio * angle[0], 0.0], "RK45")[0]
        run.put("load_angle", y + 0.02, "1", 0.002 * np.std(y), 0.3, step=1e-5)
        run.put("motor_angle", angle, "1", 1e-4, 0.0, step=2e-4)
        runs.append(run)

    return World(runs, {"motor_angle": play(gap)})


def dryer(rng: np.random.Generator, size: float, n: int = 1000) -> World:
    """Transport along the tube takes ``size`` s, dispersed by a twelfth of it."""
    gain, tau = spread(rng, 0.1, 0.4), spread(rng, 0.3, 0.8)
    runs = []
    for kind in ("binary", "sines"):
        run = Run(rng, n, 0.08)
        t, h = run.fine, run.dt / FINE
        heat = 50 + 15 * (
            np.tanh(5 * multisine(rng, t, 0.02, 0.6)) if kind == "binary" else multisine(rng, t, 0.02, 0.6)
        )
        y = lti([gain], [tau, 1.0], np.interp(t - 0.9 * size, t, heat), h)
        for _ in range(2):
            y = lti([1.0], [size / 20, 1.0], y, h)
        run.put("temperature", 296 + y, "K", 0.01 * np.std(y), 0.4, step=0.02)
        run.command("heater", heat, "W")
        runs.append(run)
    return World(runs, {"heater": late(lambda t: size)})


def network(rng: np.random.Generator, size: float) -> World:
    """A bus that is late by ``size`` samples of 5 ms, a fifth more or less, slowly varying."""
    w, zeta = spread(rng, 20, 50), rng.uniform(0.5, 1.0)
    phase = rng.uniform(0, 6)

    def wait(t: float) -> float:
        return 5e-3 * size * (1 + 0.15 * np.sin(0.9 * t + phase) + 0.05 * np.sin(7.1 * t))

    runs = []
    for kind in ("steps", "multisine"):
        run = Run(rng, 2000, 5e-3)
        t, h = run.fine, run.dt / FINE
        u = 0.02 * (levels(rng, t, 0.6, -1, 1, 0.05) if kind == "steps" else multisine(rng, t, 0.2, 4))
        y = lti([w * w], [1.0, 2 * zeta * w, w * w], np.interp(t - wait(t), t, u), h)
        run.put("position", y + 2e-4, "m", 1e-4, 0.3, step=2e-5)
        run.command("command", u, "m")
        runs.append(run)
    return World(runs, {"command": late(wait)})


def clamp(rng: np.random.Generator, size: float) -> World:
    """Filled to the set-point in a second, then shut off: the pressure bleeds away, ``size`` of it in 10 s."""
    tau = spread(rng, 0.05, 0.2)
    runs = []
    for kind in ("stairs", "steps"):
        run = Run(rng, 2000, 0.02)
        t = run.fine
        plateau = 8.0
        k = np.floor(t / plateau).astype(int)
        values = np.array([1, 2, 3, 4, 5]) / 5 if kind == "stairs" else rng.permutation([0.3, 1.0, 0.5, 0.8, 0.65])
        goal = lti([1.0], [0.04, 1.0], 2e5 * values[np.minimum(k, 4)], run.dt / FINE)
        p = np.empty(t.size)
        p[0], h = goal[0], run.dt / FINE
        for i in range(1, t.size):
            now, filling = p[i - 1], (t[i] % plateau) < 1.0
            flow = (goal[i] - now) / tau if filling else 0.0
            p[i] = now + h * (flow - size / 10 * now * (now / 2e5) ** 0.3)
        run.put("pressure", p + 300, "Pa", 150, 0.4, step=20)
        run.command("pressure", goal, "Pa", stream=False)
        runs.append(run)

    def make(dt: float) -> Step:
        held, before, since = np.nan, np.nan, 0.0

        def step(y: float, **_: float) -> float:
            nonlocal held, before, since
            since = 0.0 if abs(y - before) > 2 else since + dt
            before = y
            if np.isnan(held) or since < 0.5:
                held = y
            held -= dt * size / 10 * held * (abs(held) / 2e5) ** 0.3
            return held

        return step

    return World(runs, {"volume": make})


def slew_valve(rng: np.random.Generator, size: float) -> World:
    """The stem opens at most at 1/size per second and closes 20 % faster, with a soft limit."""
    tau = spread(rng, 0.05, 0.2)
    top = 1.5 / size
    runs = []

    def rate(e: float) -> float:
        limit = top if e > 0 else 1.2 * top
        return limit * np.sign(e) * (1 - np.exp(-((abs(e) / tau / limit) ** 4))) ** 0.25 if abs(e) > 1e-9 else e / tau

    for kind in ("steps", "sines"):
        run = Run(rng, 1500, 0.02)
        t = run.fine
        u = levels(rng, t, 1.5, 0.1, 0.9) if kind == "steps" else 0.5 + 0.2 * multisine(rng, t, 0.05, 0.8)
        y = ode(lambda x, c: [rate(c - x[0])], run, u, [u[0]])[0]
        run.put("opening", y + 0.01, "1", 0.003, 0.4, step=5e-4)
        run.command("command", u, "1")
        runs.append(run)

    def make(dt: float) -> Step:
        y0 = np.nan

        def step(y: float, **_: float) -> float:
            nonlocal y0
            y0 = y if np.isnan(y0) else y0 + min(max(y - y0, -1.2 * top * dt), top * dt)
            return y0

        return step

    return World(runs, {"stem": make})


def shaker(rng: np.random.Generator, size: float) -> World:
    """One supply rail is low: the amplifier's upper end is cut by ``size`` of its peak, with a knee."""
    w, zeta, gain = spread(rng, 100, 300), spread(rng, 0.1, 0.4), spread(rng, 1, 3)
    runs: list[Run] = []
    rail = gain * 2.5 * (1 - size)

    def cut(y: float, **_: float) -> float:
        return y - soft(y - rail, 0.03 * rail)

    for kind in ("multisine", "chirp"):
        run = Run(rng, 2500, 2 * np.pi / (40 * w))
        t, h, f0 = run.fine, run.dt / FINE, w / 2 / np.pi
        u = multisine(rng, t, 0.1 * f0, 2 * f0) if kind == "multisine" else 2.2 * chirp(t, 0.1 * f0, 2 * f0)
        u *= np.minimum(1, t * f0)
        drive = np.vectorize(cut)(gain * u)
        y = lti([w * w], [1.0, 2 * zeta * w, w * w], drive, h)
        run.put("response", y + 0.02, "V", 0.008 * np.std(y), 0.3, hum=0.001 * np.std(y))
        run.command("input", u, "V")
        runs.append(run)
    return World(runs, {"amplifier": memoryless(cut)})


def two_tanks(rng: np.random.Generator, size: float) -> World:
    """Right for `Cascade`, but for waves and the outlets' exponent of 0.51."""
    gain, o1, o2 = spread(rng, 2e-3, 4e-3), spread(rng, 0.008, 0.02), spread(rng, 0.008, 0.02)
    start = [rng.uniform(0.1, 0.3), rng.uniform(0.1, 0.3)]
    runs = []
    for kind in ("steps", "sines"):
        run = Run(rng, 1000, 2.0)
        t = run.fine
        even = o1 * np.sqrt(0.2) / gain
        u = even * (
            1 + 0.4 * (levels(rng, t, 120, -1, 1) if kind == "steps" else 0.6 * multisine(rng, t, 0.0005, 0.005))
        )
        h = ode(
            lambda x, p: [gain * p - o1 * max(x[0], 0) ** 0.505,
                          o1 * max(x[0], 0) ** 0.505 - o2 * max(x[1], 0) ** 0.505],
            run, u, start,
        )[1]  # fmt: skip
        run.put("level", h, "m", 0.003, 0.5, step=1e-3)
        run.command("pump", u, "V")
        runs.append(run)
    return World(runs)


def circuit(rng: np.random.Generator, size: float) -> World:
    """Hum, outliers, a parasitic pole: right for `Circuit`."""
    tau, start = spread(rng, 5e-3, 2e-2), rng.uniform(-1, 1)
    runs = []
    for kind in ("steps", "chirp"):
        run = Run(rng, 2000, 1e-3)
        t, h = run.fine, run.dt / FINE
        u = 2 * np.minimum(1, t / 0.05) * (levels(rng, t, 0.1, -1, 1) if kind == "steps" else chirp(t, 1, 40))
        y = lti([1.02], [tau * 2e-5, tau + 2e-5, 1.0], u, h) + start * np.exp(-t / tau)
        run.put("output", y + 0.05, "V", 0.01, 0.3, hum=0.006, outliers=0.003, step=2e-3)
        run.command("input", u, "V")
        runs.append(run)
    return World(runs)
