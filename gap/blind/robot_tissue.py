"""Skin under the robot's probe: laws from displacement (N, 3) [m] to the force that the skin resists with (N, 3) [N].

``conventional`` is an anisotropic nonlinear quasi-linear viscoelastic skin; the others are the wrong laws of tiers T3
and T6. All are written in the principal axes of the person's skin (turned by ``heading`` about z).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import njit

from .signals import Array, lag, play, spectrum

Parameters = dict[str, float]
SPAN = 1.3e-3  # m, reference displacement


def columns(f: Callable[..., Array], u: Array, *constants: object) -> Array:
    """Apply an operator on signals, ``f(x, *constants)``, to every column of u (N, 3)."""
    return np.stack([f(np.ascontiguousarray(u[:, k]), *constants) for k in range(3)], axis=1)


def _turned(u: Array, heading: float) -> Array:
    c, s = np.cos(heading), np.sin(heading)
    turned: Array = u @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return turned


def _springs(p: Parameters) -> Array:
    return p["stiffness"] * np.array([1.0, p["cross_ratio"], p["normal_ratio"]])


def _elastic(u: Array, p: Parameters) -> Array:
    """F_i = k_i u_i (1 + b |u|^2 / span^2)."""
    force: Array = _springs(p) * u * (1 + p["stiffening"] * np.sum(u**2, axis=1, keepdims=True) / SPAN**2)
    return force


def conventional(u: Array, dt: Array, p: Parameters) -> Array:
    """Quasi-linear viscoelasticity with two relaxation modes."""
    e = _elastic(u, p)
    out = e - p["fast"] * columns(lag, e, dt, p["tau_fast"])
    return out - p["slow"] * columns(lag, e, dt, p["tau_slow"])


def fractional(u: Array, dt: Array, p: Parameters) -> Array:
    """Relaxation (1 + t / 50 ms)^-alpha, as a spectrum of lags tau^(-alpha)."""
    e = _elastic(u, p)
    taus = np.geomspace(0.02, 300.0, 9)
    weights = np.exp(-0.05 / taus) * (taus / 0.05) ** -p["alpha"]
    weights *= p["alpha"] * np.log(taus[1] / taus[0])
    return e - columns(spectrum, e, dt, taus, weights)


def exponential(u: Array, dt: Array, p: Parameters) -> Array:
    """Fung's exponential stiffening of the part of the displacement that has not relaxed: memory inside the curve."""
    fresh = u - p["fast"] * columns(lag, u, dt, p["tau_fast"])
    fresh = fresh - p["slow"] * columns(lag, u, dt, p["tau_slow"])
    force: Array = (
        _springs(p) * fresh * np.exp(1.6 * p["stiffening"] * np.sum(fresh**2, axis=1, keepdims=True) / SPAN**2)
    )
    return force


def poroelastic(u: Array, dt: Array, p: Parameters) -> Array:
    """Drainage: relaxation modes of weight 1/n^2 and time tau/n^2 (n odd), faster where the skin is deformed."""
    e = _elastic(u, p)
    faster = dt * (1 + p["clogging"] * np.sum(u**2, axis=1) / SPAN**2)
    out = e - 0.5 * p["fast"] * columns(lag, e, dt, p["tau_fast"])
    for n in (1, 3, 5, 7, 9):
        weight = p["drained"] * 8 / np.pi**2 / n**2
        out = out - weight * columns(_uneven, e, faster, p["tau_slow"] / n**2)
    return out


@njit(cache=True)
def _uneven(x, dt, tau):  # type: ignore[no-untyped-def]
    y = np.empty_like(x)
    y[0] = x[0]
    for i in range(1, x.size):
        e = np.exp(-dt[i] / tau)
        y[i] = e * y[i - 1] + (1 - e) * 0.5 * (x[i] + x[i - 1])
    return y


def plastic(u: Array, dt: Array, p: Parameters) -> Array:
    """Conventional skin beside four spring-slider pairs (Iwan): loops that do not depend on rate."""
    out = 0.85 * conventional(u, dt, p)
    for share, width in ((0.4, 0.1), (0.3, 0.25), (0.2, 0.5), (0.1, 0.9)):
        slid = u - columns(play, u, width * SPAN)
        out = out + p["plastic"] * share * _springs(p) * slid
    return out


@njit(cache=True)
def _sinh_dashpot(x, dt, tau, ease):  # type: ignore[no-untyped-def]
    y = np.zeros_like(x)
    v = 0.0
    for i in range(1, x.size):
        mid = v + 0.5 * dt[i] * np.sinh(ease * (x[i] - v)) / (ease * tau)
        v += dt[i] * np.sinh(ease * (0.5 * (x[i] + x[i - 1]) - mid)) / (ease * tau)
        y[i] = v
    return y


def activated(u: Array, dt: Array, p: Parameters) -> Array:
    """A Maxwell arm whose dashpot flows as sinh of its stress (Eyring): relaxes faster where it is stressed more."""
    e = _elastic(u, p)
    scale = p["stiffness"] * SPAN
    share = p["fast"] + p["slow"]
    return e - share * scale * columns(_sinh_dashpot, e / scale, dt, p["tau_slow"], p["ease"])


LAWS: dict[str, Callable[[Array, Array, Parameters], Array]] = {
    "conventional": conventional,
    "fractional": fractional,
    "exponential": exponential,
    "poroelastic": poroelastic,
    "plastic": plastic,
    "activated": activated,
}
_FREE: dict[str, tuple[str, ...]] = {
    "conventional": ("fast", "slow", "tau_fast", "tau_slow"),
    "fractional": ("alpha",),
    "exponential": ("fast", "slow", "tau_fast", "tau_slow"),
    "poroelastic": ("fast", "drained", "clogging", "tau_slow"),
    "plastic": ("fast", "slow", "tau_fast", "tau_slow", "plastic"),
    "activated": ("fast", "tau_slow", "ease"),
}


def free_parameters(law: str) -> tuple[str, ...]:
    """Names of the parameters that a fit of this law would leave free (nuisance of the detectability)."""
    return ("stiffness", "cross_ratio", "normal_ratio", "heading", "stiffening") + _FREE[law]


def resist(law: str, u: Array, dt: Array, p: Parameters) -> Array:
    """Force (N, 3) [N] with which skin of ``law`` resists a displacement u (N, 3) [m], in the instrument's axes."""
    own = _turned(u, p["heading"])
    return _turned(LAWS[law](own, dt, p), -p["heading"])


def draw(rng: np.random.Generator) -> Parameters:
    """One person's skin: about 0.5-1.2 N at 1.3 mm, 12-34 % of the energy lost in a cycle at 0.1 Hz."""

    def between(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    return {
        "stiffness": 640.0 * float(np.exp(rng.normal(0, 0.16))),
        "cross_ratio": between(0.7, 1.3),
        "normal_ratio": between(0.7, 1.5),
        "heading": between(-0.8, 0.8),
        "stiffening": between(0.1, 0.6),
        "fast": between(0.12, 0.28),
        "tau_fast": between(0.4, 1.2),
        "slow": between(0.12, 0.26),
        "tau_slow": between(2.5, 8.0),
        "alpha": between(0.06, 0.14),
        "drained": between(0.2, 0.4),
        "clogging": between(0.3, 2.0),
        "plastic": between(0.15, 0.5),
        "ease": between(1.0, 4.0),
    }
