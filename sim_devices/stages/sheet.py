"""The robot's reduced tissue: anisotropic, nonlinear, with memory, in three directions at once."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit

from sim_devices.chain import FloatArray, Signals
from sim_devices.stages.kernels import hold_weights
from sim_devices.stages.operators import Wired
from sim_devices.stages.tissues import SheetTissue

_HEAD = 9  # of the state: [0] started [1] time [2:5] last elastic force [5] softening [6:9] skin displacement


@dataclass(frozen=True)
class Sheet(Wired):
    """``tissue`` under the probe: displacement x, y, z (m) -> force on the probe x, y, z (N).

    ``glue`` m/N is the compliance in plane and normal of the layer between probe and skin: the skin then moves by u -
    glue force.
    """

    tissue: SheetTissue
    glue: tuple[float, float] = (0.0, 0.0)

    def fresh(self) -> Any:
        k1, k2, k3 = self.tissue.stiffness
        c, s = math.cos(self.tissue.angle), math.sin(self.tissue.angle)
        stiffness = (k1 * c * c + k2 * s * s, (k1 - k2) * c * s, k1 * s * s + k2 * c * c, k3)
        t = self.tissue
        shape = (max(sum(t.stiffness) / 3, 1e-12) * t.length**2, t.exponent)
        soft = (t.softening, t.softening_force, t.softening_rise, t.softening_fall)
        parameters = np.array([*stiffness, *shape, *soft, *self.glue, t.isotropy, sum(t.stiffness) / 3])
        state = np.zeros(_HEAD + 3 * len(t.times))
        return state, parameters, np.array(t.relaxation, dtype=float), np.array(t.times, dtype=float)

    def advance(self, state: Any, time: FloatArray, signals: Signals) -> None:
        u = [signals[s] for s in self.source]
        f = np.empty((3, len(time)))
        _advance_sheet(state[0], time, u[0], u[1], u[2], state[1], state[2], state[3], f)
        signals.update(zip(self.target, f, strict=True))


@njit(cache=True)
def _elastic(ux: float, uy: float, uz: float, p: FloatArray) -> tuple[float, float, float]:
    """Force of the tissue on the probe without memory: minus the gradient of a potential, if nothing is isotropic."""
    fx, fy, fz = p[0] * ux + p[1] * uy, p[1] * ux + p[2] * uy, p[3] * uz
    energy, square = fx * ux + fy * uy + fz * uz, p[13] * (ux * ux + uy * uy + uz * uz)
    stretch = max(1.0 + (energy + p[12] * (square - energy)) / p[4], 1e-3)  # isotropy beyond 0 to 1, in a fit
    factor = -(stretch ** p[5]) if p[5] != 0.0 else -1.0
    return factor * fx, factor * fy, factor * fz


Triple = tuple[float, float, float]


@njit(cache=True)
def _through_glue(
    at: Triple, u: Triple, f: Triple, past: Triple, now: float, soft: float, p: FloatArray
) -> tuple[float, float, float, float, float, float]:
    """Displacement of the skin and its force, where the probe is ``at`` and glue gives between them (Newton)."""
    glue_t, glue_n = p[10], p[11]
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


@njit(cache=True)
def _advance_sheet(
    s: FloatArray,
    t: FloatArray,
    x: FloatArray,
    y: FloatArray,
    z: FloatArray,
    p: FloatArray,
    g: FloatArray,
    tau: FloatArray,
    f: FloatArray,
) -> None:
    n = g.size
    e, a, b = np.ones(n), np.zeros(n), np.zeros(n)
    soft_a, soft_f, soft_up, soft_down = p[6], p[7], p[8], p[9]
    glued = p[10] > 0.0 or p[11] > 0.0
    if s[0] == 0.0 and t.size:
        s[0], s[1] = 1.0, t[0]
    last, up, down = -1.0, 1.0, 1.0
    for i in range(t.size):
        dt = t[i] - s[1]
        now = 1.0
        if dt > 0.0 and abs(dt - last) > 1e-9 * last:
            for k in range(n):
                e[k], a[k], b[k] = hold_weights(dt, tau[k])
            up, down = math.exp(-dt / soft_up), math.exp(-dt / soft_down)
            last = dt
        past_x = past_y = past_z = 0.0
        if dt > 0.0:
            for k in range(n):  # the memory of earlier steps; the new force enters with 1 - sum g b
                past_x += g[k] * (e[k] * s[_HEAD + 3 * k] + a[k] * s[2])
                past_y += g[k] * (e[k] * s[_HEAD + 3 * k + 1] + a[k] * s[3])
                past_z += g[k] * (e[k] * s[_HEAD + 3 * k + 2] + a[k] * s[4])
                now -= g[k] * b[k]
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
            ux, uy, uz, fx, fy, fz = _through_glue(
                (x[i], y[i], z[i]), (ux, uy, uz), (fx, fy, fz), (past_x, past_y, past_z), now, soft, p
            )
            s[6], s[7], s[8] = ux, uy, uz
        fx, fy, fz = soft * fx, soft * fy, soft * fz
        f[0, i], f[1, i], f[2, i] = now * fx - past_x, now * fy - past_y, now * fz - past_z
        if dt > 0.0:
            for k in range(n):
                j = _HEAD + 3 * k
                s[j] = e[k] * s[j] + a[k] * s[2] + b[k] * fx
                s[j + 1] = e[k] * s[j + 1] + a[k] * s[3] + b[k] * fy
                s[j + 2] = e[k] * s[j + 2] + a[k] * s[4] + b[k] * fz
            goal = math.sqrt(fx * fx + fy * fy + fz * fz) / soft_f
            s[5] = goal + (s[5] - goal) * (up if goal > s[5] else down)
        s[1], s[2], s[3], s[4] = t[i], fx, fy, fz
