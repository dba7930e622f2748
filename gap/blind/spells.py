"""Effects that come and go, wander, or act at one place: events rather than properties of instruments.

Knobs of a spell: its strength, ``spell_in`` (the recording), ``spell_at`` (share of it that has passed) and
``spell_for`` [s]. The others are told where they act.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .instants import Knobs
from .session import Session
from .signals import Array, lag

EDGE = 0.15  # s, in which a spell sets in and ends
_OPENING = {"cutometer": 0.3e-3, "aspiration": 2e-3}  # m, a usual height


def spell(s: Session, fx: Knobs, t: Array) -> Array:
    """How far a spell has set in (0 to 1) at session times ``t``."""
    r = s.recordings[int(fx["spell_in"]) % len(s.recordings)]
    begin = r.start + r.onset + fx["spell_at"] * (r.duration - r.onset)
    u, v = (t - begin) / EDGE, (t - begin - fx["spell_for"]) / EDGE
    return np.asarray(0.5 * (np.tanh(u) - np.tanh(v)))


def rhythm(t: Array, hertz: float, wander: float, phase: float) -> Array:
    """A rhythm whose frequency swings by a share ``wander``, and whose phase with it."""
    swing = wander * hertz * (2.3 * np.sin(t / 2.3 + phase) + 5.1 * np.sin(t / 7.9) + 11.0 * np.sin(t / 31.0 + 1.0))
    return np.asarray(np.sin(2 * np.pi * (hertz * t + swing) + phase))


def chamber(s: Session, p: Array, fx: Knobs) -> Array:
    """Suction in the chamber: a leak for a while; a leak that an integral repairs in holds, but not in ramps."""
    if a := fx.get("leak_spell", 0.0):
        p = p * (1 - a * spell(s, fx, s.t))
    if a := fx.get("leak_repaired", 0.0):
        p = p - a * (p - lag(p, s.dt, fx["repair"]))
    return p


def probe_suction(s: Session, p: Array, fx: Knobs) -> Array:
    """Suction under the probe: the rim lifts for a while; a hose that loses some and delays the rest."""
    if a := fx.get("rim_spell", 0.0):
        p = p * (1 - a * spell(s, fx, s.t))
    if a := fx.get("hose_loss", 0.0):
        p = (1 - a) * lag(p, s.dt, a * fx["hose_tau"])
    return p


def skin_height(s: Session, h: Array, size: float, fx: Knobs) -> Array:
    """Skin (heights of about ``size``): muscle tone for a while; a pulse or breath that keeps no time."""
    if a := fx.get("tone_spell", 0.0):
        h = h * (1 - a * spell(s, fx, s.t))
    if a := fx.get("pulse_wander", 0.0):
        h = h + a * (0.3 + h / size) * rhythm(s.t, fx["pulse_hz"], fx["wander"], fx["pulse_phase"])
    return h


def optics(s: Session, h: Array, fx: Knobs) -> Array:
    """Height sensor: another gain for a while; a scratch, which bends the scale at one height."""
    if a := fx.get("gain_spell", 0.0):
        h = h * (1 + a * spell(s, fx, s.t))
    if a := fx.get("scratch", 0.0):
        size = _OPENING[s.instrument]
        h = h + a * size * np.exp(-(((h / size - fx["scratch_at"]) / 0.25) ** 2))
    return h


def gauge(s: Session, fx: Knobs) -> Callable[[Array], Array]:
    """The error of a gauge that reads too much for a while, as a function of session times (n,) [Pa]."""
    a = fx.get("gauge_spell", 0.0)
    return lambda t: a * spell(s, fx, t) if a else np.zeros_like(t)


def resistance(s: Session, u: Array, f: Array, fx: Knobs) -> Array:
    """Force (N, 3) [N] with which skin resists a displacement u (N, 3) [m]: tone or tension for a while, rhythms."""
    if a := fx.get("tone_spell", 0.0):
        f = f * (1 + a * spell(s, fx, s.t))[:, None]
    if a := fx.get("tension_spell", 0.0):
        n = np.array([np.cos(fx["fibre"]), np.sin(fx["fibre"]), 0.0])
        f = f + a * 500.0 * (spell(s, fx, s.t) * (u @ n))[:, None] * n
    if a := fx.get("pulse_wander", 0.0):
        wave = rhythm(s.t, fx["pulse_hz"], fx["wander"], fx["pulse_phase"])
        f = f + a * wave[:, None] * (np.array([0.2, 0.1, 1.0]) + u / 2e-3)
    return f


def head(s: Session, f: Array, fx: Knobs) -> Array:
    """Force (N, 3) [N] in the frame of a head that is turned about an axis of any direction (Rodrigues)."""
    a = fx.get("rotated", 0.0)
    if not a:
        return f
    up, around = fx["axis_up"], fx["axis_around"]
    k = np.array([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)])
    along = (f @ k)[:, None] * k
    return np.asarray(f * np.cos(a) + np.cross(k, f) * np.sin(a) + along * (1 - np.cos(a)))


def transducers(s: Session, x: Array, fx: Knobs) -> Array:
    """Compressions (N, 3) [N]: a gain for a while, six cross-talk terms, all legs drifting."""
    if a := fx.get("gain_spell", 0.0):
        x = x.copy()
        x[:, int(fx["leg"])] *= 1 + a * spell(s, fx, s.t)
    if a := fx.get("cross_matrix", 0.0):
        terms = np.random.default_rng(int(fx["cross_seed"])).uniform(-1, 1, (3, 3))
        np.fill_diagonal(terms, 0.0)
        x = x + a * x @ terms
    if a := fx.get("drift_all", 0.0):
        pace = np.random.default_rng(int(fx["cross_seed"])).uniform(0.3, 1.0, 3)
        x = x + a * pace * (s.t / 60.0 + 0.3 * np.sin(s.t / 40.0))[:, None]
    return x


def computed(name: str, x: Array, fx: Knobs) -> Array:
    """A computed channel ``name`` (n,) of the robot: a factor or a zero of this one alone."""
    if fx.get("one_channel", -1.0) != float("xyz".find(name[-1])) or not name.startswith(("force", "probe")):
        return x
    if name.startswith("force"):
        return x * fx.get("force_factor", 1.0) + fx.get("force_zero", 0.0)
    return x * fx.get("probe_factor", 1.0)
