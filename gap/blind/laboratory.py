"""Differences between laboratories without a fault: noise, resolution, sampling, controllers, tolerances.

``nominal`` is the instrument of README.md. ``draw`` makes another laboratory's: nothing in it is a fault, so that a
diagnosis which calls any of it one has assumed too much.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from .signals import Array

STYLES = ("wide", "dense")
"""``dense``: README.md's instrument to the letter, with white noise. ``wide``: laboratories as they differ."""
SUCTION_NOISE = {  # Pa and m: rms of a sample, resolution
    "cutometer": {"pressure": (70.0, 100.0), "apex_height": (3.5e-6, 1e-5)},
    "aspiration": {"pressure": (50.0, 10.0), "apex_height": (4e-6, 1e-6)},
}
ROBOT_NOISE = {"axis": (12e-6, 1e-6), "leg": (5e-3, 5e-4)}  # m and N


@dataclass(frozen=True)
class Noise:
    """Noise of a channel: ``rms`` of a sample, of it a share ``slow`` (of the rms) that forgets within ``tau`` s, and a
    share ``flicker`` with a 1/f spectrum; then rounding to ``step``."""

    rms: float
    step: float
    slow: float = 0.0
    tau: float = 1.0
    flicker: float = 0.0

    def colour(self, n: int, period: float) -> Array:
        """Amplitude (n // 2 + 1,) of the noise at the frequencies of ``n`` samples every ``period`` s, relative to
        white noise of the same unit: 1 everywhere without slow parts."""
        turn = 2 * np.pi * np.fft.rfftfreq(n)
        rho = np.exp(-period / self.tau)
        slow = (1 - rho**2) / (1 - 2 * rho * np.cos(turn) + rho**2)
        one_over_f = 1.0 / np.maximum(np.arange(turn.size), 0.5)
        one_over_f *= n / (2 * one_over_f[1:].sum() + 1e-12)
        white = 1.0 - self.slow**2 - self.flicker**2
        return np.asarray(np.sqrt(white + self.slow**2 * slow + self.flicker**2 * one_over_f))

    def draw(self, n: int, period: float, rng: np.random.Generator) -> Array:
        """Noise of ``n`` samples, before rounding."""
        long = 2 * n  # the second half goes: a spectrum knows only periodic noise
        white = rng.normal(size=long)
        return self.rms * np.fft.irfft(np.fft.rfft(white) * self.colour(long, period), long)[:n]

    def whitened(self, x: Array, period: float) -> Array:
        """A signal x (n,) in units of this noise (rounding included), frequency by frequency."""
        sd = float(np.hypot(self.rms, self.step / 12**0.5))
        if not (self.slow or self.flicker):
            return x / sd
        long = np.concatenate([x, x[::-1]])  # mirrored, so that its ends meet
        return np.asarray(np.fft.irfft(np.fft.rfft(long) / self.colour(long.size, period), long.size)[: x.size] / sd)


@dataclass(frozen=True)
class Laboratory:
    """A laboratory with a sound instrument.

    ``noise`` is by kind of channel (`pressure`, `apex_height`; `axis`, `leg`). ``tolerances`` are the standard
    deviations of the usual errors of every instrument, by knob; ``knobs`` are this one's other peculiarities. ``table``
    says how set-points are written, ``uneven`` by how much of a period stamps scatter (they are right, all the same),
    ``decimals`` how many more digits the files have.
    """

    style: str
    rate: float
    noise: Mapping[str, Noise]
    tolerances: Mapping[str, float]
    knobs: Mapping[str, float] = field(default_factory=dict)
    table: str = "dense"
    uneven: float = 0.0
    decimals: int = 0


_SUCTION = {
    "latency_tolerance": 1e-3,  # s, of a command
    "height_tolerance": 1e-3,  # s, height behind pressure
    "regulator_tolerance": 0.02,  # relative, of the regulator's speed
    "damping_tolerance": 0.03,  # of its damping ratio
    "skew_tolerance": 2e-5,  # of the recording's clock
    "gain_tolerance": 1e-3,  # relative, of the gauge
    "zero_tolerance": 10.0,  # Pa, of the gauge
}
_ROBOT = {
    "latency_tolerance": 1e-3,
    "skew_tolerance": 2e-5,
    "servo_tolerance": 0.02,  # relative, of the loops' gains
    "leg_tolerance_0": 2e-3,  # relative, of each transducer
    "leg_tolerance_1": 2e-3,
    "leg_tolerance_2": 2e-3,
}
# A laboratory's own: wider than a data sheet's.
_WIDE_SUCTION = _SUCTION | {"gain_tolerance": 5e-3, "zero_tolerance": 100.0, "regulator_tolerance": 0.05}
_WIDE_ROBOT = _ROBOT | {f"leg_tolerance_{k}": 5e-3 for k in range(3)} | {"servo_tolerance": 0.1}


def _noises(instrument: str) -> dict[str, tuple[float, float]]:
    return ROBOT_NOISE if instrument == "microrobot" else SUCTION_NOISE[instrument]


def nominal(instrument: str) -> Laboratory:
    """The instrument of README.md: white noise, exact instants, dense set-points."""
    rate = 25.0 if instrument == "aspiration" else 100.0
    noise = {k: Noise(rms, step) for k, (rms, step) in _noises(instrument).items()}
    return Laboratory("dense", rate, noise, _ROBOT if instrument == "microrobot" else _SUCTION)


def draw(instrument: str, rng: np.random.Generator) -> Laboratory:
    """Another laboratory with a sound instrument of the same kind."""
    robot = instrument == "microrobot"
    finer = {"pressure": [1.0, 0.1, 0.01], "apex_height": [1.0, 0.1], "axis": [1.0, 0.1], "leg": [1.0, 0.02]}
    noise = {}
    for kind, (rms, step) in _noises(instrument).items():
        slow = float(rng.uniform(0.05, 0.25)) if rng.random() < 0.75 else 0.0
        flicker = float(rng.uniform(0.03, 0.12)) if rng.random() < 0.3 else 0.0
        size = rms * float(rng.uniform(0.5, 1.3))
        noise[kind] = Noise(size, step * float(rng.choice(finer[kind])), slow, float(rng.uniform(0.2, 4.0)), flicker)
    rates = [25.0, 30.0, 50.0] if instrument == "aspiration" else [50.0, 100.0, 100.0, 200.0]
    knobs = {"stamped": float(rng.choice([0.0, 0.0, -0.5, 0.5])), "averaged": float(rng.random() < 0.3)}
    knobs |= _servo(rng) if robot else _regulator(rng)
    return Laboratory(
        "wide", float(rng.choice(rates)), noise, _WIDE_ROBOT if robot else _WIDE_SUCTION, knobs,
        str(rng.choice(["dense", "corners", "grid"])), float(rng.choice([0.0, 0.0, 0.1])), 2,
    )  # fmt: skip


def _regulator(rng: np.random.Generator) -> dict[str, float]:
    """A controller that brings the pressure to 63 % after some 86 ms, of this structure or that."""
    quick = float(np.exp(0.1 * rng.normal()))
    kind = rng.choice(["nominal", "first order", "pi", "feedforward"], p=[0.4, 0.2, 0.2, 0.2])
    if kind == "first order":
        return {"one_lag": 0.086 * quick}
    if kind == "pi":
        damping = float(rng.uniform(0.9, 1.2))
        return {"pi_gain": 50.0 * damping / quick, "pi_reset": 0.08 * damping * quick,
                "pi_weight": float(rng.uniform(0.0, 0.3)), "pi_flow": 6e5}  # fmt: skip
    if kind == "feedforward":
        return {"lead": float(rng.uniform(0.004, 0.02))}
    return {}


def _servo(rng: np.random.Generator) -> dict[str, float]:
    """Gains of the axes' loops as another laboratory tunes them, and by how much they weigh the set-point and feed its
    speed forward."""
    gains = np.exp(0.25 * rng.normal(size=3))
    knobs = {"kp_share": float(gains[0]), "ki_share": float(gains[1]), "kd_share": float(gains[2])}
    unfed = float(rng.choice([0.0, 0.0, 1.0, rng.uniform(0.0, 0.6)]))
    unweighed = float(rng.choice([0.0, 0.0, rng.uniform(0.0, 0.4)]))
    return knobs | {"unfed": unfed, "unweighed": unweighed}
