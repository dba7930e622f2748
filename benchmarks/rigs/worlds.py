"""The rigs as they are: physics finer than the models', with one hidden effect, and what ordinary rigs have besides.

Every world is a function ``(rng, size) -> World``. ``size`` is the effect's strength relative to the signal it acts on
(0: no effect). Time in s, everything SI. Nothing here knows the formulas of the diagnosis.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.signal import cont2discrete, lfilter

Array = NDArray[np.float64]
Step = Callable[..., float]
"""``step(value, velocity=..., position=..., other=...)``: the true effect on one sample; keeps its own state."""
FINE = 10
"""Steps of the world per recorded sample."""


@dataclass
class Run:
    """One recording in the making: ``fine`` is the world's time base, ``time`` the recorded one, s."""

    rng: np.random.Generator
    n: int
    dt: float
    streams: dict[str, tuple[Array, str]] = field(default_factory=dict)
    setpoints: dict[str, tuple[Array, str]] = field(default_factory=dict)
    error: dict[str, Array] = field(default_factory=dict)

    @property
    def time(self) -> Array:
        return np.arange(self.n) * self.dt

    @property
    def fine(self) -> Array:
        return np.arange(self.n * FINE) * self.dt / FINE

    def put(
        self, name: str, values: Array, unit: str, sd: float = 0.0, colour: float = 0.4, step: float = 0.0,
        hum: float = 0.0, outliers: float = 0.0, jitter: float = 0.0,
    ) -> None:  # fmt: skip
        """Record a channel with noise of ``sd``, a share ``colour`` of it slow; ``step`` of the converter, ``hum`` of
        50 Hz, a share ``outliers`` of samples five times as noisy, sampling instants wrong by ``jitter`` s."""
        clean = values[::FINE] if len(values) == self.n * FINE else values
        y = clean
        if jitter:
            y = np.interp(self.time + jitter * self.rng.standard_normal(self.n), self.fine, values)
        if sd:
            white, slow = self.rng.standard_normal((2, self.n))
            slow = lfilter([np.sqrt(1 - 0.95**2)], [1, -0.95], slow)
            y = y + sd * (np.sqrt(1 - colour**2) * white + colour * slow)
            y = y + hum * np.sin(2 * np.pi * 50.02 * self.time + 1.0)
            wild = self.rng.random(self.n) < outliers
            y = y + wild * 5 * sd * self.rng.standard_normal(self.n)
        if step:
            y = step * np.round(y / step)
        self.streams[name] = (np.asarray(y), unit)
        self.error[name] = y - clean

    def command(self, name: str, values: Array, unit: str, stream: bool = True) -> None:
        """A set-point, known exactly."""
        values = values[::FINE] if len(values) == self.n * FINE else values
        self.setpoints[name] = (values, unit)
        if stream:
            self.streams[name] = (values, unit)


@dataclass
class World:
    """Recordings, and the true effect as an operator per tap: tap -> (dt -> step)."""

    runs: list[Run]
    truth: Mapping[str, Callable[[float], Step]] = field(default_factory=dict)
    known: Mapping[str, float] = field(default_factory=dict)  # true parameters, where no search would find them


# --- tools ----------------------------------------------------------------------------------------------------------
def spread(rng: np.random.Generator, low: float, high: float) -> float:
    """Log-uniform."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def multisine(rng: np.random.Generator, t: Array, low: float, high: float, lines: int = 15) -> Array:
    """Random-phase lines between two frequencies (Hz), of rms 1."""
    y = np.zeros(t.size)
    for f in rng.uniform(low, high, lines):
        y += np.sin(2 * np.pi * f * t + rng.uniform(0, 2 * np.pi))
    return y / np.std(y)


def levels(rng: np.random.Generator, t: Array, hold: float, low: float, high: float, rise: float = 0.0) -> Array:
    """Random steps of about ``hold`` s between two values, S-shaped over ``rise`` s (a twelfth of ``hold``)."""
    y, at, value = np.zeros(t.size), 0.0, rng.uniform(low, high)
    rise = rise or hold / 12
    y += value
    while at < t[-1]:
        at += hold * rng.uniform(0.6, 1.4)
        new = rng.uniform(low, high)
        s = np.clip((t - at) / rise, 0, 1)
        y += (new - value) * s**3 * (10 - 15 * s + 6 * s**2)
        value = new
    return y


def chirp(t: Array, low: float, high: float) -> Array:
    return np.sin(2 * np.pi * (low * t + (high - low) * t**2 / (2 * t[-1])))


def triangle(t: Array, period: float) -> Array:
    """From -1 up, slightly rounded."""
    return np.arcsin(0.995 * np.sin(2 * np.pi * t / period - np.pi / 2)) / np.arcsin(0.995)


def lti(num: list[float], den: list[float], u: Array, dt: float) -> Array:
    """A linear system at rest at ``u[0]``."""
    b, a, _ = cont2discrete((num, den), dt, method="foh")
    return lfilter(np.ravel(b), a, u - u[0]) + num[-1] / den[-1] * u[0]


def ode(rhs: Callable[..., list[float]], run: Run, u: Array, start: list[float], method: str = "LSODA") -> Array:
    """States (k, n) at the recorded instants of ``x' = rhs(x, u)``, stiffly and tightly integrated."""
    t, fine, dt = run.time, run.fine, run.dt / FINE

    def f(at: float, x: Array) -> list[float]:
        i = min(int(at / dt), len(u) - 2)
        w = at / dt - i
        return rhs(x, u[i] + w * (u[i + 1] - u[i]))

    made = solve_ivp(f, (0, fine[-1]), start, method, t, rtol=1e-7, atol=1e-9, max_step=run.dt)
    assert made.success, made.message
    assert np.all(np.isfinite(made.y)), "the integrator diverged"
    return np.asarray(made.y)


def passed(step: Step, values: Array, **about: Array) -> Array:
    """A series through an operator that works sample by sample."""
    keys = list(about)
    rows = zip(*(np.asarray(about[k]).tolist() for k in keys), strict=True) if keys else ((),) * len(values)
    return np.array(
        [step(y, **dict(zip(keys, row, strict=True))) for y, row in zip(values.tolist(), rows, strict=True)]
    )


def soft(x: float, width: float) -> float:
    """max(x, 0) with a round corner."""
    return 0.5 * (x + (x * x + width * width) ** 0.5)


# --- true effects ---------------------------------------------------------------------------------------------------
def lugre(level: float, excess: float, stribeck: float, presliding: float, uneven: float) -> Callable[[float], Step]:
    """LuGre friction: bristles of ``presliding`` travel, higher at rest by ``excess``, unlike in the two directions."""

    def make(dt: float) -> Step:
        z = 0.0

        def step(y: float, velocity: float = 0.0, **_: float) -> float:
            nonlocal z
            v = velocity
            g = 1 + excess * np.exp(-(abs(v / stribeck) ** 1.4))
            rate = abs(v) / (presliding * g)
            end = g * np.sign(v)
            z = end + (z - end) * np.exp(-rate * dt)
            return y + level * z * (1 + uneven * np.sign(z))

        return step

    return make


def memoryless(f: Callable[..., float]) -> Callable[[float], Step]:
    return lambda dt: f


def rubbing(level: float, v0: float, uneven: float) -> Callable[..., float]:
    """Dry friction with an arctangent and unlike directions, against ``velocity``; added to the value."""

    def f(y: float, velocity: float = 0.0, **_: float) -> float:
        s = 2 / np.pi * np.arctan(velocity / v0)
        return y + level * (s + uneven * abs(s))

    return f


def plays(weights: Array, radii: Array) -> Callable[[float], Step]:
    """Prandtl-Ishlinskii: a sum of play operators on the signal."""

    def make(dt: float) -> Step:
        p = np.zeros(radii.size)

        def step(y: float, **_: float) -> float:
            np.clip(p, y - radii, y + radii, out=p)
            return float(y + weights @ (p - y))

        return step

    return make


def preisach(rng: np.random.Generator, share: float, span: float) -> Callable[[float], Step]:
    """Relays with a bell-shaped density; their sum, of unit amplitude, takes ``share`` of the signal's ``span``."""
    up, down = np.sort(rng.normal([[0.25], [-0.25]], 0.35, (2, 1500)), axis=0)[::-1] * span

    def make(dt: float) -> Step:
        state = np.where(0.5 * (up + down) < 0, 1.0, -1.0)

        def step(y: float, **_: float) -> float:
            state[y >= up] = 1.0
            state[y <= down] = -1.0
            return float((1 - share) * y + share * span * state.mean())

        return step

    return make


def dead(left: float, right: float, corner: float) -> Callable[..., float]:
    """A dead zone from -left to right with round corners."""

    def f(y: float, **_: float) -> float:
        return soft(y - right, corner) - soft(-y - left, corner)

    return f


def late(delay: Callable[[int], float]) -> Callable[[float], Step]:
    """Delay of ``delay(i)`` s at the time ``i`` (s)."""

    def make(dt: float) -> Step:
        seen: list[float] = []

        def step(y: float, **_: float) -> float:
            seen.append(y)
            at = len(seen) - 1 - delay((len(seen) - 1) * dt) / dt
            i = int(np.floor(at))
            if i < 0:
                return seen[0]
            if i + 1 >= len(seen):
                return y
            return seen[i] + (at - i) * (seen[i + 1] - seen[i])

        return step

    return make


def relaxing(shares: Array, taus: Array) -> Callable[[float], Step]:
    """Slow modes added to the signal: each of ``shares`` follows it with its own ``taus`` s."""

    def make(dt: float) -> Step:
        z = np.full(taus.size, np.nan)
        keep = np.exp(-dt / taus)

        def step(y: float, **_: float) -> float:
            nonlocal z
            z = np.zeros(taus.size) if np.isnan(z[0]) else y + (z - y) * keep
            return float(y + shares @ z)

        return step

    return make


# --- drives ---------------------------------------------------------------------------------------------------------
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


# --- loops ----------------------------------------------------------------------------------------------------------
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


# --- series ---------------------------------------------------------------------------------------------------------
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

    def make(dt: float) -> Step:
        p = np.nan

        def step(y: float, **_: float) -> float:
            nonlocal p
            p = y if np.isnan(p) else min(max(p, y - gap / 2), y + gap / 2)
            return p

        return step

    return World(runs, {"motor_angle": make})


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


# --- static ---------------------------------------------------------------------------------------------------------
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
