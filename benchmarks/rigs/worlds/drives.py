"""Drives whose force is measured: servo, joint, cylinder, stage, pendulum, tow, voice coil."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.interpolate import CubicSpline

from benchmarks.rigs.worlds.effects import lugre, memoryless, rubbing
from benchmarks.rigs.worlds.tools import FINE, Array, Run, Step, World, chirp, levels, multisine, passed, spread


def motion(run: Run, kind: str, reach: float, pace: float) -> tuple[Array, Array, Array]:
    """Position (rms-free, within about ±``reach``), speed and acceleration on the fine base; ``pace`` s a move."""
    t = run.fine
    if kind == "moves":
        x = levels(run.rng, t, 1.4 * pace, -reach, reach, pace)
    elif kind == "sines":
        x = 0.5 * reach * multisine(run.rng, t, 0.1 / pace, 0.6 / pace, 8)
    else:
        x = reach * chirp(t, 0.1 / pace, 0.5 / pace)
    rest = np.clip(np.minimum(t, t[-1] - t) / pace - 0.2, 0, 1)  # begins and ends at rest
    x = x * rest**3 * (10 - 15 * rest + 6 * rest**2)
    spline = CubicSpline(t[::5], x[::5])
    return spline(t), spline(t, 1), spline(t, 2)


def inverse(
    rng: np.random.Generator, law: Callable[[Array, Array, Array], Array], effect: Callable[[float], Step] | None,
    channel: str, unit: str, reach: float, pace: float, dt: float, step: float, n: int = 2500, sd: float = 0.01,
    ripple: float = 0.0, kinds: tuple[str, ...] = ("moves", "sines"), target: str = "load", jitter: float = 0.0,
) -> World:  # fmt: skip
    """A drive recorded in motion: position by an encoder of ``step`` m, force with ``sd`` of its spread."""
    runs = []
    for kind in kinds:
        run = Run(rng, n, dt)
        x, v, a = motion(run, kind, reach, pace)
        clean = law(x, v, a)
        force = passed(effect(dt / FINE), clean, velocity=v, position=x) if effect else clean
        force = force + ripple * np.std(clean) * np.sin(2 * np.pi * x / (0.13 * reach) + 1)
        run.put("position", x, "m" if unit != "N m" else "1", 0.3 * step, 0.0, step, jitter=jitter)
        run.put(channel, force, unit, sd * np.std(clean), 0.5)
        run.command("position", x, "m" if unit != "N m" else "1", stream=False)
        runs.append(run)
    return World(runs, {target: effect} if effect else {})


def servo(rng: np.random.Generator, size: float) -> World:
    m, d, off = spread(rng, 30, 100), spread(rng, 30, 150), rng.uniform(-5, 5)
    level = size * 0.5 * m
    effect = lugre(level, spread(rng, 0.3, 1.0), spread(rng, 0.01, 0.03), 2e-5, rng.uniform(-0.1, 0.1))
    return inverse(rng, lambda x, v, a: m * a + d * v + off, effect if size else None,
                   "motor_force", "N", 0.2, 0.7, 2e-3, 1e-6, ripple=0.02 * min(size, 0.3) + 0.002)  # fmt: skip


def servo_coasting(rng: np.random.Generator, size: float) -> World:
    """Nothing but viscous drag, jittery sampling and a coarse encoder: right for `Servo`."""
    m, d = spread(rng, 30, 100), spread(rng, 30, 150)
    return inverse(rng, lambda x, v, a: m * a + d * v + 3, None, "motor_force", "N", 0.2, 0.7, 2e-3, 3e-7,
                   ripple=0.003, jitter=3e-7)  # fmt: skip


def joint(rng: np.random.Generator, size: float) -> World:
    i, g, d, phi = spread(rng, 0.5, 2), spread(rng, 5, 20), spread(rng, 0.5, 2), rng.uniform(-0.1, 0.1)
    rub, load = rubbing(1.0, 0.03, rng.uniform(-0.1, 0.1)), rng.uniform(0.05, 0.2) / g
    level = size * g * 0.5

    def effect(y: float, velocity: float = 0.0, **_: float) -> float:
        return y + level * (1 + load * abs(y)) * rub(0.0, velocity=velocity)

    return inverse(rng, lambda x, v, a: i * a + d * v + g * np.cos(x + phi), memoryless(effect) if size else None,
                   "torque", "N m", 1.2, 1.0, 4e-3, 2e-5, n=3000, ripple=0.004, kinds=("moves", "chirp"))  # fmt: skip


def joint_rubbing(rng: np.random.Generator, size: float) -> World:
    """Friction, which the model has: right for `JointWithFriction` but for a bit of rounding and asymmetry."""
    i, g, d = spread(rng, 0.5, 2), spread(rng, 5, 20), spread(rng, 0.5, 2)

    def law(x: Array, v: Array, a: Array) -> Array:
        return i * a + d * v + g * np.cos(x + 0.05) + 0.1 * g * (np.tanh(v / 0.051) + 0.01 * np.abs(np.tanh(v / 0.051)))

    return inverse(rng, law, None, "torque", "N m", 1.2, 1.0, 2e-3, 2e-6, n=4000, ripple=0.005)


def cylinder(rng: np.random.Generator, size: float) -> World:
    m, d, load = spread(rng, 2, 10), spread(rng, 20, 100), rng.uniform(-20, 20)
    effect = lugre(
        size * (0.5 * d + 0.5 * m), rng.uniform(0.1, 0.4), 0.02, spread(rng, 4e-4, 2e-3), rng.uniform(-0.15, 0.15)
    )
    return inverse(rng, lambda x, v, a: m * a + d * v + load, effect if size else None, "pressure_force", "N",
                   0.06, 0.5, 5e-3, 2e-6, n=2000, sd=0.015, kinds=("sines", "moves"))  # fmt: skip


def cylinder_greased(rng: np.random.Generator, size: float) -> World:
    m, d = spread(rng, 2, 10), spread(rng, 20, 100)
    return inverse(rng, lambda x, v, a: m * a + d * v + 8, None, "pressure_force", "N",
                   0.06, 0.5, 5e-3, 1e-6, n=2000, sd=0.015, jitter=2e-6, kinds=("sines",))  # fmt: skip


def stage_damped(rng: np.random.Generator, size: float) -> World:
    """Eddy-current damping, a little less than in proportion; `Stage` has none."""
    m, k = spread(rng, 0.5, 2), spread(rng, 100, 400)

    def effect(y: float, velocity: float = 0.0, **_: float) -> float:
        return y + size * k * 0.1 * velocity / (1 + (velocity / 0.4) ** 2) ** 0.5

    return inverse(rng, lambda x, v, a: m * a + k * x + 0.2, memoryless(effect) if size else None, "motor_force", "N",
                   0.05, 0.5, 2e-3, 2e-7, ripple=0.002, kinds=("sines", "chirp"))  # fmt: skip


def pendulum(rng: np.random.Generator, size: float) -> World:
    """A gravity torque that bends like a sine (and a bit one-sided) over the reach ``size`` rad."""
    i, d, g = spread(rng, 0.1, 0.4), spread(rng, 0.05, 0.2), spread(rng, 2, 10)

    def effect(y: float, position: float = 0.0, **_: float) -> float:
        return y + g * (np.sin(position + 0.02) - np.sin(0.02) - position)

    return inverse(rng, lambda x, v, a: i * a + d * v + g * x, memoryless(effect), "torque", "N m",
                   size, 0.8, 4e-3, 1e-6, sd=0.008)  # fmt: skip


def tow(rng: np.random.Generator, size: float) -> World:
    m, d = spread(rng, 20, 100), spread(rng, 10, 50)
    k = size * (m * 0.7 + d * 0.8)

    def effect(y: float, velocity: float = 0.0, **_: float) -> float:
        return y + k * np.sign(velocity) * abs(velocity) ** 1.85 * (1.05 if velocity > 0 else 0.95)

    return inverse(rng, lambda x, v, a: m * a + d * v + 2, memoryless(effect) if size else None, "motor_force", "N",
                   1.5, 2.0, 1e-2, 1e-5, n=3000, sd=0.015)  # fmt: skip


def voice_coil(rng: np.random.Generator, size: float) -> World:
    """The force constant falls from one end of the stroke (±4 mm) to the other, slightly curved."""
    m, d, k = spread(rng, 0.1, 0.3), spread(rng, 1, 5), spread(rng, 200, 800)

    def effect(y: float, position: float = 0.0, **_: float) -> float:
        s = position / 4e-3
        return y / (1 - 0.5 * size * (s + 0.15 * s * s))

    return inverse(rng, lambda x, v, a: (m * a + d * v + k * x) / 8.0, memoryless(effect) if size else None, "current",
                   "A", 4e-3, 0.15, 1e-3, 5e-8, sd=0.008, kinds=("sines", "chirp"),
                   target="current_needed")  # fmt: skip
