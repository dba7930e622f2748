"""The micro-robot's chain: tip set-points -> three closed loops -> probe on skin -> transducers -> tip reaction.

Without knobs it is the ideal instrument of README.md; ``fx`` holds the knobs of the effects that are switched on.
The axes move slowly against a soft skin, so skin and axes are solved in two passes: the load of the commanded path
first, then the loops under that load, corrected for where the axes really went by the skin's tangent stiffness.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from . import specimens, spells
from .instants import Knobs, taken
from .robot_axes import SUBSTEPS, Loop, drawn_after, limited, loops
from .robot_kinematics import (
    LEG_HEIGHT,
    LEG_RADIUS,
    PIVOTS,
    TIP,
    axes_for,
    force_matrix,
    jacobian_at_centre,
    tip,
    tip_and_tilt,
)
from .robot_tissue import SPAN, Parameters, columns, resist
from .session import Recording, Session
from .signals import Array, bristle, coarsened, lag, play, spectrum, uneven_lag, wander
from .suction import Channels

MASS, KP, KI, KD = 0.060, 1500.0, 12000.0, 15.0  # kg, N/m, N/(m s), N s/m: README.md
DRAG = 1.0  # N s/m, of slides and coil
AXES = ("axis_position_1", "axis_position_2", "axis_position_3")
LEGS = ("transducer_force_a", "transducer_force_b", "transducer_force_c")
PROBE = ("probe_x", "probe_y", "probe_z")
FORCE = ("force_x", "force_y", "force_z")
_UNUSED = {"stribeck_speed": 1e-3, "bristle": 1e-5, "cog_pitch": 1e-3}  # lengths and speeds that divide
_SUCTION_ONLY = frozenset({"lag_height", "lag_growing"})


def _targets(s: Session, fx: Knobs) -> Array:
    """Command stage: axis set-points (N, 3) [m]."""
    t = s.t - fx.get("latency", 0.0) - fx.get("latency_tolerance", 0.0)
    if poll := fx.get("poll", 0.0):
        t = np.floor(s.t / poll) * poll
    directions = np.array([r.direction for r in s.recordings])
    starts = np.array([r.begins for r in s.recordings])
    which = np.clip(np.searchsorted(starts, t, side="right") - 1, 0, None)
    way = s.command(t)
    if rate := fx.get("slew", 0.0):
        way = limited(way, s.dt, rate)
    if rate := fx.get("slew_soft", 0.0):
        way = uneven_lag(limited(way, s.dt, rate), s.dt, 2e-5 / rate, 2e-5 / rate)
    q = np.zeros((way.size, 3))
    reach = float(np.max(np.abs(way)))
    grid = np.linspace(-reach, reach, 513)  # linear between: 0.3 nm off at most
    for k, direction in enumerate(directions):
        table, rows = axes_for(grid[:, None] * direction), which == k
        for a in range(3):
            q[rows, a] = np.interp(way[rows], grid, table[:, a])
    return q


def _axis_error(q: Array, fx: Knobs) -> Array:
    """Error of the position sensors, which the loop believes: (N, 3) [m]."""
    error = np.zeros_like(q)
    if a := fx.get("scale_waves", 0.0):
        k = int(fx["axis"])
        error[:, k] = a * np.sin(2 * np.pi * q[:, k] / 4e-3 + fx["wave_phase"]) - a * np.sin(fx["wave_phase"])
    return error


def _platform(q: Array, fx: Knobs) -> Array:
    """Axis positions as the platform sees them: sensor error taken off, play between pivot and slide."""
    q = q - _axis_error(q, fx)
    if b := fx.get("backlash", 0.0):
        q = columns(play, q, b)
    if b := fx.get("backlash_soft", 0.0):
        q = q - b * columns(bristle, q, 2 * b)
    return q


def _felt(s: Session, u: Array, fx: Knobs, rng: np.random.Generator) -> Array:
    """Displacement (N, 3) [m] that the skin feels where the probe moves by u (N, 3): with slip and flow."""
    get = fx.get
    if a := get("slip", 0.0):
        u = u - a * columns(play, u, get("slip_at", 0.5) * SPAN)
    if a := get("slip_gradual", 0.0):
        for w in (0.2, 0.4, 0.6, 0.8):
            u = u - 0.25 * a * columns(play, u, w * SPAN)
    if a := get("restless", 0.0):  # outside the vocabulary: the subject moves
        u = u + a * np.stack([wander(s.t, rng, 0.03, 1.0) for _ in range(3)], axis=1)
    if a := get("expansion", 0.0):  # outside: the frame warms and lifts the tip, not seen by the axes
        u = u + a * np.array([0.3, 0.0, 1.0]) * (1 - np.exp(-s.t / 90.0))[:, None]
    if a := get("residual", 0.0):
        u = u - a * columns(drawn_after, u, s.dt, 0.25 * SPAN, 0.4, 1.0)
    if a := get("residual_power", 0.0):
        u = u - a * columns(drawn_after, u / SPAN, s.dt, 0.0, 0.4, 3.0) * SPAN
    return u


def _compliant(s: Session, u: Array, law: str, tissue: Parameters, fx: Knobs) -> Array:
    """Force (N, 3) [N] of the skin without its effects, through whatever gives between it and the platform."""
    get = fx.get
    f = resist(law, u, s.dt, tissue)
    if a := get("glue", 0.0):  # the glue's compliance [m/N], by fixed point on the skin's displacement
        for _ in range(2):
            f = resist(law, u - a * f, s.dt, tissue)
    if a := get("glue_creeping", 0.0):
        for _ in range(2):
            yielded = f * (0.5 + np.linalg.norm(f, axis=1, keepdims=True)) * 0.5
            f = resist(law, u - a * (f - yielded + columns(lag, yielded, s.dt, 1.5)), s.dt, tissue)
    if a := get("flexure", 0.0):  # outside: the platform's arm bends sideways with the moment of a lateral force
        f = resist(
            law,
            u - a * f * np.array([1.0, 1.0, 0.0]) - a * 0.5 * f[:, [1, 0, 2]] * np.array([1.0, -1.0, 0.0]),
            s.dt,
            tissue,
        )
    return f


def _reaction(s: Session, u: Array, law: str, tissue: Parameters, fx: Knobs, rng: np.random.Generator) -> Array:
    """Interface and tissue: resisting force (N, 3) [N] to a probe displacement u (N, 3) [m]."""
    get = fx.get
    u = _felt(s, u, fx, rng)
    f = _compliant(s, u, law, tissue, fx)
    f = spells.resistance(s, u, _skin_effects(s, u, f, tissue["stiffness"], fx), fx)
    if a := get("pulse", 0.0):
        direction = np.array([0.3, 0.2, 1.0])
        f = f + a * np.sin(2 * np.pi * get("pulse_hz", 1.1) * s.t + get("pulse_phase", 0.0))[:, None] * direction
    if a := get("breath", 0.0):
        wave = (
            np.abs(np.sin(np.pi * get("pulse_hz", 0.25) * s.t + get("pulse_phase", 0.0) + 0.6 * np.sin(0.21 * s.t)))
            ** 3
        )
        f = f + a * wave[:, None] * (np.array([0.0, 0.3, 0.7]) + u / SPAN)
    return f


def _remembering(s: Session, size: Array, f: Array, fx: Knobs) -> Array:
    """Force f (N, 3) [N] with creep and changed by earlier displacement, of ``size`` (N, 1) [m]."""
    get = fx.get
    if a := get("creep", 0.0):
        f = f - a * columns(lag, f, s.dt, get("creep_tau", 60.0))
    if a := get("creep_oneway", 0.0):
        f = f - a * columns(uneven_lag, f, s.dt, get("creep_tau", 40.0), 4 * get("creep_tau", 40.0))
    if a := get("power_creep", 0.0):
        taus = np.geomspace(0.03, 300, 9)
        f = f - a * columns(spectrum, f, s.dt, taus, taus**-0.2)
    if a := get("log_creep", 0.0):
        f = f - a * columns(spectrum, f, s.dt, np.geomspace(0.1, 100.0, 7), np.ones(7))
    if a := get("first_loadings", 0.0):
        order = np.arange(len(s.recordings))
        f = f * s.per_recording(1 + a * np.exp(-order / get("series", 1.2)))[:, None]
    if a := get("mullins", 0.0):  # every direction is virgin when it is first pulled
        for r in s.recordings:
            inside = (s.t >= r.begins) & (s.t < r.start + r.duration)
            worked = np.cumsum(np.where(inside, size[:, 0], 0.0) * s.dt) / SPAN
            f = f * (1 + a * np.where(inside, np.exp(-worked / get("softening", 4.0)), 0.0))[:, None]
    return f


def _stiffening(s: Session, u: Array, size: Array, f: Array, k: float, fx: Knobs) -> Array:
    """Force f (N, 3) [N] with fibres and layers that only a great displacement u (N, 3) reaches."""
    get = fx.get
    if a := get("deep", 0.0):
        f = f + a * k * np.maximum(size - get("deep_at", 0.6) * SPAN, 0) * u / (size + 1e-9)
    if a := get("deep_smooth", 0.0):
        w = 0.12 * SPAN
        over = w * np.logaddexp(0, (size - get("deep_at", 0.6) * SPAN) / w) * u / (size + 0.1 * SPAN)
        f = f + a * k * columns(lag, over, s.dt, 0.8)
    n = np.array([np.cos(get("fibre", 0.0)), np.sin(get("fibre", 0.0)), 0.0])
    along = u @ n
    if a := get("tension", 0.0):
        f = f + a * k * (along**3 / SPAN**2)[:, None] * n
    if a := get("tension_slack", 0.0):
        w = 0.1 * SPAN
        taut = w * (np.logaddexp(0, (np.abs(along) - 0.4 * SPAN) / w) - np.log1p(np.exp(-4.0)))
        f = f + a * k * (np.sign(along) * taut)[:, None] * n
    if a := get("tether", 0.0):
        f = f + a * k * np.maximum(along - get("tether_slack", 0.2) * SPAN, 0)[:, None] * n
    if a := get("tether_exp", 0.0):
        f = f + a * k * SPAN * np.expm1(2 * np.maximum(along, 0) / SPAN)[:, None] / 6 * n
    if a := get("stiffen", 0.0):
        f = f * (1 + a * (size / SPAN) ** 4)
    if a := get("locking", 0.0):
        f = f / (1 - np.minimum(a * size / SPAN, 0.8) ** 3)
    return f


def _skin_effects(s: Session, u: Array, f: Array, k: float, fx: Knobs) -> Array:
    """Tissue effects on the force f (N, 3) [N]; ``k`` is the person's stiffness [N/m]."""
    get = fx.get
    size = np.linalg.norm(u, axis=1, keepdims=True)
    f = _stiffening(s, u, size, _remembering(s, size, f, fx), k, fx)
    if a := get("tone", 0.0):
        f = f * (1 + a * s.t / s.length)[:, None]
    if a := get("tone_step", 0.0):
        f = f * (1 + a / (1 + np.exp(-(s.t - get("tone_at", 0.5) * s.length) / get("tone_width", 3.0))))[:, None]
    return f


def _on_the_head(s: Session, f: Array, normal: Array, fx: Knobs) -> Array:
    """Force (N, 3) [N] in the head's own axes, with the head's weight, for the skin's force on the probe f (N, 3)."""
    get = fx.get
    if a := get("turned", 0.0):
        c, si = np.cos(a), np.sin(a)
        f = f @ np.array([[c, si, 0], [-si, c, 0], [0, 0, 1.0]])
    if a := get("leaning", 0.0):
        c, si = np.cos(a), np.sin(a)
        f = f @ np.array([[c, 0, si], [0, 1.0, 0], [-si, 0, c]])
    if m := get("head_mass", 0.0):
        f = f + 9.81 * m * normal * np.array([1.0, 1.0, 0.0])
    if m := get("head_overhang", 0.0):
        f = f + 9.81 * m * (normal - np.array([0, 0, 1.0])) * np.array([-1.6, -0.7, 1.0])
    return spells.head(s, f, fx)


def _legs(s: Session, f: Array, normal: Array, q: Array, fx: Knobs) -> Array:
    """Transducers: compressions (N, 3) [N] for the skin's force on the probe f (N, 3), tared by the caller."""
    get = fx.get
    f = _on_the_head(s, f, normal, fx)
    real = force_matrix(LEG_HEIGHT * (1 + get("h_error", 0.0)), LEG_RADIUS * (1 + get("w_error", 0.0)))
    x = f @ np.linalg.inv(real).T
    x = x * (1 + np.array([get(f"leg_tolerance_{i}", 0.0) for i in range(3)]))
    x = _disturbed(s, _read(s, x, fx), q, fx)
    return spells.transducers(s, np.asarray(x), fx)


def _read(s: Session, x: Array, fx: Knobs) -> Array:
    """Compressions x (N, 3) [N] through the transducers' own gain, curvature, play and lag."""
    get = fx.get
    k = int(get("leg", 0))
    if a := get("leg_gain", 0.0):
        x[:, k] *= 1 + a
    if a := get("leg_gains", 0.0):
        x = x * (1 + a * np.roll([1.0, -0.6, 0.2], k))
    if a := get("leg_square", 0.0):
        x = x + a * x**2
    if a := get("leg_play", 0.0):
        x = columns(play, x, a)
    if a := get("leg_bristle", 0.0):
        clean = x
        for w in (0.05, 0.2, 0.6):
            x = x - a / 3 * columns(bristle, clean, w)
    if tau := get("low_pass", 0.0):
        x = columns(lag, x, s.dt, tau)
    if tau := get("low_pass_twice", 0.0):
        x = columns(lag, columns(lag, x, s.dt, 0.35 * tau), s.dt, 0.65 * tau)
    return x


def _disturbed(s: Session, x: Array, q: Array, fx: Knobs) -> Array:
    """Readings x (N, 3) [N] with crosstalk, drift and interference; q (N, 3) [m] are the axes."""
    get = fx.get
    k = int(get("leg", 0))
    if a := get("leg_into_leg", 0.0):
        x[:, (k + 1) % 3] += a * x[:, k]
    if a := get("axis_into_leg", 0.0):
        x[:, k] += a * q[:, (k + 1) % 3] / 1e-3
    if a := get("drift", 0.0):
        x[:, k] += a * s.t / 60.0
    if a := get("warm_up", 0.0):
        x = x + a * np.roll([1.0, 0.4, -0.5], k) * (1 - np.exp(-s.t / get("warm_tau", 60.0)))[:, None]
    if a := get("hum", 0.0):  # outside the vocabulary: interference in bursts
        x[:, k] += a * np.sin(2 * np.pi * get("hum_hz", 7.3) * s.t) * (np.sin(0.37 * s.t) > 0.3)
    if a := get("cable", 0.0):  # outside: a cable drags on the head, elastic with dry friction inside
        x = x + a * (columns(bristle, q, 4e-4) + q / 1e-3) * np.roll([1.0, 0.2, -0.6], k)
    return x


def simulate(
    s: Session, law: str, tissue: Parameters, fx: Knobs, scatter: Array, seed: int, noisy: bool = False
) -> Channels:
    """Recorded channels of devices' section 3, one array a recording; see ``suction.simulate`` for the arguments.

    Axes and transducers are solved once with the skin and, where there is a recording in open air, once more without
    any: neither a load of the skin nor the memory of loops and transducers can reach that recording.
    """
    skin = s.per_recording([float(r.specimen == "skin") for r in s.recordings])[:, None]
    factor = skin * s.per_recording(scatter)[:, None]
    ref = _targets(s, fx)
    base = _platform(ref, fx)
    first = factor * _reaction(s, skin * tip(base), law, tissue, fx, np.random.default_rng(seed))
    j = jacobian_at_centre()
    q = _axes(s, ref, base, -first @ j, 0.75 * tissue["stiffness"] * j.T @ j, fx)
    u, normal = tip_and_tilt(np.ascontiguousarray(_platform(q, fx)), PIVOTS, TIP)
    resisted = factor * _reaction(s, skin * u, law, tissue, fx, np.random.default_rng(seed))
    traces = {"skin": (q, _tared(_legs(s, -resisted, normal, q, fx)))}
    for r in {r.specimen: r for r in s.recordings if r.specimen != "skin"}.values():
        traces[r.specimen] = _on_reference(s, r, ref, base, fx, seed)
    if delay := fx.get("tare_late", 0.0):  # one tare for the session: it is in every recording
        r = next(r for r in s.recordings if r.specimen == "skin")
        tare = _at(s, r.start + r.onset + delay, traces["skin"][1])
        traces = {on: (q, legs - tare) for on, (q, legs) in traces.items()}
    return _record(s, traces, fx, seed, noisy)


def _on_reference(s: Session, r: Recording, ref: Array, base: Array, fx: Knobs, seed: int) -> tuple[Array, Array]:
    """Axis positions and transducers (N, 3) with a reference specimen on the probe all the time, tared without it."""
    k, hung = specimens.spring_of(r, s.instrument, seed), specimens.weight_of(r, s.instrument, seed)
    j = jacobian_at_centre()
    pulled = hung - k * tip(base)
    q = _axes(s, ref, base, pulled @ j, k * j.T @ j, fx)
    u, normal = tip_and_tilt(np.ascontiguousarray(_platform(q, fx)), PIVOTS, TIP)
    legs = _legs(s, hung - k * u, normal, q, fx)
    if np.any(hung):  # tared before the weight is hung
        free = np.zeros_like(ref)
        bare = _axes(s, ref, base, free, np.zeros((3, 3)), fx)
        _, upright = tip_and_tilt(np.ascontiguousarray(_platform(bare, fx)), PIVOTS, TIP)
        return q, legs - _legs(s, free, upright, bare, fx)[0]
    return q, _tared(legs)


def _axes(s: Session, ref: Array, base: Array, load: Array, tangent: Array, fx: Knobs) -> Array:
    """Actuator stage: axis positions (N, 3) [m] under a load (N, 3) [N]; see ``robot_axes.loops``."""
    get = fx.get
    dry = np.full(3, get("dry", 0.0) + get("dry_share", 0.0) * get("stribeck", 0.0))
    axis = int(get("axis", 0))
    dry[axis] += get("dry_one", 0.0) + 0.5 * get("stribeck_one", 0.0)
    one = np.zeros((2, 3))  # drag and Stribeck's excess of single axes
    one[:, axis] = get("drag_one", 0.0), get("stribeck_one", 0.0)
    stiff = 1 + get("servo_tolerance", 0.0)
    sound = {"mass": MASS, "kp": KP * stiff, "ki": KI * stiff, "kd": KD}
    sound = {name: value * get(f"{name}_share", 1.0) for name, value in sound.items()}
    effects = {name: float(get(name, _UNUSED.get(name, 0.0))) for name in Loop._fields[4:]}
    effects["drag"] += DRAG
    q: Array = loops(ref, load, base, tangent, float(s.dt[1]) / SUBSTEPS, Loop(**sound, **effects), dry, one)
    return q


def _tared(legs: Array) -> Array:
    tared: Array = legs - legs[0]
    return tared


def _at(s: Session, moment: float, x: Array) -> Array:
    """Values (3,) of x (N, 3) at a session time [s]."""
    return np.array([np.interp(moment, s.t, x[:, i]) for i in range(3)])


def _record(s: Session, traces: Mapping[str, tuple[Array, Array]], fx: Knobs, seed: int, noisy: bool) -> Channels:
    """Sampling, resolution and processing of every recording, from its specimen's axis positions and transducers."""
    out: Channels = {name: [] for name in AXES + LEGS + PROBE + FORCE}
    get = fx.get
    matrix = _matrix(fx)
    timing = {k: v for k, v in fx.items() if k not in _SUCTION_ONLY}
    for k, r in enumerate(s.recordings):
        q, legs = traces[r.specimen]
        rows = np.random.default_rng((seed, k))
        stamps = s.stamps(k)
        when = taken(stamps, 1 / s.rate, k, timing, rows)
        at = np.stack([s.sampled(when.main, q[:, i], fx) for i in range(3)], axis=1)
        x = np.stack([s.sampled(when.second, legs[:, i], fx) for i in range(3)], axis=1)
        leg = int(get("leg", 0))
        x[:, leg] += get("offset", 0.0) + get("offset_jump", 0.0) * (
            stamps > r.start + get("jump_at", 0.5) * r.duration
        )
        if a := get("tare_each", 0.0):
            x = x - _at(s, r.start + r.onset + a, legs)
        if noisy:
            at = at + np.stack([s.lab.noise["axis"].draw(len(at), 1 / s.rate, rows) for _ in range(3)], axis=1)
            x = x + np.stack([s.lab.noise["leg"].draw(len(x), 1 / s.rate, rows) for _ in range(3)], axis=1)
        x = _leg_digits(x, s.lab.noise["leg"].step, fx, noisy)
        at = coarsened(at, s.lab.noise["axis"].step, get("axis_coarse", 0.0), 0.0, noisy)
        at, x = at[when.row], x[when.row]
        x = x * (get("unit_force", 1.0) if get("unit_only", -1.0) in (-1.0, float(k)) else 1.0)
        seen = x[:, [1, 0, 2]] if get("legs_swapped", 0.0) else x
        places = at[:, [0, 2, 1]] if get("axes_swapped", 0.0) else at
        for names, values in (
            (AXES, at),
            (LEGS, x),
            (PROBE, tip(places) * get("unit_probe", 1.0)),
            (FORCE, seen @ matrix.T),
        ):
            for i, name in enumerate(names):
                out[name].append(spells.computed(name, np.ascontiguousarray(values[:, i]), fx))
    return out


def _matrix(fx: Knobs) -> Array:
    """The force matrix (3, 3) of the processing, with signs that may be wrong."""
    matrix, row = force_matrix(), int(fx.get("row", 0))
    matrix[row, int(fx.get("leg", 0))] *= -1 if fx.get("matrix_sign", 0.0) else 1
    matrix[row] *= -1 if fx.get("row_sign", 0.0) else 1
    return matrix


def _leg_digits(x: Array, step: float, fx: Knobs, noisy: bool) -> Array:
    """Range and resolution of the transducers; the tared part is preload, so tension down to it can be read."""
    get = fx.get
    if top := get("ceiling", 0.0):
        x = np.minimum(x, top)
    if low := get("unloaded", 0.0):  # a transducer whose preload is used up reads less and less
        knee = -0.6 * low
        x = np.where(x < knee, knee - 0.4 * low * np.tanh((knee - x) / (0.4 * low)), x)
    return coarsened(x, step, get("leg_coarse", 0.0), get("leg_coarse_uneven", 0.0), noisy)
