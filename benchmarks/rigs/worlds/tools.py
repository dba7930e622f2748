"""Parts of all worlds: a recording in the making, and signals to move a rig with.

Time in s, everything SI.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
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
