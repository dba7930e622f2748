"""The suction chain (Cutometer and aspiration): command -> regulator -> skin -> gauge and height -> file.

Inside, suction is a positive pressure in pascals and heights are metres. Without knobs it is the ideal instrument
of README.md. ``fx`` holds the knobs of the effects that are switched on; each stage reads its own.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy

import numpy as np
from numba import njit

from . import specimens, spells
from .controllers import controlled
from .instants import Knobs, taken
from .session import Session
from .signals import (
    Array,
    bristle,
    coarsened,
    lag,
    play,
    power_law_memory,
    running_max,
    spectrum,
    sticky,
    uneven_lag,
    wander,
)
from .tissue import LAWS, Parameters, _plastic_flow

Channels = dict[str, list[Array]]


@njit(cache=True)
def _store(p, dt, use, refill, capacity):  # type: ignore[no-untyped-def]
    """Vacuum store: level falls with flow into it (rising suction and a bleed), refills, and caps the suction."""
    y = np.empty_like(p)
    level = 1.0
    y[0] = p[0]
    for i in range(1, p.size):
        drawn = max(p[i] - p[i - 1], 0.0) + 0.3 * p[i] * dt[i]
        level += (1.0 - level) * (1 - np.exp(-dt[i] / refill)) - use * drawn
        level = max(level, 0.0)
        y[i] = min(p[i], capacity * level)
    return y


def chamber_suction(s: Session, fx: Knobs, rng: np.random.Generator) -> Array:
    """Command and actuator stages: true suction in the chamber (N,) [Pa]."""
    get = fx.get
    t = s.t - get("latency", 0.0) - get("latency_tolerance", 0.0)
    if poll := get("poll", 0.0):
        t = np.floor(s.t / poll) * poll
    c = s.command(t)
    on = c > 0
    c = np.where(on, (c - get("loop_offset", 0.0)) / (1 + get("loop_gain", 0.0)), 0.0)
    if tau := get("lag", 0.0):
        c = lag(c, s.dt, tau)
    if tau := get("lag_cascade", 0.0):
        for _ in range(3):
            c = lag(c, s.dt, tau / 3)
    if tau := get("lag_fall", 0.0):
        c = uneven_lag(c, s.dt, tau * get("lag_ratio", 1.0), tau)
    if tau := get("lag_parallel", 0.0):
        share = get("lag_share", 0.3)
        c = (1 - share) * c + share * lag(c, s.dt, tau)
    if sag := get("sag", 0.0):
        c = c * (1 - sag * lag((c > 0).astype(float), s.dt, get("sag_tau", 8.0)))
    if band := get("sleep", 0.0):
        c = sticky(c, band, 0.2 * band)
    zeta = 1.0 + get("damping_tolerance", 0.0) - get("underdamped", 0.0)
    leak = (get("leak", 0.0), get("leak_root", 0.0), get("leak_late", 0.0), get("leak_at", 0.0))
    slew = (get("slew", 0.0), get("slew_soft", 0.0))
    quick = 1 + get("regulator_tolerance", 0.0)
    p = controlled(c, s.dt, quick, zeta, (*slew, *leak, get("band", 0.0)), get("lead", 0.0), fx)
    if use := get("store_use", 0.0):
        p = _store(p, s.dt, use, get("store_refill", 30.0), get("store_margin", 1.1) * float(c.max()))
    return _unusual_actuator(s, spells.chamber(s, p, fx), fx, rng)


def _unusual_actuator(s: Session, p: Array, fx: Knobs, rng: np.random.Generator) -> Array:
    """Actuator effects outside the vocabulary (tier T5)."""
    if a := fx.get("pump_ripple", 0.0):
        p = p * (1 + a * np.sin(2 * np.pi * fx["ripple_hz"] * s.t + 0.3 * np.sin(0.4 * s.t)))
    if a := fx.get("condensate", 0.0):  # water drops in the hose hold back air until a suction frees them, at random
        blocked = np.zeros_like(p)
        for r in s.recordings:
            begin = r.start + r.onset + rng.uniform(0.3, 4.0)
            blocked += np.exp(-(((s.t - begin) / rng.uniform(0.3, 1.0)) ** 2))
        p = p * (1 - a * np.clip(blocked, 0, 1))
    if a := fx.get("adiabatic", 0.0):  # gas heats and cools as it is pumped: a share of every change decays away
        p = np.maximum(p + a * (p - lag(p, s.dt, fx["adiabatic_tau"])), 0.0)
    return p


def skin_suction(s: Session, p: Array, fx: Knobs) -> Array:
    """Interface before the tissue: the suction that the skin feels (N,) [Pa]."""
    get = fx.get
    ref = 300e2
    if a := get("rim_leak", 0.0):
        p = p * (1 - a * np.minimum(p / ref, 2.0))
    if a := get("rim_sealing", 0.0):
        p = p * (1 - a * np.exp(-p / get("seal_at", 60e2)))
    if a := get("stick", 0.0):
        p = np.maximum(play(p, a), 0.0)
    if mu := get("stick_coulomb", 0.0):  # normal force grows with suction, so does the play
        p = play(p, 0.1 * mu * ref, mu)
    if a := get("stick_bristle", 0.0):
        p = np.maximum(p - a * (0.3 * ref + p) * bristle(p, get("bristle_scale", 20e2)), 0.0)
    if a := get("preload", 0.0):
        p = p + a
    if a := get("preload_fading", 0.0):  # the pad of skin under the spring relaxes while the probe stands
        since = s.t - s.per_recording([r.start for r in s.recordings])
        p = p + a * (0.4 + 0.6 * np.exp(-since / 6.0))
    return p


def _within_deep_layers(s: Session, p: Array, ref: float, fx: Knobs) -> Array:
    """Suction p (N,) [Pa] less the part that deep layers carry; ``ref`` [Pa] is the law's reference."""
    get = fx.get
    if a := get("deep", 0.0):
        p = p - a * np.maximum(p - get("deep_at", 0.6) * ref, 0.0)
    if a := get("deep_smooth", 0.0):
        w = 0.15 * ref
        over = w * np.logaddexp(0.0, (p - get("deep_at", 0.6) * ref) / w) - w * np.log1p(
            np.exp(-get("deep_at", 0.6) * ref / w)
        )
        p = p - a * lag(over, s.dt, 0.8)
    return p


def _creeping(s: Session, p: Array, h: Array, ref: float, size: float, fx: Knobs) -> Array:
    """Height h (N,) [m] with creep and with flow that stays."""
    get = fx.get
    if a := get("creep", 0.0):
        h = h + a * lag(h, s.dt, get("creep_tau", 60.0))
    if a := get("creep_oneway", 0.0):
        h = h + a * uneven_lag(h, s.dt, get("creep_tau", 40.0), 4 * get("creep_tau", 40.0))
    if a := get("power_creep", 0.0):
        h = h + a * power_law_memory(h, s.dt, get("alpha", 0.2))
    if a := get("log_creep", 0.0):  # flat relaxation spectrum (Fung's box): creep as the logarithm of time
        h = h + a * spectrum(h, s.dt, np.geomspace(0.1, 100.0, 7), np.ones(7))
    if a := get("residual", 0.0):
        h = h + size * _plastic_flow(p, s.dt, get("yield_at", 0.4) * ref, ref / a, 0.5, 1e4)
    if a := get("residual_work", 0.0):
        x = (p / ref) ** 3
        h = h + size * a * (np.cumsum(x * s.dt) / 40.0) / (1 + np.cumsum(x * s.dt) / 40.0)
    return h


def _softened(s: Session, p: Array, h: Array, ref: float, size: float, fx: Knobs) -> Array:
    """Height h (N,) [m] changed by earlier loading, and with stiffening at great heights."""
    get = fx.get
    if a := get("first_loadings", 0.0):
        k = np.cumsum([r.specimen == "skin" for r in s.recordings]) - 1
        h = h * s.per_recording(1 - a * np.exp(-np.maximum(k, 0) / get("series", 1.2)))
    if a := get("mullins", 0.0):  # virgin skin is stiffer; a stretch softens it
        worked = np.cumsum(p / ref * s.dt) / get("softening", 15.0)
        h = h * (1 - a * np.exp(-worked) - 0.5 * a * (h >= running_max(h)))
    if a := get("stiffen", 0.0):
        h = h / (1 + a * (h / size) ** 2)
    if a := get("locking", 0.0):
        h = size / a * (1 - np.exp(-a * h / size))
    return h


def _alive(
    s: Session, p: Array, h: Array, skin: Array, ref: float, size: float, fx: Knobs, rng: np.random.Generator
) -> Array:
    """Height h (N,) [m] with pulse, breath, tone, movement, sweat, blood; ``skin`` (N,) is 1 where it is skin."""
    get = fx.get
    if a := get("pulse", 0.0):
        h = h + a * np.sin(2 * np.pi * get("pulse_hz", 1.1) * s.t + get("pulse_phase", 0.0)) * skin
    if a := get("breath", 0.0):
        phase = np.pi * get("pulse_hz", 0.25) * s.t + 0.6 * np.sin(0.21 * s.t)
        h = h + a * np.abs(np.sin(phase + get("pulse_phase", 0.0))) ** 3 * (0.5 + h / size) * skin
    if a := get("tone", 0.0):
        h = h * (1 - a * s.t / s.length)
    if a := get("tone_step", 0.0):
        h = h * (1 - a / (1 + np.exp(-(s.t - get("tone_at", 0.5) * s.length) / get("tone_width", 3.0))))
    if a := get("restless", 0.0):  # outside the vocabulary: the subject moves, randomly
        h = h + a * wander(s.t, rng, 0.05, 1.5) * skin
    if a := get("sweat", 0.0):  # outside: sweat softens the horny layer the longer the probe stands on it
        worn = np.cumsum((p > 0.02 * ref) * s.dt)
        h = h * (1 + a * worn**1.5 / (worn[-1] ** 1.5 + 1e-9)) + 0.3 * a * size * (p / ref) * (worn / (worn[-1] + 1e-9))
    if a := get("blood", 0.0):  # outside: vessels fill under suction and empty at a threshold pressure
        h = h + a * size * lag((p > 0.25 * ref).astype(float), s.dt, get("blood_tau", 6.0))
    return h


def skin_height(s: Session, p: Array, law: str, tissue: Parameters, fx: Knobs, rng: np.random.Generator) -> Array:
    """Tissue stage with its effects: apex height (N,) [m] of the skin for felt suction ``p``.

    While a block stands under the probe the skin is unloaded, yet it still remembers: its height is then nobody's.
    """
    skin = s.per_recording([float(r.specimen == "skin") for r in s.recordings])
    ref, size = tissue["reference"], tissue["amplitude"]
    p = _within_deep_layers(s, p * skin, ref, fx)
    h = LAWS[law](p, s.dt, tissue)
    h = _creeping(s, p, h, ref, size, fx)
    h = _softened(s, p, h, ref, size, fx)
    return _alive(s, p, h, skin, ref, size, fx, rng)


def probe_height(s: Session, p: Array, h: Array, fx: Knobs) -> Array:
    """Interface after the tissue: how far the apex stands above the probe's plane (N,) [m]."""
    get = fx.get
    ref = 300e2
    if a := get("tilt", 0.0):
        h = h + a * (1 - np.exp(-p / get("seat_at", 60e2)))
    if a := get("tilt_seating", 0.0):  # the probe rocks flat at the first suction of a recording, and stays
        for r in s.recordings:
            inside = (s.t >= r.start) & (s.t <= r.start + r.duration + 0.5)
            h = h + a * np.where(inside, 1 - np.exp(-running_max(np.where(inside, p, 0.0)) / get("seat_at", 60e2)), 0.0)
    if a := get("recoil", 0.0):
        h = h + a * p / ref
    if a := get("recoil_damped", 0.0):
        stop = get("recoil_stop", 0.8)
        h = h + a * lag(stop * np.tanh(p / ref / stop), s.dt, get("recoil_tau", 0.3))
    return h


def _seen(h: Array, size: float, fx: Knobs) -> Array:
    """Height h (N,) [m] through optics that bend, cut off or look askew; ``size`` [m] is a typical height."""
    get = fx.get
    if a := get("quadratic", 0.0):
        h = h + a * h * (h / size - 1)
    if a := get("waves", 0.0):
        h = h + a * size * np.sin(np.pi * h / size * get("wave_number", 1.0))
    if a := get("edge", 0.0):  # a threshold set too high cuts a rim of the dome that grows as the dome does
        h = h - a * (1 - np.exp(-np.maximum(h, 0) / (0.25 * size)))
    if a := get("edge_shaded", 0.0):
        h = h - a * np.sqrt(np.maximum(h, 0) / size) * (1 + 0.3 * np.sin(2 * np.pi * h / size))
    if k := get("barrel", 0.0):
        y = h - get("centre", 0.5) * size
        h = h + k * y**3 / size**2
    if k := get("barrel_division", 0.0):
        y = (h - get("centre", 0.5) * size) / size
        h = size * (y / (1 + k * y**2 + 0.5 * k * y**4) + get("centre", 0.5))
    if a := get("askew", 0.0):
        h = h * np.cos(a) - np.sin(a) * (np.sqrt(size**2 + np.maximum(h, 0) ** 2) - size)
    if a := get("askew_foreshortened", 0.0):
        h = h * np.cos(a) / (1 + np.sin(a) * h / (4 * size))
    return h


def _late(s: Session, h: Array, size: float, fx: Knobs) -> Array:
    """Height h (N,) [m] through a sensor with play or lag."""
    get = fx.get
    if a := get("play_height", 0.0):
        h = play(h, a)
    if a := get("preisach", 0.0):
        h = h - a * sum(bristle(h, f * size) for f in (0.03, 0.1, 0.3)) / 3
    if tau := get("low_pass", 0.0):
        h = lag(h, s.dt, tau)
    if tau := get("low_pass_twice", 0.0):
        h = lag(lag(h, s.dt, 0.35 * tau), s.dt, 0.65 * tau)
    return h


def _wandering(s: Session, h: Array, size: float, fx: Knobs, rng: np.random.Generator) -> Array:
    """Height h (N,) [m] with zero and scale that change with time."""
    get = fx.get
    minutes = s.t / 60.0
    h = h + get("drift", 0.0) * minutes
    if a := get("warm_up", 0.0):
        since = s.t - s.per_recording([r.start for r in s.recordings])
        h = h + a * (1 - np.exp(-since / get("warm_tau", 12.0)))
    if a := get("walk", 0.0):
        h = h + a * wander(s.t, rng, 0.003, 0.12)
    if a := get("fading", 0.0):
        h = h * (1 - a * minutes)
    if a := get("lamp", 0.0):
        since = s.t - s.per_recording([r.start for r in s.recordings])
        h = h * (1 + a * np.exp(-since / get("lamp_tau", 6.0))) + 0.1 * a * size * np.exp(-since / get("lamp_tau", 6.0))
    return h


def read_height(s: Session, p: Array, h: Array, fx: Knobs, rng: np.random.Generator) -> Array:
    """Height sensor on the grid, before zeroing (N,) [m]; h is not yet zeroed, its resting value is near 0."""
    get = fx.get
    size = {"cutometer": 0.3e-3, "aspiration": 2e-3}[s.instrument]
    after = s.per_recording([float(k >= get("from_recording", 0.0)) for k in range(len(s.recordings))])
    h = h * (1 + get("gain", 0.0)) * (1 + get("gain_later", 0.0) * after)
    h = _late(s, _seen(h, size, fx), size, fx)
    h = _wandering(s, h, size, fx, rng)
    h = h + get("from_pressure", 0.0) * p / 300e2
    if a := get("from_flow", 0.0):
        h = h + a * np.gradient(lag(p, s.dt, 0.05), s.t) / 300e2
    if a := get("hum", 0.0):  # outside the vocabulary: interference in bursts
        h = h + a * np.sin(2 * np.pi * get("hum_hz", 3.3) * s.t) * (np.sin(0.37 * s.t + get("hum_phase", 0.0)) > 0.3)
    if a := get("fog", 0.0):  # outside: the window fogs with each suction and clears slowly, dimming tall domes more
        fog = lag(p / 300e2, s.dt, 15.0)
        h = h * (1 - a * fog * np.abs(h) / size)
    return h


def simulate(
    s: Session, law: str, tissue: Parameters, fx: Knobs, scatter: Array, seed: int, noisy: bool = False
) -> Channels:
    """Recorded channels ``pressure`` (negative for suction) and ``apex_height``, one array a recording.

    ``scatter`` (R,) multiplies the skin's compliance in each recording. ``seed`` fixes every random part of the
    effects and the noise. Without ``noisy`` neither noise nor nominal quantisation is added.

    Each specimen has its own height signal over the whole session, and a recording is read from its specimen's: so
    neither the memory of the skin nor that of a sensor which has seen it can reach a rigid block.
    """
    rng = np.random.default_rng(seed)
    p = chamber_suction(s, fx, rng)
    felt = spells.probe_suction(s, skin_suction(s, p, fx), fx)
    skin = spells.skin_height(s, skin_height(s, felt, law, tissue, fx, rng), tissue["amplitude"], fx)
    skin = skin * s.per_recording(scatter)
    apex = {"skin": skin}
    for r in s.recordings:
        if r.specimen != "skin":
            here = specimens.height(s, r, felt, tissue["amplitude"], seed)
            inside = (s.t >= r.start) & (s.t <= r.start + r.duration)
            apex[r.specimen] = np.where(inside, here, apex.get(r.specimen, 0.0))
    heights = {on: _read(s, p, h, fx, deepcopy(rng)) for on, h in apex.items()}
    out: Channels = {"pressure": [], "apex_height": []}
    second = spells.probe_suction(s, p, fx)
    for k, r in enumerate(s.recordings):
        h = heights[r.specimen]
        rows = np.random.default_rng((seed, k))
        stamps = s.stamps(k)
        when = taken(stamps, 1 / s.rate, k, fx, rows)
        pressure = _gauge(s.sampled(when.main, p, fx), k, spells.gauge(s, fx)(stamps), fx)
        height = s.sampled(when.second - fx.get("height_tolerance", 0.0), h, fx) - _zero(s, k, h, fx)
        if a := fx.get("offset", 0.0):
            height = height + a
        if a := fx.get("offset_jump", 0.0):
            height = height + a * (stamps > r.start + fx["jump_at"] * r.duration)
        pressure = pressure + fx.get("from_height", 0.0) * height / 1e-3
        gauge, optics = s.lab.noise["pressure"], s.lab.noise["apex_height"]
        if noisy:
            pressure = pressure + gauge.draw(pressure.size, 1 / s.rate, rows)
            # The zero is one reading, with the noise of one.
            height = height + optics.draw(height.size, 1 / s.rate, rows) - optics.rms * rows.normal()
        height = _digits(height, optics.step, fx, noisy)
        if noisy:
            pressure = np.round(pressure / gauge.step) * gauge.step
        if any(r.specimen == "manometer" for r in s.recordings):
            there = s.sampled(when.main, second, {}) if r.specimen == "manometer" else np.zeros(0)
            noise = 0.3 * gauge.rms * np.random.default_rng((seed, k, 5)).standard_normal(there.size)
            out.setdefault("pressure_reference", []).append(-(there + noise * noisy)[when.row] if there.size else there)
        out["pressure"].append(-_units(pressure, "pressure", k, fx)[when.row])
        out["apex_height"].append(_units(height, "height", k, fx)[when.row])
    return out


def _read(s: Session, p: Array, h: Array, fx: Knobs, rng: np.random.Generator) -> Array:
    return spells.optics(s, read_height(s, p, probe_height(s, p, h, fx), fx, rng), fx)


def _gauge(p: Array, k: int, wrong: Array, fx: Knobs) -> Array:
    """The recorded gauge's reading of suction p in recording k, ``wrong`` Pa off for a spell; offsets and gains that
    its loop does not see act here."""
    p = p * (1 + fx.get("gain_tolerance", 0.0)) + fx.get("zero_tolerance", 0.0)
    later = float(k >= fx.get("from_recording", 0.0))
    p = p + wrong + fx.get("loop_offset", 0.0) + fx.get("gauge_offset", 0.0) + fx.get("gauge_shift", 0.0) * later
    p = p * (1 + fx.get("loop_gain", 0.0)) * (1 + fx.get("gauge_gain", 0.0))
    return p + fx.get("gauge_gain_high", 0.0) * np.maximum(p - 100e2, 0.0)


def _zero(s: Session, k: int, h: Array, fx: Knobs) -> float:
    """Height that is taken as zero in recording k: the one when suction starts, in a sound instrument."""
    r = s.recordings[k]
    at = r.start + r.onset
    if delay := fx.get("zero_late", 0.0):
        at += delay
    if window := fx.get("zero_mean", 0.0):
        inside = (s.t > at - 0.3) & (s.t < at + window)
        return float(np.mean(h[inside]))
    return float(np.interp(at, s.t, h))


def _digits(h: Array, step: float, fx: Knobs, noisy: bool) -> Array:
    """Range and resolution of the height sensor."""
    if top := fx.get("ceiling", 0.0):
        h = np.minimum(h, top)
    if top := fx.get("soft_ceiling", 0.0):
        knee = 0.7 * top
        h = np.where(h > knee, knee + (top - knee) * np.tanh((h - knee) / (top - knee)), h)
    return coarsened(h, step, fx.get("coarse", 0.0), fx.get("coarse_uneven", 0.0), noisy)


def _units(x: Array, channel: str, k: int, fx: Mapping[str, float]) -> Array:
    """Conversion to SI in software, right unless a knob says otherwise."""
    factor = fx.get(f"unit_{channel}", 1.0)
    only = fx.get("unit_only", -1.0)
    return x * factor if only < 0 or only == k else x
