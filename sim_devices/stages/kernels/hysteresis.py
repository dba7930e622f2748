"""Kernels whose output depends on the way and not on the rate: backlash, stops, dry friction."""

from __future__ import annotations

import math

from numba import njit

from sim_devices.stages.kernels.base import FloatArray


@njit(cache=True, error_model="numpy")
def play(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """Backlash, also Coulomb friction behind a spring: y moves only when |u - y| reaches ``p`` = (half width,)."""
    for i in range(t.size):
        s[3] = min(max(s[3], u[i] - p[0]), u[i] + p[0])
        y[i] = s[3]


@njit(cache=True, error_model="numpy")
def soft_play(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """Backlash taken up gradually (Dahl): u - y nears ±``p`` = (half width,) exponentially over that distance."""
    half = max(p[0], 1e-300)
    for i in range(t.size):
        du = u[i] - s[2]
        edge = p[0] if du > 0.0 else -p[0]
        s[3] = edge + (s[3] - edge) * math.exp(-abs(du) / half)
        s[2] = u[i]
        y[i] = u[i] - s[3]


@njit(cache=True, error_model="numpy")
def play_within(s: FloatArray, u: FloatArray, width: FloatArray, soft: float, y: FloatArray) -> None:
    """``play`` whose half ``width`` (n,) changes, as dry friction does with the normal load.

    ``soft`` > 0.5: y approaches the edge exponentially over a distance of one half width (Dahl) instead of being
    carried by it.
    """
    for i in range(u.size):
        w = width[i]
        if soft > 0.5:
            du = u[i] - s[2]
            edge = w if du > 0.0 else -w
            lag = edge + (s[4] - edge) * math.exp(-abs(du) / max(w, 1e-300))
            s[4] = min(max(lag, -w), w)
            s[3] = u[i] - s[4]
        else:
            s[3] = min(max(s[3], u[i] - w), u[i] + w)
        s[2] = u[i]
        y[i] = s[3]


@njit(cache=True, error_model="numpy")
def slipping(s: FloatArray, u: FloatArray, reach: float, share: float, out: FloatArray) -> None:
    """Play in k directions at once: point s (k,) is carried along at a distance ``reach`` of u (k, n).

    ``out`` = u - share s. As friction with kinematic hardening: ``share`` of the displacement beyond ``reach`` is slip.
    """
    for i in range(u.shape[1]):
        far = 0.0
        for k in range(s.size):
            far += (u[k, i] - s[k]) ** 2
        far = math.sqrt(far)
        for k in range(s.size):
            if far > reach:
                s[k] += (far - reach) / far * (u[k, i] - s[k])
            out[k, i] = u[k, i] - share * s[k]


@njit(cache=True, error_model="numpy")
def resting(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """A controller that rests until its error exceeds a half band, then corrects it down to a share of the band.

    ``p`` = (half band, share left, vents): a share of 1 is play. Where ``vents`` > 0.5, y is 0 while u is: a valve
    opens to the room.
    """
    for i in range(t.size):
        error = u[i] - s[3]
        if abs(error) > p[0]:
            s[3] = u[i] - (p[0] if error > 0.0 else -p[0]) * p[1]
        if p[2] > 0.5 and abs(u[i]) < 1e-9:
            s[3] = 0.0
        y[i] = s[3]


@njit(cache=True, error_model="numpy")
def prandtl(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """Prandtl–Ishlinskii hysteresis, a sum of stops each within ±w_i.

    ``p`` = (r1, w1, r2, w2, ...), r_i half widths of u.
    """
    for i in range(t.size):
        y[i] = 0.0
        for k in range(p.size // 2):
            r = max(p[2 * k], 1e-300)
            s[3 + k] = min(max(s[3 + k], u[i] - r), u[i] + r)
            y[i] += p[2 * k + 1] * (u[i] - s[3 + k]) / r


def in_a_row(width: float) -> tuple[float, ...]:
    """Parameters of `prandtl`: three stops of ``width`` in all, each half as wide as the next."""
    return width, -width / 3, 2 * width, -width / 3, 4 * width, -width / 3


JOINTS = 4
"""Of which `of_joints` is the mean."""


def of_joints(half: float, spread: float) -> tuple[float, ...]:
    """Parameters of `prandtl` that, added to a signal, make it the mean of plays (joints in a row) of half widths
    between (1 - ``spread``) and (1 + ``spread``) times ``half``."""
    widths = [half * (1.0 + spread * (2.0 * k / (JOINTS - 1) - 1.0)) for k in range(JOINTS)]
    return tuple(x for width in widths for x in (width, -width / JOINTS))


@njit(cache=True, error_model="numpy")
def bouc_wen(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """Bouc–Wen hysteresis within ±a: dz = (1 - |z|^n (1 + sign(z du))/2) du/d, y = a z. ``p`` = (a, d, n >= 1).

    Wen 1976. Reversals unload along the initial slope a/d. Reduces to ``dahl``-like saturation for n = 1 in loading.
    """
    for i in range(t.size):
        du = (u[i] - s[2]) / max(p[1], 1e-300)
        if p[2] == 2.0:  # back along the initial slope, then a hyperbolic tangent
            way = 1.0 if du > 0.0 else -1.0
            z = way * s[3]
            back = min(max(-z, 0.0), way * du)
            z += back
            if way * du > back:
                z = math.tanh(math.atanh(min(z, 1.0 - 1e-15)) + way * du - back)
            s[3] = way * z
        else:
            steps = int(min(math.ceil(abs(du) * 8.0), 256.0))
            for _ in range(steps):
                h = du / steps
                z = s[3]
                for stage in range(2):  # midpoint rule
                    back = 1.0 if z * h > 0.0 else 0.0
                    slope = 1.0 - back * abs(z) ** p[2]
                    z = s[3] + slope * h * (0.5 if stage == 0 else 1.0)
                s[3] = min(max(z, -1.0), 1.0)
        s[2] = u[i]
        y[i] = p[0] * s[3]


@njit(cache=True, error_model="numpy")
def friction(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """Friction force of a contact at position u: Coulomb, Stribeck, Dahl and LuGre's steady part in one.

    F' = (sign(v) g(v) - F) |v| / d, g(v) = Fc + (Fs - Fc) exp(-(v/vs)²), y = F + c v. ``p`` = (Fc N, Fs N, vs m/s, d m,
    c N s/m); d is the presliding distance (0: Coulomb). Canudas de Wit et al. 1995; exact for constant v in a step.
    """
    if s[0] == 0.0 and t.size:
        s[0], s[1], s[2] = 1.0, t[0], u[0]
    for i in range(t.size):
        du, dt = u[i] - s[2], t[i] - s[1]
        v = du / dt if dt > 0.0 else 0.0
        if du != 0.0:
            ratio = v / max(p[2], 1e-12)
            level = p[0] + (p[1] - p[0]) * math.exp(-ratio * ratio)
            level = level if du > 0.0 else -level
            s[3] = level + (s[3] - level) * (math.exp(-abs(du) / p[3]) if p[3] > 0.0 else 0.0)
        s[1], s[2] = t[i], u[i]
        y[i] = s[3] + p[4] * v
