"""Worlds that answer where they stand: piezos, load cells, rubber, sensors."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.rigs.worlds.effects import memoryless, plays, preisach, relaxing
from benchmarks.rigs.worlds.tools import FINE, Array, Run, Step, World, levels, lti, multisine, passed, spread, triangle


def static(
    rng: np.random.Generator, inputs: list[Array], source: str, target: str, units: tuple[str, str], dt: float,
    effect: Callable[[float], Step] | None, out: Callable[[Array], Array], tap: str, sd: float = 0.005,
    slow: Callable[[Array, float], Array] | None = None, **noise: Any,
) -> World:  # fmt: skip
    """Input (fine) -> effect -> ``out`` (a static map) -> recorded, with a small slow addition if given."""
    runs = []
    for x in inputs:
        run = Run(rng, x.size // FINE, dt)
        y = out(passed(effect(dt / FINE), x) if effect else x)
        if slow:
            y = y + slow(y, dt / FINE)
        run.put(target, y, units[1], sd * float(np.std(y)), **noise)
        run.put(source, x, units[0], 1e-5 * float(np.std(x)), 0.0)
        runs.append(run)
    return World(runs, {tap: effect} if effect else {})


def fine(n: int, dt: float) -> Array:
    return np.arange(n * FINE) * dt / FINE


def piezo_inputs(rng: np.random.Generator, n: int = 1800, dt: float = 5e-3) -> list[Array]:
    t = fine(n, dt)
    shrinking = 60 + 60 * triangle(t, 1.2) * (1.0 - 0.6 * t / t[-1])
    return [shrinking, 60 + 18 * multisine(rng, t, 0.2, 1.2, 6)]


def piezo(rng: np.random.Generator, size: float) -> World:
    gain = spread(rng, 1e-7, 3e-7)
    radii = np.linspace(2, 50, 10)
    weights = size * np.exp(-radii / 30) / np.sum(np.exp(-radii / 30)) * rng.uniform(0.8, 1.2, 10)
    creep = relaxing(np.full(3, 0.006 * size), np.array([0.1, 1.0, 10.0]))
    return static(rng, piezo_inputs(rng), "voltage", "displacement", ("V", "m"), 5e-3, plays(weights, radii),
                  lambda v: gain * v + 1e-6, "voltage", 0.004,
                  lambda y, dt: passed(creep(dt), y - y[0]) - (y - y[0]))  # fmt: skip


def piezo_null(rng: np.random.Generator, size: float) -> World:
    """Driven by charge: linear; hum of 50 Hz folded to 50 of 200 Hz, slow noise."""
    gain = spread(rng, 1e-7, 3e-7)
    return static(rng, piezo_inputs(rng), "voltage", "displacement", ("V", "m"), 5e-3, None,
                  lambda v: gain * v + 1e-6, "voltage", 0.005, colour=0.5, hum=gain * 0.1)  # fmt: skip


def magnet(rng: np.random.Generator, size: float) -> World:
    gain = spread(rng, 5, 20)
    t = fine(1500, 0.01)
    inputs = [3 * triangle(t, 3.0) * (0.3 + 0.7 * t / t[-1]), 1.3 * multisine(rng, t, 0.1, 0.7, 6)]
    return static(rng, inputs, "current", "force", ("A", "N"), 0.01, preisach(rng, size, 3.0),
                  lambda i: gain * i + 1.0, "current", 0.006)  # fmt: skip


def bearing(rng: np.random.Generator, size: float) -> World:
    """A lead core that yields (Bouc-Wen, exponent 1.5) beside rubber; shear cycles."""
    k, c, yield_at = spread(rng, 5e5, 2e6), spread(rng, 5e3, 5e4), 0.01
    level = size * k * 0.05
    runs = []

    def make(dt: float) -> Step:
        z = 0.0

        def step(y: float, velocity: float = 0.0, **_: float) -> float:
            nonlocal z
            for _ in range(4):
                z += (
                    dt
                    / 4
                    * (velocity - (0.55 * abs(velocity) * z + 0.45 * velocity * abs(z)) * abs(z) ** 0.5)
                    / yield_at
                )
            return y + level * z

        return step

    for kind in ("cycles", "sines"):
        run = Run(rng, 2000, 0.01)
        t = run.fine
        ramp = np.minimum(1, t / 1.0)
        x = ramp * (0.08 * (0.3 + 0.7 * t / t[-1]) * np.sin(2 * np.pi * 0.4 * t) if kind == "cycles"
                    else 0.03 * multisine(rng, t, 0.1, 0.8, 6))  # fmt: skip
        v = np.gradient(x, t)
        f = passed(make(run.dt / FINE), k * x + c * v, velocity=v)
        run.put("force", f + 100 + 0.002 * size * k * x**2 / 0.08, "N", 0.006 * np.std(f), 0.4)
        run.put("shear", x, "m", 2e-6, 0.0, step=1e-6)
        runs.append(run)
    return World(runs, {"shear": make})


def loads(rng: np.random.Generator, n: int, dt: float) -> list[Array]:
    t = fine(n, dt)
    stairs = np.interp(t / t[-1], np.linspace(0, 1, 13), [0, 1, 2, 3, 4, 5, 5, 4, 3, 2, 1, 0, 0])
    stairs = 100 * lti([1.0], [0.3, 1.0], np.round(stairs), dt / FINE)
    return [stairs, 100 * lti([1.0], [0.3, 1.0], levels(rng, t, 25, 0, 5), dt / FINE)]


def load_cell(rng: np.random.Generator, size: float) -> World:
    """Creep with the logarithm of time from 1 to 100 s, ``size`` in all."""
    gain = spread(rng, 5e-5, 2e-4)
    taus = np.geomspace(1, 100, 9)
    effect = relaxing(np.full(9, size / 9), taus)
    return static(rng, loads(rng, 1500, 0.2), "load", "bridge", ("N", "V"), 0.2, effect,
                  lambda f: gain * f * (1 + 0.002 * size * f / 500) + 2e-4, "load", 0.002, step=gain * 0.1)  # fmt: skip


def load_cell_null(rng: np.random.Generator, size: float) -> World:
    """1/f noise and a coarse converter: right for `LoadCell`."""
    gain = spread(rng, 5e-5, 2e-4)
    return static(rng, loads(rng, 1500, 0.2), "load", "bridge", ("N", "V"), 0.2, None, lambda f: gain * f + 2e-4,
                  "load", 0.002, colour=0.6, step=gain * 0.5)  # fmt: skip


def load_cell_drift(rng: np.random.Generator, size: float) -> World:
    """Warming up: the zero runs away, decelerating (time constant 0.7 of the record); ``size`` of the full range."""
    gain = spread(rng, 5e-5, 2e-4)
    n, dt = 1500, 0.2
    sign = rng.choice([-1, 1])

    def make(h: float) -> Step:
        t = 0.0

        def step(y: float, **_: float) -> float:
            nonlocal t
            t += h
            return y + sign * size * 500 * (1 - np.exp(-t / (0.7 * n * dt))) / (1 - np.exp(-1 / 0.7))

        return step

    return static(rng, loads(rng, n, dt), "load", "bridge", ("N", "V"), dt, make,
                  lambda f: gain * f + 2e-4, "load", 0.002, step=gain * 0.1)  # fmt: skip


def polymer(rng: np.random.Generator, size: float) -> World:
    """Power-law creep, exponent 0.25, from a wide spectrum; the elastic part beside it."""
    modulus = spread(rng, 5e8, 2e9)
    taus = np.geomspace(0.2, 300, 12)
    shares = size * (taus / 20) ** 0.25 / 6
    effect = relaxing(shares, taus)
    runs = []
    for kind in ("recovery", "steps"):
        run = Run(rng, 1500, 0.1)
        t = run.fine
        raw = 1.0 * ((t % 75) < 37) if kind == "recovery" else levels(rng, t, 20, 0, 1)
        s = 5e6 * lti([1.0], [0.1, 1.0], raw, run.dt / FINE)
        e = passed(effect(run.dt / FINE), s / modulus)
        run.put("strain", e + 2e-5, "1", 0.004 * np.std(s / modulus), 0.4)
        run.put("stress", s, "Pa", 2e3, 0.0)
        runs.append(run)
    return World(runs, {"elastic": effect})


def rubber(rng: np.random.Generator, size: float) -> World:
    """Softens with the work done on it, by ``size`` in the end (Mullins); new stretch softens further."""
    modulus, eta = spread(rng, 5e5, 2e6), spread(rng, 5e3, 3e4)
    work0 = modulus * 0.25
    runs = []

    def make(dt: float) -> Step:
        work = 0.0

        def step(y: float, velocity: float = 0.0, **_: float) -> float:
            nonlocal work
            work += abs(y * velocity) * dt
            return y * (1 - size * (1 - 1 / (1 + work / work0)))

        return step

    for kind in ("cycles", "sines"):
        run = Run(rng, 1500, 0.02)
        t = run.fine
        x = 1 + (0.3 * (0.5 + 0.5 * triangle(t, 2.5)) if kind == "cycles"
                 else 0.18 * np.minimum(1, t) * (1 + 0.45 * multisine(rng, t, 0.2, 0.6, 5)))  # fmt: skip
        v = np.gradient(x, t)
        s = passed(make(run.dt / FINE), modulus * (x - x**-2) + eta * v, velocity=v)
        run.put("stress", s + 500, "Pa", 0.006 * np.std(s), 0.4)
        run.put("stretch", x, "1", 2e-6, 0.0, step=2e-6)
        runs.append(run)
    return World(runs, {"rubber": make})


def tissue(rng: np.random.Generator, size: float) -> World:
    """The first cycles are stiffer, by ``size``; it settles from cycle to cycle, by an uneven factor."""
    k, b = spread(rng, 100, 400), spread(rng, 80, 250)
    runs = []

    def make(dt: float) -> Step:
        cycle, rising, left = 0, False, 1.0

        def step(y: float, velocity: float = 0.0, **_: float) -> float:
            nonlocal cycle, rising, left
            if velocity > 1e-5 and not rising:
                cycle += 1
                rising = True
            if velocity < -1e-5:
                rising = False
            goal = 0.55 ** max(cycle - 1, 0) * (1 + 0.1 * np.sin(3.0 * cycle))
            left += (goal - left) * min(1.0, dt / 0.3)
            return y * (1 + size * left)

        return step

    for kind in ("cycles", "slow"):
        run = Run(rng, 1500, 0.02)
        t = run.fine
        period = 2.5 if kind == "cycles" else 4.0
        x = (
            5e-3
            * (0.5 + 0.5 * triangle(t, period))
            * (1 if kind == "cycles" else 0.8 + 0.2 * np.sin(2 * np.pi * t / 17))
        )
        v = np.gradient(x, t)
        f = passed(make(run.dt / FINE), k / b * np.expm1(b * x), velocity=v)
        run.put("force", f + 0.003, "N", 0.006 * np.std(f), 0.4)
        run.put("depth", x, "m", 2e-7, 0.0, step=1e-7)
        runs.append(run)
    return World(runs, {"tissue": make})


def two_axis(rng: np.random.Generator, size: float) -> World:
    """y leaks into x, bent by saturation of a tenth; x into y hardly."""
    gx, gy = spread(rng, 0.05, 0.2), spread(rng, 0.05, 0.2)

    def leaking(y: float, other: float = 0.0, **_: float) -> float:
        return y + size * gx * other / (1 + 0.02 * abs(other))

    runs = []
    for kind in ("steps", "sines"):
        run = Run(rng, 1500, 0.01)
        t = run.fine
        fx, fy = (levels(rng, t, 1.0, -5, 5, 0.1) if kind == "steps" else 2.5 * multisine(rng, t, 0.1, 2) for _ in "xy")
        x = np.vectorize(lambda a, b: leaking(a, other=b))(gx * fx, fy)
        run.put("signal_x", x + 0.01, "V", 0.006 * gx * 2.5, 0.4)
        run.put("signal_y", gy * (fy + 0.05 * size * fx) - 0.02, "V", 0.006 * gy * 2.5, 0.4)
        run.put("force_x", fx, "N", 5e-4, 0.0)
        run.put("force_y", fy, "N", 5e-4, 0.0)
        runs.append(run)
    return World(runs, {"x": memoryless(leaking)} if size else {})


def two_axis_null(rng: np.random.Generator, size: float) -> World:
    return two_axis(rng, 0.0)


def thermocouple(rng: np.random.Generator, size: float) -> World:
    """A sheath in front of the junction: two lags, ``size`` samples (1 s) and a sixth of it."""
    runs = []

    def make(dt: float) -> Step:
        y0 = a = b = np.nan

        def step(y: float, **_: float) -> float:
            nonlocal y0, a, b
            if np.isnan(y0):
                y0 = a = b = y
            for k in range(1, 11):  # the signal runs linearly between samples
                now = y0 + (y - y0) * (k - 0.5) / 10
                a = now + (a - now) * np.exp(-dt / 10 / (size / 6))
                b = a + (b - a) * np.exp(-dt / 10 / size)
            y0 = y
            return b

        return step

    for kind in ("steps", "sines"):
        run = Run(rng, 1500, 1.0)
        t, h = run.fine, run.dt / FINE
        oven = 380 + (levels(rng, t, 90, -50, 50) if kind == "steps" else 25 * multisine(rng, t, 0.002, 0.03))
        oven = lti([1.0], [5.0, 1.0], oven, h)
        y = passed(make(h), oven)
        run.put("reading", 1.005 * (y - 300) + 300.5, "K", 0.15, 0.4, step=0.05)
        run.put("reference", oven, "K", 0.01, 0.0)
        runs.append(run)
    return World(runs, {"junction": make})


def encoder(rng: np.random.Generator, size: float) -> World:
    """Counts of ``size`` mm, the lines of the scale slightly uneven."""
    step = size * 1e-3
    tooth = lambda x: step * (np.floor(x / step + 0.5 + 0.01 * np.sin(2 * np.pi * x / (7 * step))))  # noqa: E731
    runs = []
    for kind in ("moves", "sines"):
        run = Run(rng, 2000, 0.005)
        t = run.fine
        x = levels(rng, t, 1.2, -0.02, 0.02, 0.8) if kind == "moves" else 0.01 * multisine(rng, t, 0.1, 0.8, 8)
        run.put("encoder", tooth(x) + 1e-4, "m", 2e-6, 0.2)
        run.put("laser", x, "m", 5e-7, 0.0)
        runs.append(run)
    return World(runs, {"encoder": memoryless(lambda y, **_: float(tooth(y - 1e-4) + 1e-4))},
                 {"scale": 1.0, "zero": 1e-4})  # fmt: skip


def balance(rng: np.random.Generator, size: float) -> World:
    """One of the cells reads too much by ``size``, a tenth of that more at the upper end."""
    weight, sign = spread(rng, 10, 50), rng.choice([-1, 1])

    def wrong(y: float, **_: float) -> float:
        return y * (1 + sign * size * (1 + 0.1 * y / weight))

    runs = []
    for kind in ("steps", "sines"):
        run = Run(rng, 1200, 0.05)
        t = run.fine
        place = levels(rng, t, 4, 0.05, 0.95, 1.0) if kind == "steps" else 0.5 + 0.18 * multisine(rng, t, 0.02, 0.2)
        run.put("left", wrong(weight * (1 - place)) + 0.3, "N", 0.005 * weight, 0.4)
        run.put("right", weight * place - 0.2, "N", 0.005 * weight, 0.4)
        run.put("place", place, "1", 1e-4, 0.0)
        runs.append(run)
    return World(runs, {"left": memoryless(wrong)})
