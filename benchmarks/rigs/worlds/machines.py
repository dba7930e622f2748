"""Worlds like the machines that people bring: geared servo, loggers with clocks of their own, steering rack, damper,
propeller, battery, swinging pendulum, plucked spring, sticky control valve. Coarse converters, slow drifts."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchmarks.rigs.worlds.drives import inverse
from benchmarks.rigs.worlds.effects import late, lugre, memoryless, play, relaxing
from benchmarks.rigs.worlds.tools import FINE, Array, Run, Step, World, levels, lti, multisine, ode, passed, spread


def drifting(run: Run, size: float) -> Array:
    """A slow run of the zero, within about ±``size``."""
    t = run.fine / run.fine[-1]
    return np.asarray(size * (run.rng.uniform(-1, 1) * t + 0.5 * np.sin(2 * np.pi * (1.7 * t + run.rng.random()))))


def geared_servo(rng: np.random.Generator, size: float) -> World:
    """A position servo whose sensor sits behind a gear with play of ``size`` rad; the load drags in grease."""
    w, zeta = spread(rng, 12, 30), rng.uniform(0.6, 0.9)
    runs = []
    for kind in ("steps", "sines"):
        run = Run(rng, 2400, 0.00625)
        t, h = run.fine, run.dt / FINE
        u = levels(rng, t, 1.2, -0.8, 0.8, 0.1) if kind == "steps" else 0.4 * multisine(rng, t, 0.1, 1.2, 6)
        motor = lti([w * w], [1.0, 2 * zeta * w, w * w], u, h)
        y, load = np.empty(t.size), motor[0]
        for i, x in enumerate(motor):  # flank contact with a little give, and grease between
            off = x - load
            load += np.copysign(max(abs(off) - 0.5 * size, 0.0), off) * (1 - np.exp(-h / 1.5e-3)) + 2e-4 * off * h
            y[i] = load
        run.put("angle", y + 0.01 + drifting(run, 5e-4), "1", 5e-4, 0.3, step=1.5e-3)
        run.command("command", u, "1")
        runs.append(run)

    return World(runs, {"gear": play(size)})


def loggers(rng: np.random.Generator, size: float) -> World:
    """Two loggers that were started by hand: the temperature-like output is stamped ``size`` samples late, or early."""
    sign = rng.choice([-1.0, 1.0])
    gain, tau = spread(rng, 0.5, 2), spread(rng, 0.04, 0.15)
    runs = []
    for kind in ("steps", "sines"):
        run = Run(rng, 2000, 0.008)
        t, h = run.fine, run.dt / FINE
        u = levels(rng, t, 0.8, -1, 1, 0.08) if kind == "steps" else 0.6 * multisine(rng, t, 0.1, 3)
        y = lti([gain], [tau, 1.0], u, h)
        y = np.interp(t - sign * size * run.dt, t, y)
        run.put("output", y + drifting(run, 2e-3), "V", 0.006 * gain, 0.4, step=4e-3 * gain)
        run.put("input", u, "V", 1e-3, 0.0, step=1e-3)
        runs.append(run)

    def shifted(t: float) -> float:
        return size * 0.008

    def early(dt: float) -> Step:
        return memoryless(lambda y, **_: y)(dt)  # no step can look ahead: checked by its gap alone

    return World(runs, {"output": late(shifted) if sign > 0 and size else early} if size else {})


def loggers_null(rng: np.random.Generator, size: float) -> World:
    """Loggers on one clock."""
    return loggers(rng, 0.0)


def rack(rng: np.random.Generator, size: float) -> World:
    """A steering rack pushed to and fro: the yoke's friction grows towards the ends of the travel."""
    m, d = spread(rng, 2, 6), spread(rng, 20, 80)
    rub = lugre(size * d * 0.4, rng.uniform(0.05, 0.4), 0.01, 1e-4, rng.uniform(-0.15, 0.15))

    def make(dt: float) -> Step:
        inner = rub(dt)

        def step(y: float, velocity: float = 0.0, position: float = 0.0, **_: float) -> float:
            return y + inner(0.0, velocity=velocity) * (1 + 20 * position * position)

        return step

    return inverse(rng, lambda x, v, a: m * a + d * v + 4, make, "pressure_force", "N", 0.07, 0.8, 4e-3, 1e-5,
                   n=2400, sd=0.02, ripple=0.004, kinds=("sines", "moves"))  # fmt: skip


def damper(rng: np.random.Generator, size: float) -> World:
    """A hydraulic damper on a test bench: its orifices resist with the square of the speed, in rebound a fifth more."""
    d, k = spread(rng, 300, 1200), spread(rng, 500, 3000)
    top = 0.4  # m/s, about the fastest

    def resisting(y: float, velocity: float = 0.0, **_: float) -> float:
        return y + size * d / top * velocity * abs(velocity) * (1.1 if velocity > 0 else 0.9)

    return inverse(rng, lambda x, v, a: d * v + k * x + 60, memoryless(resisting), "motor_force", "N", 0.05, 0.35, 2e-3,
                   2e-6, n=3000, sd=0.012, kinds=("sines", "chirp"))  # fmt: skip


def propeller(rng: np.random.Generator, size: float) -> World:
    """Throttle to thrust: the motor takes ``size`` s to speed up, and a tenth longer to slow down."""
    gain = spread(rng, 5, 15)
    runs = []
    for kind in ("steps", "sines"):
        run = Run(rng, 1500, 0.02)
        t, h = run.fine, run.dt / FINE
        u = levels(rng, t, 1.5, 0.3, 0.9, 0.04) if kind == "steps" else 0.6 + 0.12 * multisine(rng, t, 0.05, 1.5)
        speed, now = np.empty(t.size), u[0]
        for i, goal in enumerate(u):
            now += (goal - now) * (1 - np.exp(-h / (size * (1.0 if goal > now else 1.1)))) if size else goal - now
            speed[i] = now
        thrust = gain * speed**2
        run.put("thrust", thrust + drifting(run, 0.002 * gain), "N", 0.008 * gain, 0.3, step=0.005 * gain)
        run.command("throttle", u, "1")
        runs.append(run)
    lag = relaxing(np.array([1.0]), np.array([max(size, 1e-9)]))

    def make(dt: float) -> Step:
        inner, begun = lag(dt), [np.nan]

        def step(y: float, **_: float) -> float:
            begun[0] = y if np.isnan(begun[0]) else begun[0]
            return begun[0] + inner(y - begun[0]) - (y - begun[0])

        return step

    return World(runs, {"throttle": make} if size else {})


def propeller_null(rng: np.random.Generator, size: float) -> World:
    """A motor that is faster than the logger."""
    return propeller(rng, 0.0)


def battery(rng: np.random.Generator, size: float) -> World:
    """Current pulses to terminal voltage: two diffusion modes (some 8 and 120 s), ``size`` of the resistance."""
    r, capacity = spread(rng, 0.01, 0.05), spread(rng, 4e3, 1e4)
    shares = size * np.array([rng.uniform(0.3, 0.5), rng.uniform(0.4, 0.7)])
    taus = np.array([spread(rng, 5, 15), spread(rng, 80, 200)])
    effect = relaxing(shares, taus)
    runs = []
    for kind in ("pulses", "drive"):
        run = Run(rng, 1800, 1.0)
        t = run.fine
        on = (t % 240) < 90
        current = 5.0 * on * (1 - 2 * ((t // 240) % 2)) if kind == "pulses" else 3 * levels(rng, t, 60, -1, 1, 2)
        charge = np.cumsum(current) * run.dt / FINE
        fall = r * current
        if size:
            fall = passed(effect(run.dt / FINE), fall)
        y = 3.7 - fall - 0.4 * charge / capacity
        run.put("voltage", y, "V", 4e-4, 0.3, step=5e-4)
        run.put("current", current, "A", 2e-3, 0.0, step=2e-3)
        runs.append(run)
    return World(runs, {"resistance": effect} if size else {})


def battery_null(rng: np.random.Generator, size: float) -> World:
    return battery(rng, 0.0)


def swing(rng: np.random.Generator, size: float) -> World:
    """A pendulum let go: air drag with about the square of the speed beside the bearing's; seen by a coarse encoder."""
    w, zeta = spread(rng, 3, 7), spread(rng, 0.003, 0.01)

    def drag(y: float, velocity: float = 0.0, **_: float) -> float:
        return y + size * 0.1 * velocity * abs(velocity) ** 0.9

    runs = []
    for start in (0.7, rng.uniform(0.3, 0.5)):
        run = Run(rng, 700, 2 * np.pi / w / 30)
        y = ode(
            lambda x, u: [x[1], -(w**2) * np.sin(x[0]) - drag(2 * zeta * w * x[1], velocity=x[1])],
            run, np.zeros(run.fine.size), [start, 0.0],
        )[0]  # fmt: skip
        run.put("angle", y + 0.002, "1", 5e-4, 0.2, step=1e-3)
        runs.append(run)
    return World(runs, {"resistance": memoryless(drag)})


def plucked(rng: np.random.Generator, size: float) -> World:
    """A mass plucked and let go on a spring that hardens with the cube of the travel."""
    w, zeta = spread(rng, 20, 60), spread(rng, 0.01, 0.03)

    def spring(y: float, position: float = 0.0, **_: float) -> float:
        return y + size * w**2 * position * (position / 0.01) ** 2

    runs = []
    for start in (0.01, rng.uniform(0.004, 0.006)):
        run = Run(rng, 700, 2 * np.pi / w / 30)
        y = ode(
            lambda x, u: [x[1], -2 * zeta * w * x[1] - spring(w**2 * x[0], position=x[0])],
            run, np.zeros(run.fine.size), [start, 0.0], "RK45",
        )[0]  # fmt: skip
        run.put("position", y + drifting(run, 1e-5)[::FINE], "m", 3e-5, 0.3, step=2e-5)
        runs.append(run)
    return World(runs, {"resistance": memoryless(spring)})


def sticky_valve(rng: np.random.Generator, size: float) -> World:
    """A flow loop whose valve stem sticks: it rests until the demand is ``size`` away, then jumps most of the way, and
    comes no nearer than a third of that while it moves."""
    gain, tau = spread(rng, 0.5, 1.5), spread(rng, 1.5, 4)
    slip = 0.33 * size

    def stem() -> Callable[[float], float]:
        at, stuck, way = np.nan, True, 0.0

        def move(demand: float) -> float:
            nonlocal at, stuck, way
            if np.isnan(at):
                at = demand
            off = demand - at
            if stuck and abs(off) > size:
                stuck = False
            if not stuck:
                if off * way < 0 or abs(off) < slip:
                    stuck = abs(off) < size
                if not stuck or abs(off) > slip:
                    at, way = demand - np.copysign(slip, off), off
            return float(at)

        return move

    runs = []
    for kind in ("loop", "sweep"):
        run = Run(rng, 1200, 0.5)
        t, h = run.fine, run.dt / FINE
        goal = levels(rng, t, 45, 30, 70, 1) if kind == "loop" else 50 + 9 * multisine(rng, t, 0.004, 0.05, 8)
        move, flow, total = stem(), gain * goal[0], goal[0] / 0.06
        y, op = np.empty(t.size), np.empty(t.size)
        for i in range(t.size):
            error = gain * goal[i] - flow
            total += error / gain * h
            op[i] = 0.4 * error / gain + 0.06 * total if kind == "loop" else goal[i]
            y[i] = flow
            flow += h / tau * (gain * (move(op[i]) if size else op[i]) - flow)
        run.put("flow", y + drifting(run, 0.05 * gain), "1", 0.15 * gain, 0.3, step=0.1 * gain)
        run.put("demand", op, "1", 0.0, step=0.02)
        runs.append(run)
    return World(runs, {"stem": lambda dt: memoryless_of(stem())} if size else {})


def memoryless_of(move: Callable[[float], float]) -> Step:
    """A stem as a tap's operator."""
    return lambda y, **_: move(y)


def sticky_valve_null(rng: np.random.Generator, size: float) -> World:
    """A valve with a good positioner."""
    return sticky_valve(rng, 0.0)
