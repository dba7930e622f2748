"""Tissue laws of the generator: skin under suction, apex height from suction.

``conventional`` is a nonlinear quasi-linear viscoelastic skin, as any laboratory would assume; the others are the wrong
laws of tiers T3 and T6. A law is a function (suction (N,) [Pa], dt (N,) [s], parameters) -> height (N,) [m]. Each has
its own parameters, drawn by ``draw`` for one person; ``amplitude`` scales compliance in all of them.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import njit

from .signals import Array, lag, power_law_memory

Parameters = dict[str, float]


def _curve(s: Array, p: Parameters) -> Array:
    """Elastic height at suction s; ``bend`` > 0 softens the start: power, logarithmic or saturating by ``kind``."""
    x = np.maximum(s, 0.0) / p["reference"]
    b = p["bend"]
    if p["kind"] == 0:
        n, soft = 1 / (1 + b), 0.1  # the small shift keeps the slope at zero finite
        share: Array = ((x + soft) ** n - soft**n) / ((1 + soft) ** n - soft**n)
    elif p["kind"] == 1:
        share = np.log1p(2 * b * x) / np.log1p(2 * b)
    else:
        share = x * (1 + b) / (1 + b * x)
    return p["amplitude"] * share


def conventional(s: Array, dt: Array, p: Parameters) -> Array:
    """Quasi-linear viscoelasticity in creep form with two lags."""
    e = _curve(s, p)
    return e + p["fast"] * lag(e, dt, p["tau_fast"]) + p["slow"] * lag(e, dt, p["tau_slow"])


def fractional(s: Array, dt: Array, p: Parameters) -> Array:
    """Spring and springpot in series on a power-law elastic curve: creep grows as t^alpha."""
    e = _curve(s, p)
    return e + p["springpot"] * power_law_memory(e, dt, p["alpha"])


@njit(cache=True)
def _membrane(s, dt, k, b, eta, stiff, tau):  # type: ignore[no-untyped-def]
    h = np.zeros_like(s)
    x, m = 0.0, 0.0
    for i in range(1, s.size):
        n = 1 + int(dt[i] / 0.01)
        d = dt[i] / n
        for j in range(n):
            # RK4 of eta x' = s - k x exp(b x^2) - m, m' = stiff x' - m / tau (all lengths in mm, k in Pa/mm)
            u0 = s[i - 1] + (s[i] - s[i - 1]) * j / n
            u1 = s[i - 1] + (s[i] - s[i - 1]) * (j + 1) / n
            um = 0.5 * (u0 + u1)
            a1 = (u0 - k * x * np.exp(b * x * x) - m) / eta
            c1 = stiff * a1 - m / tau
            xa, ma = x + 0.5 * d * a1, m + 0.5 * d * c1
            a2 = (um - k * xa * np.exp(b * xa * xa) - ma) / eta
            c2 = stiff * a2 - ma / tau
            xa, ma = x + 0.5 * d * a2, m + 0.5 * d * c2
            a3 = (um - k * xa * np.exp(b * xa * xa) - ma) / eta
            c3 = stiff * a3 - ma / tau
            xa, ma = x + d * a3, m + d * c3
            a4 = (u1 - k * xa * np.exp(b * xa * xa) - ma) / eta
            c4 = stiff * a4 - ma / tau
            x += d / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
            m += d / 6 * (c1 + 2 * c2 + 2 * c3 + c4)
        h[i] = x
    return h


def membrane(s: Array, dt: Array, p: Parameters) -> Array:
    """Exponentially stiffening dome (Fung) with a dashpot and a Maxwell arm in parallel: memory inside the curve.

    It is scaled so that the static height at the reference suction is ``amplitude``.
    """
    unit = p["amplitude"]
    k = p["reference"] * np.exp(-p["stiffening"])
    args = (k, p["stiffening"], p["viscosity"] * k, p["maxwell"] * k, p["tau_slow"])
    return np.asarray(unit * _membrane(s, dt, *args))


def poroelastic(s: Array, dt: Array, p: Parameters) -> Array:
    """Drainage of a slab (Terzaghi): creep modes n = 1, 3, 5 ... of weight 1/n^2, time tau/n^2, slower if squeezed."""
    e = _curve(s, p)
    squeezed = dt * (1 + p["clogging"]) / (1 + p["clogging"] * (1 + e / p["amplitude"]))
    drained = np.zeros_like(e)
    for n in (1, 3, 5, 7, 9):
        drained += 8 / np.pi**2 / n**2 * _lag_uneven_steps(e, squeezed, p["tau_slow"] / n**2)
    return e + p["drained"] * drained + 0.5 * p["fast"] * lag(e, dt, p["tau_fast"])


@njit(cache=True)
def _lag_uneven_steps(x, dt, tau):  # type: ignore[no-untyped-def]
    y = np.empty_like(x)
    y[0] = x[0]
    for i in range(1, x.size):
        e = np.exp(-dt[i] / tau)
        y[i] = e * y[i - 1] + (1 - e) * 0.5 * (x[i] + x[i - 1])
    return y


@njit(cache=True)
def _plastic_flow(s, dt, threshold, hardening, rate, recovery):  # type: ignore[no-untyped-def]
    y = np.zeros_like(s)
    x = 0.0
    for i in range(1, s.size):
        over = s[i] - threshold - hardening * x
        goal = max(over, 0.0) / hardening
        x += goal * (1 - np.exp(-rate * dt[i])) - x * (1 - np.exp(-dt[i] / recovery))
        y[i] = x
    return y


def plastic(s: Array, dt: Array, p: Parameters) -> Array:
    """Conventional skin in series with a hardening viscoplastic (Perzyna) element that recovers over minutes."""
    flow = _plastic_flow(s, dt, 0.15 * p["reference"], p["reference"] / p["plastic"], 0.6, p["recovery"])
    height: Array = conventional(s, dt, p) + p["amplitude"] * flow
    return height


@njit(cache=True)
def _eyring(e, dt, rate, ease):  # type: ignore[no-untyped-def]
    y = np.zeros_like(e)
    x = 0.0
    for i in range(1, e.size):
        n = 1 + int(dt[i] / 0.006)
        for _ in range(n):
            mid = x + 0.5 * dt[i] / n * rate * np.sinh((e[i] - x) * ease) / ease
            x += dt[i] / n * rate * np.sinh((e[i] - mid) * ease) / ease
        y[i] = x
    return y


def activated(s: Array, dt: Array, p: Parameters) -> Array:
    """Rate-dependent skin: a Kelvin element whose dashpot flows as sinh of its stress (Eyring): it thins with load."""
    e = _curve(s, p)
    x = _eyring(e / p["amplitude"], dt, 1 / p["tau_slow"], p["ease"])
    height: Array = e + (p["fast"] + p["slow"]) * p["amplitude"] * x
    return height


LAWS: dict[str, Callable[[Array, Array, Parameters], Array]] = {
    "conventional": conventional,
    "fractional": fractional,
    "membrane": membrane,
    "poroelastic": poroelastic,
    "plastic": plastic,
    "activated": activated,
}
_FREE: dict[str, tuple[str, ...]] = {
    "conventional": ("fast", "slow", "tau_fast", "tau_slow"),
    "fractional": ("springpot", "alpha"),
    "membrane": ("stiffening", "viscosity", "maxwell", "tau_slow"),
    "poroelastic": ("drained", "clogging", "tau_slow", "fast"),
    "plastic": ("fast", "slow", "tau_fast", "tau_slow", "plastic", "recovery"),
    "activated": ("fast", "tau_slow", "ease"),
}


def free_parameters(law: str) -> tuple[str, ...]:
    """Names of the parameters that a fit of this law would leave free (nuisance of the detectability)."""
    return ("amplitude",) + (() if law == "membrane" else ("bend",)) + _FREE[law]


def draw(instrument: str, rng: np.random.Generator) -> Parameters:
    """One person's skin: heights of 0.1-0.6 mm (Cutometer, 2 mm opening) or 1-3.5 mm (aspiration)."""
    cut = instrument == "cutometer"

    def between(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    return {
        "reference": 300e2 if cut else 150e2,
        "amplitude": (0.22e-3 if cut else 1.45e-3) * float(np.exp(rng.normal(0, 0.16))),
        "bend": between(0.1, 0.6),
        "kind": float(rng.integers(0, 3)),
        "fast": between(0.06, 0.2),
        "tau_fast": between(0.15, 0.7),
        "slow": between(0.1, 0.3),
        "tau_slow": between(3.0, 11.0),
        "springpot": between(0.15, 0.3),
        "alpha": between(0.12, 0.3),
        "stiffening": between(0.3, 0.9),
        "viscosity": between(0.04, 0.15),
        "maxwell": between(0.2, 0.5),
        "drained": between(0.2, 0.45),
        "clogging": between(0.2, 1.5),
        "plastic": between(0.05, 0.15),
        "recovery": between(60.0, 300.0),
        "ease": between(1.0, 4.0),
    }
