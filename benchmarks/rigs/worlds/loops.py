"""Worlds whose effect acts within their own motion: cart, oscillators, tank."""

from __future__ import annotations

import numpy as np

from benchmarks.rigs.worlds.effects import memoryless, rubbing
from benchmarks.rigs.worlds.tools import FINE, Array, Run, Step, World, chirp, levels, lti, multisine, ode, soft, spread


def cart(rng: np.random.Generator, size: float, net: bool = False) -> World:
    m, d = spread(rng, 1, 5), spread(rng, 1, 6)
    rub = rubbing(size * d, 0.01, rng.uniform(-0.1, 0.1))
    runs = []
    for kind in ("steps", "sines"):
        run = Run(rng, 900, 0.02)
        t = run.fine
        push = 2 * d * (levels(rng, t, 1.5, -1, 1, 0.05) if kind == "steps" else 0.6 * multisine(rng, t, 0.05, 0.8))
        v = ode(lambda x, u: [(u - d * x[0] - rub(0.0, velocity=x[0])) / m], run, push, [0.05])[0]
        run.put("speed", v, "m/s", 0.01 * np.std(v), 0.4)
        run.command("force", push, "N")
        runs.append(run)
    if net:
        return World(runs, {"net_force": memoryless(lambda y, velocity=0.0, **_: y - rub(0.0, velocity=velocity))})
    return World(runs, {"resistance": memoryless(rub)})


def cart_net(rng: np.random.Generator, size: float) -> World:
    return cart(rng, size, net=True)


def bouc_wen(rng: np.random.Generator, size: float) -> World:
    """The oscillator of the Bouc-Wen benchmark, slower: m y'' + c y' + k y + z = u."""
    m, c, k = spread(rng, 1, 4), spread(rng, 10, 30), spread(rng, 3000, 8000)
    alpha, beta, reach = size * k, 0.6, 0.004

    def zdot(z: float, v: float) -> float:
        return alpha * v - (beta * abs(v) * z + (1 - beta) * v * abs(z)) / reach

    def make(dt: float) -> Step:
        z = 0.0

        def step(y: float, velocity: float = 0.0, **_: float) -> float:
            nonlocal z
            for _ in range(20):
                z += dt / 20 * zdot(z, velocity)
            return y + z

        return step

    runs, f0 = [], np.sqrt(k / m) / 2 / np.pi
    for kind in ("multisine", "chirp"):
        run = Run(rng, 1000, 1 / (30 * f0))
        t = run.fine
        u = (
            0.3
            * reach
            * k
            * (multisine(rng, t, 0.2 * f0, 1.8 * f0) if kind == "multisine" else chirp(t, 0.3 * f0, 1.6 * f0))
        )
        u *= np.minimum(1, t / t[-1] * 10)
        y = ode(lambda x, f: [x[1], (f - c * x[1] - k * x[0] - x[2]) / m, zdot(x[2], x[1])], run, u, [0, 0, 0])[0]
        run.put("displacement", y, "m", 0.008 * np.std(y), 0.3)
        run.command("force", u, "N")
        runs.append(run)
    return World(runs, {"restoring_force": make})


def oscillator(rng: np.random.Generator, size: float) -> World:
    """A second mode far above and a slightly wrong gauge: right for `Oscillator`."""
    m, c, k = spread(rng, 1, 4), spread(rng, 5, 30), spread(rng, 3000, 8000)
    runs, w = [], np.sqrt(k / m)
    for kind in ("multisine", "chirp"):
        run = Run(rng, 1000, 2 * np.pi / (30 * w))
        t, f0 = run.fine, w / 2 / np.pi
        u = k * 1e-3 * (multisine(rng, t, 0.2 * f0, 1.8 * f0) if kind == "multisine" else chirp(t, 0.3 * f0, 1.6 * f0))
        u *= np.minimum(1, t / t[-1] * 10)
        y = lti([1.0], [m, c, k], u, run.dt / FINE) + lti([0.002], [m / 150, c / 40, k], u, run.dt / FINE)
        run.put("displacement", y, "m", 0.01 * np.std(y), 0.3, outliers=0.002)
        run.command("force", u, "N")
        runs.append(run)
    return World(runs)


def silverbox(rng: np.random.Generator, size: float) -> World:
    w, zeta, gain = spread(rng, 300, 500), spread(rng, 0.05, 0.12), spread(rng, 0.6, 1.6)
    c3 = size * 4

    def bent(y: float, position: float = 0.0, **_: float) -> float:
        return y + c3 * position**3 / (1 + 0.2 * position**2) + 0.1 * c3 * position * abs(position) * 0.3

    runs, f0 = [], w / 2 / np.pi
    for kind in ("multisine", "ramp"):
        run = Run(rng, 1200, 1 / (30 * f0))
        t = run.fine
        u = multisine(rng, t, 0.1 * f0, 2 * f0)
        u *= 0.15 / gain * (t / t[-1] * 1.5 if kind == "ramp" else 1)
        y = ode(lambda x, f: [w * x[1], w * (gain * f - 2 * zeta * x[1] - bent(x[0], position=x[0]))], run, u, [0, 0])[
            0
        ]
        run.put("voltage", y, "V", 0.008 * np.std(y), 0.3)
        run.put("input", u, "V", 1e-5)
        runs.append(run)
    return World(runs, {"feedback": memoryless(bent)})


def tank(rng: np.random.Generator, size: float) -> World:
    """Overflows at a weir; ``size`` is the share of the level's range that is lost."""
    gain, outlet = spread(rng, 2e-3, 5e-3), spread(rng, 0.008, 0.02)
    start = rng.uniform(0.1, 0.3)
    runs = []
    top, lip = np.inf, 0.006

    def fill(x: Array, p: float) -> list[float]:
        return [gain * p - outlet * max(x[0], 0) ** 0.5 - 2.0 * max(x[0] - top, 0.0) ** 1.5]

    for kind in ("steps", "sines"):
        run = Run(rng, 700, 2.0)
        t = run.fine
        even = outlet * np.sqrt(0.3) / gain
        u = even * (
            1 + 0.6 * (levels(rng, t, 120, -1, 1) if kind == "steps" else 0.6 * multisine(rng, t, 0.0005, 0.005))
        )
        if top == np.inf:
            dry = ode(fill, run, u, [start])[0]
            top = dry.max() - size * np.ptp(dry)
        run.put("level", ode(fill, run, u, [start])[0], "m", 0.003, 0.4, step=5e-4)
        run.command("pump", u, "V")
        runs.append(run)

    def cut(y: float, **_: float) -> float:
        return y - soft(y - top - lip, lip)

    return World(runs, {"tank": memoryless(cut)})
