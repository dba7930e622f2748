"""The robot's reduced tissue: anisotropic, nonlinear, with memory, in three directions at once."""

from __future__ import annotations

import math
from collections import OrderedDict
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from sim_devices.chain import FloatArray, Signals
from sim_devices.stages.kernels import evaluate, exposed, hold_weights, low_pass
from sim_devices.stages.operators import Wired
from sim_devices.stages.tissues import SheetTissue

_HEAD = 9  # of the state: [0] started [1] time [2:5] last elastic force [5] softening [6:9] skin displacement
_GLUE = 6  # at the state's end: the force by which glue has crept, and the last one that it bore, closed
_KEPT = 12  # grids' and times' weights: a fit's columns share them, and they are half of a simulation's work


class Glue(NamedTuple):
    """The layer between probe and skin, which gives by g so that the skin moves by u - g.

    g = c ((1 - creeps) f + creeps s), within s' = f - s, of the force F on it, closed by as much as it bears: f = F /
    (1 + closes |F|). c is ``plane`` or ``normal`` (m/N), ``within`` s, ``closes`` 1/N: a tape's Kelvin-Voigt creep, and
    foam that is pressed together.
    """

    plane: float = 0.0
    normal: float = 0.0
    creeps: float = 0.0
    within: float = 1.0
    closes: float = 0.0

    def gives(self, time: FloatArray, force: FloatArray) -> FloatArray:
        """The displacement (3, n) m by a force on the probe (3, n) N."""
        closed = force / (1.0 + self.closes * np.linalg.norm(force, axis=0))
        if self.creeps:
            late = np.stack([evaluate(low_pass, time, f, self.within) for f in closed])
            closed = (1.0 - self.creeps) * closed + self.creeps * late
        return np.asarray(np.array([self.plane, self.plane, self.normal])[:, None] * closed)


NO_GLUE = Glue()
"""The probe holds the skin itself."""


@dataclass(frozen=True)
class Sheet(Wired):
    """``tissue`` under the probe: displacement x, y, z (m) -> force on the probe x, y, z (N), through ``glue``."""

    tissue: SheetTissue
    glue: Glue = NO_GLUE

    def fresh(self) -> Any:
        t = self.tissue
        axes = principal_axes(t)
        k = axes @ np.diag(t.stiffness) @ axes.T
        mean = sum(t.stiffness) / 3
        stiffness = (k[0, 0], k[0, 1], k[1, 1], k[2, 2])
        shape = (max(mean, 1e-12) * t.length**2, t.exponent)
        soft = (t.softening, t.softening_force, t.softening_rise, t.softening_fall)
        parameters = np.array(
            [*stiffness, *shape, *soft, *self.glue[:2], t.isotropy, sum(t.stiffness) / 3, k[0, 2], k[1, 2],
             t.softening_end, self.glue.creeps, self.glue.closes]
        )  # fmt: skip
        state = np.zeros(_HEAD + 3 * len(t.times) + _GLUE)
        late = [*t.times, self.glue.within] if self.glue.creeps else t.times
        return state, parameters, np.array(t.relaxation, dtype=float), np.array(late, dtype=float)

    def advance(self, state: Any, time: FloatArray, signals: Signals) -> None:
        u = [signals[s] for s in self.source]
        f = np.empty((3, len(time)))
        weights = _weights(time, state[0], (self.tissue.softening_rise, self.tissue.softening_fall), state[3])
        _advance_sheet(state[0], time, u[0], u[1], u[2], state[1], state[2], weights, f)
        signals.update(zip(self.target, f, strict=True))


def principal_axes(tissue: SheetTissue) -> FloatArray:
    """The directions, columns (3, 3), along which a sheet has its three stiffnesses."""
    axes = _turn(2, tissue.angle)
    for about, angle in enumerate(tissue.tilt):
        if angle:
            axes = _turn(about, angle) @ axes
    return axes


def _turn(about: int, angle: float) -> FloatArray:
    """The rotation matrix (3, 3) by ``angle`` rad about x (0), y (1) or z (2)."""
    c, s = math.cos(angle), math.sin(angle)
    out = np.eye(3)
    i, j = (about + 1) % 3, (about + 2) % 3
    out[i, i], out[i, j], out[j, i], out[j, j] = c, -s, s, c
    return out


_known: OrderedDict[tuple[int, bytes], tuple[FloatArray, FloatArray]] = OrderedDict()


def _weights(time: FloatArray, state: FloatArray, softening: tuple[float, float], tau: FloatArray) -> FloatArray:
    """`_weighed` of steps to ``time`` (n,) s; kept where they begin at rest, as a whole session's do again and again.

    Grids are told apart by identity: whoever gives the same one twice does not change it in between.
    """
    if state[0]:
        return np.asarray(_weighed(time, state[1], *softening, tau))
    key = (id(time), np.array([*softening, *tau]).tobytes())
    found = _known.get(key)
    if found is None:
        found = _known[key] = time, _weighed(time, time[0] if len(time) else 0.0, *softening, tau)
        if len(_known) > _KEPT:
            _known.popitem(last=False)
    else:
        _known.move_to_end(key)
    return found[1]


@njit(cache=True, error_model="numpy")
def _weighed(time: FloatArray, begin: float, rise: float, fall: float, tau: FloatArray) -> FloatArray:
    """Of each step to ``time`` (n,) s the decays of softening as it rises and falls, then `hold_weights` of each of
    ``tau`` (k,) s, (n, 2 + 3 k)."""
    out = np.empty((time.size, 2 + 3 * tau.size))
    last, before = -1.0, begin
    for i in range(time.size):
        dt = time[i] - before
        before = time[i]
        if i > 0 and not (dt > 0.0 and abs(dt - last) > 1e-9 * last):
            out[i] = out[i - 1]
            continue
        last = dt
        out[i, 0], out[i, 1] = math.exp(-dt / rise), math.exp(-dt / fall)
        for k in range(tau.size):
            out[i, 2 + 3 * k], out[i, 3 + 3 * k], out[i, 4 + 3 * k] = hold_weights(dt, tau[k])
    return out


@njit(cache=True, error_model="numpy")
def _elastic(ux: float, uy: float, uz: float, p: FloatArray) -> tuple[float, float, float]:
    """Force of the tissue on the probe without memory: minus the gradient of a potential, if nothing is isotropic."""
    fx = p[0] * ux + p[1] * uy + p[14] * uz
    fy = p[1] * ux + p[2] * uy + p[15] * uz
    fz = p[14] * ux + p[15] * uy + p[3] * uz
    energy, square = fx * ux + fy * uy + fz * uz, p[13] * (ux * ux + uy * uy + uz * uz)
    stretch = max(1.0 + (energy + p[12] * (square - energy)) / p[4], 1e-3)  # isotropy beyond 0 to 1, in a fit
    factor = -(stretch ** p[5]) if p[5] != 0.0 else -1.0
    return factor * fx, factor * fy, factor * fz


Triple = tuple[float, float, float]


@njit(cache=True, error_model="numpy")
def _through_glue(
    at: Triple, u: Triple, f: Triple, past: Triple, now: float, soft: float, quick: float, p: FloatArray
) -> tuple[float, float, float, float, float, float]:
    """Displacement of the skin and its force, where the probe is ``at`` and glue between them has a share ``quick`` of
    its compliance at once (Newton)."""
    glue_t, glue_n = p[10] * quick, p[11] * quick
    (ux, uy, uz), (fx, fy, fz) = u, f
    stiff_t, stiff_n = 1.0 + glue_t * max(p[0], p[2]) * now, 1.0 + glue_n * p[3] * now
    for _ in range(40):
        rx = at[0] + glue_t * (soft * fx * now - past[0]) - ux
        ry = at[1] + glue_t * (soft * fy * now - past[1]) - uy
        rz = at[2] + glue_n * (soft * fz * now - past[2]) - uz
        if abs(rx) + abs(ry) + abs(rz) < 1e-10:
            break
        grow = 1.0 + (ux * ux * p[0] + uy * uy * p[2] + uz * uz * p[3]) / p[4]
        factor = grow ** p[5] * (1.0 + 2.0 * p[5])
        ux += rx / (1.0 + (stiff_t - 1.0) * factor)
        uy += ry / (1.0 + (stiff_t - 1.0) * factor)
        uz += rz / (1.0 + (stiff_n - 1.0) * factor)
        fx, fy, fz = _elastic(ux, uy, uz, p)
    return ux, uy, uz, fx, fy, fz


@njit(cache=True, error_model="numpy")
def _glue_step(weights: FloatArray, dt: float) -> Triple:
    """`hold_weights` of the glue's creep; of glue that does not creep, or of no time, nothing changes."""
    return (weights[0], weights[1], weights[2]) if weights.size and dt > 0.0 else (1.0, 0.0, 0.0)


@njit(cache=True, error_model="numpy")
def _crept(s: FloatArray, j: int, step: Triple, p: FloatArray) -> tuple[float, float, float, float]:
    """The share of its compliance that glue has at once, and the force by which it has crept already (x, y, z), N."""
    (e, a, b), creeps = step, p[17]
    bore = math.sqrt(s[j + 3] ** 2 + s[j + 4] ** 2 + s[j + 5] ** 2)
    open_still = max(1.0 - p[18] * bore, 0.0)  # 1 / (1 + closes |F|), as `bore` is |F| of that
    return (
        (1.0 - creeps + creeps * b) * open_still,
        creeps * (e * s[j] + a * s[j + 3]),
        creeps * (e * s[j + 1] + a * s[j + 4]),
        creeps * (e * s[j + 2] + a * s[j + 5]),
    )


@njit(cache=True, error_model="numpy")
def _bears(s: FloatArray, j: int, step: Triple, force: Triple, p: FloatArray) -> None:
    """The glue's state after it has borne a ``force``."""
    e, a, b = step
    share = 1.0 / (1.0 + p[18] * math.sqrt(force[0] ** 2 + force[1] ** 2 + force[2] ** 2))
    for k in range(3):
        s[j + k] = e * s[j + k] + a * s[j + 3 + k] + b * share * force[k]
        s[j + 3 + k] = share * force[k]


@njit(cache=True, error_model="numpy")
def _advance_sheet(
    s: FloatArray,
    t: FloatArray,
    x: FloatArray,
    y: FloatArray,
    z: FloatArray,
    p: FloatArray,
    g: FloatArray,
    weights: FloatArray,
    f: FloatArray,
) -> None:
    n = g.size
    soft_a, soft_f = p[6], p[7]
    glued = p[10] > 0.0 or p[11] > 0.0
    end = _HEAD + 3 * n  # of the memory, where the glue's state begins
    if s[0] == 0.0 and t.size:
        s[0], s[1] = 1.0, t[0]
    for i in range(t.size):
        dt = t[i] - s[1]
        now = 1.0
        past_x = past_y = past_z = 0.0
        if dt > 0.0:
            for k in range(n):  # the memory of earlier steps; the new force enters with 1 - sum g b
                e, a, b = weights[i, 2 + 3 * k], weights[i, 3 + 3 * k], weights[i, 4 + 3 * k]
                j = _HEAD + 3 * k
                s[j], s[j + 1], s[j + 2] = e * s[j] + a * s[2], e * s[j + 1] + a * s[3], e * s[j + 2] + a * s[4]
                past_x += g[k] * s[j]
                past_y += g[k] * s[j + 1]
                past_z += g[k] * s[j + 2]
                now -= g[k] * b
        else:
            for k in range(n):
                past_x += g[k] * s[_HEAD + 3 * k]
                past_y += g[k] * s[_HEAD + 3 * k + 1]
                past_z += g[k] * s[_HEAD + 3 * k + 2]
        soft = 1.0 - soft_a * s[5]
        ux, uy, uz = x[i], y[i], z[i]
        if glued:
            ux, uy, uz = s[6], s[7], s[8]
        fx, fy, fz = _elastic(ux, uy, uz, p)
        if glued:
            step = _glue_step(weights[i, 2 + 3 * n :], dt)
            quick, cx, cy, cz = _crept(s, end, step, p)
            at = (x[i] + p[10] * cx, y[i] + p[10] * cy, z[i] + p[11] * cz)
            ux, uy, uz, fx, fy, fz = _through_glue(
                at, (ux, uy, uz), (fx, fy, fz), (past_x, past_y, past_z), now, soft, quick, p
            )
            s[6], s[7], s[8] = ux, uy, uz
        fx, fy, fz = soft * fx, soft * fy, soft * fz
        f[0, i], f[1, i], f[2, i] = now * fx - past_x, now * fy - past_y, now * fz - past_z
        if glued:
            _bears(s, end, step, (f[0, i], f[1, i], f[2, i]), p)
        if dt > 0.0:
            for k in range(n):
                b = weights[i, 4 + 3 * k]
                j = _HEAD + 3 * k
                s[j] += b * fx
                s[j + 1] += b * fy
                s[j + 2] += b * fz
            load = math.sqrt(fx * fx + fy * fy + fz * fz) / soft_f
            s[5] = exposed(s[5], load, p[16], weights[i, 0], weights[i, 1])
        s[1], s[2], s[3], s[4] = t[i], fx, fy, fz
