"""How an axis of the robot is stepped, by the parameters that its loop (`axes.AxisLoop.fresh`) states.

The linear loop is integrated exactly for targets and loads that are linear in a step: about the particular solution
x = r + λ/Ki, x' = ρ (ρ, λ the slopes of target and load) the deviation moves by the matrix exponential. The nonlinear
part (friction, force limit, uneven force constant) acts as a force held over substeps of at most ``SUBSTEP``, or over a
whole step in which friction hardly changes; dry friction takes at most the impulse that stops the axis, so that
sticking is exact.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from sim_devices.chain import FloatArray
from sim_devices.stages.friction import THIN_AT, bristle, eased, thinned
from sim_devices.stages.kernels import SAME, STEPS, place

SUBSTEP = 1e-3
"""s, where a nonlinearity is present."""
UNMOVED = 1e-7
"""m by which friction that changes within a step may move an axis, if it is taken as held."""
TURN = 0.1
"""Of the presliding length, which an axis may go forth and back within a step."""
_END_STOP = 6e-3  # m from the centre; only a lost control of an axis leads there
RUBBING = [4, 5, 6, 8, 18]  # of a loop's parameters: drag, dry friction, stiction, presliding, drag that thins
LONGEST = 14  # and the longest substep, s
UNSEEN = 23  # N/m of the target that the proportional part does not see
STATE = 9  # [0] started [1] time [2] target [3] load [4] integral [5] position [6] velocity [7] dry friction [8] slope


@njit(cache=True, error_model="numpy")
def _exponential(a: FloatArray, h: float, rate: float, out: FloatArray) -> None:
    """exp(a h) (3, 3) by Taylor series with scaling and squaring; ``rate`` bounds the eigenvalues."""
    squarings = int(max(0.0, math.ceil(math.log2(max(rate * h, 1e-9) / 0.05))))
    b = a * (h / 2.0**squarings)
    term = np.eye(3)
    result = np.eye(3)
    for k in range(1, 13):
        term = _product(term, b) / k
        result = result + term
    for _ in range(squarings):
        result = _product(result, result)
    out[:] = result


@njit(cache=True, error_model="numpy")
def _product(a: FloatArray, b: FloatArray) -> FloatArray:
    c = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            c[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]
    return c


@njit(cache=True, error_model="numpy")
def advance_axis(
    s: FloatArray, t: FloatArray, target: FloatArray, load: FloatArray, p: FloatArray, y: FloatArray
) -> None:
    m, kp, ki, kd, drag, spring = p[0], p[1], p[2], p[3], p[4], p[13]
    w = math.sqrt(abs(kp / m))  # rad/s, of the loop without its integral: an integral may be as slow as it likes
    per_ki, per_w = 1.0 / ki, 1.0 / w
    # State (w ∫e, x, x'/w): the same size each, so that the series converges fast.
    a = np.zeros((3, 3))
    a[0, 1], a[1, 2] = -w, w
    a[2, 0], a[2, 1], a[2, 2] = ki / (m * w * w), -(kp + spring) / (m * w), -(kd + drag) / m
    bound = 2.0 * w + ki / (m * w * w) + (abs(kd) + drag) / m + spring / (m * w)
    known, exponentials = np.zeros(STEPS), np.empty((STEPS, 3, 3))
    if s[0] == 0.0 and t.size:
        s[0], s[1], s[2], s[3] = 1.0, t[0], target[0], load[0]
    for i in range(t.size):
        dt = t[i] - s[1]
        if dt > 1e-7:
            _kicked(s, p, target[i], dt)
            e = _of_length(dt, a, bound, known, exponentials)
            if not _whole(s, p, w, per_ki, per_w, e, target[i], load[i], dt):
                steps = max(math.ceil(dt / SUBSTEP * (1.0 - 1e-9)), 1)
                steps = steps if steps < p[21] else int(p[21])
                h = dt / steps
                _run(s, p, w, _of_length(h, a, bound, known, exponentials), target[i], load[i], h, steps)
        s[1], s[2], s[3] = t[i], target[i], load[i]
        y[i] = s[5]


@njit(cache=True, error_model="numpy", inline="always")
def _kicked(s: FloatArray, p: FloatArray, target: float, dt: float) -> None:
    """Add to the speed the kicks of a ``target`` that turns, fed forward, and that jumps, within the coil's limit."""
    if p[24] != 0.0:
        rho = (target - s[2]) / dt
        s[6] += p[24] * (rho - s[8])
        s[8] = rho
    if dt < p[25]:  # so short a step itself lets through a part only
        jump, limit = target - s[2], p[9] - abs(p[16])
        rest = min(p[17] * abs(jump) - limit * dt, limit * (p[25] - dt))
        s[6] += math.copysign(max(rest, 0.0), jump) / p[0]


@njit(cache=True, error_model="numpy", inline="always")
def _whole(
    s: FloatArray,
    p: FloatArray,
    w: float,
    per_ki: float,
    per_w: float,
    e: FloatArray,
    target: float,
    load: float,
    dt: float,
) -> bool:
    """One long step, ``e`` its exponential, where nothing forbids it: in a linear loop only a coil at its limit.

    Returns whether it was taken; else ``s`` is as before."""
    if p[LONGEST] == math.inf:
        return _glides(s, p, w, per_ki, per_w, e, target, load, dt)
    if dt <= SUBSTEP * (1.0 + 1e-9) or p[11] != 0.0 or p[12] != 0.0 or p[15] != 0.0:  # more than friction acts
        return False
    return _sticks(s, p, target, load, dt) or _slides(s, p, w, per_ki, per_w, e, target, load, dt)


@njit(cache=True, error_model="numpy", inline="always")
def _dry(v: float, p: FloatArray) -> float:
    """Dry friction (N) at ``v`` m/s, of an axis without presliding."""
    if p[20] > 0.0:
        return float(p[5] * math.tanh(v / p[20]))
    return math.copysign(_level(v, p), v) if v != 0.0 and p[8] == 0.0 else 0.0


@njit(cache=True, error_model="numpy", inline="always")
def _level(v: float, p: FloatArray) -> float:
    """Greatest dry friction (N) at ``v`` m/s, by Stribeck's curve."""
    return float(p[5] + p[6] * math.exp(-((v / p[7]) ** 2)))


@njit(cache=True, error_model="numpy", inline="always")
def _rubs(v: float, p: FloatArray) -> float:
    """Friction (N) that ``v`` m/s tells: all but that of presliding."""
    grease = math.copysign(p[18] * (abs(v) / THIN_AT) ** p[19], v) if p[18] > 0.0 else 0.0
    return grease + _dry(v, p)


@njit(cache=True, error_model="numpy", inline="always")
def _asked(p: FloatArray, target: float, rate: float, integral: float, x: float, v: float) -> float:
    """Force (N) that the controller asks for at a ``target`` (m) that moves at a ``rate`` (m/s)."""
    return float(p[1] * (target - x) + p[2] * integral - p[3] * v + p[17] * rate - p[23] * target)


@njit(cache=True, error_model="numpy")
def _of_length(h: float, a: FloatArray, bound: float, known: FloatArray, kept: FloatArray) -> FloatArray:
    """exp(a h), kept with others by its length."""
    j = place(h)
    if abs(h - known[j]) > SAME * h:
        known[j] = h
        _exponential(a, h, bound, kept[j])
    found: FloatArray = kept[j]
    return found


@njit(cache=True, error_model="numpy", inline="always")
def _glides(
    s: FloatArray,
    p: FloatArray,
    w: float,
    per_ki: float,
    per_w: float,
    e: FloatArray,
    target: float,
    load: float,
    dt: float,
) -> bool:
    """One long step of the linear loop, unless the coil meets its limit; ``e`` is its exponential, ``per_ki`` and
    ``per_w`` are inverse.

    Returns whether it was taken; else ``s`` is as before."""
    kp, kd, spring, per_dt = p[1], p[3], p[13], 1.0 / dt
    rho = (target - s[2]) * per_dt
    ahead = ((load - s[3]) * per_dt - spring * rho) * per_ki
    ip0 = ((kd + p[4] - p[22]) * rho - s[3] + spring * (s[2] + ahead) + kp * ahead) * per_ki
    d0, d1, d2 = w * (s[4] - ip0), s[5] - (s[2] + ahead), (s[6] - rho) * per_w
    integral = ip0 - ahead * dt + (e[0, 0] * d0 + e[0, 1] * d1 + e[0, 2] * d2) * per_w
    x = target + ahead + e[1, 0] * d0 + e[1, 1] * d1 + e[1, 2] * d2
    v = rho + w * (e[2, 0] * d0 + e[2, 1] * d1 + e[2, 2] * d2)
    before, behind = _asked(p, s[2], rho, s[4], s[5], s[6]), _asked(p, target, rho, integral, x, v)
    if max(abs(before), abs(behind)) > p[9] - abs(p[16]):
        return False
    s[4], s[5], s[6] = integral, x, v
    return True


@njit(cache=True, error_model="numpy")
def _slides(
    s: FloatArray,
    p: FloatArray,
    w: float,
    per_ki: float,
    per_w: float,
    e: FloatArray,
    target: float,
    load: float,
    dt: float,
) -> bool:
    """One long step in which friction hardly changes, held at that of its mean speed: an axis that creeps, or goes on
    one way. The friction of either end would move it by less than `UNMOVED` beside that.

    Returns whether it was taken; else ``s`` is as before."""
    integral, x, v, dry = s[4], s[5], s[6], s[7]
    per_newton = w * e[1, 0] * per_ki
    if per_newton <= 0.0 or not _glides(s, p, w, per_ki, per_w, e, target, load, dt):  # a loop that swings
        return False
    mean, yields = (s[5] - x) / dt, per_newton / dt
    grease = thinned(mean, yields, p[18], p[19]) if p[18] > 0.0 else 0.0
    free, off = mean + yields * grease, 0.0
    if p[20] > 0.0:
        s[7] = held = -eased(free, yields, p[5], p[20])
    elif p[8] > 0.0:
        s[7] = bristle(dry, free, 0.5 * yields, _level(free - yields * dry, p), dt / p[8])
        held, off = 0.5 * (dry + s[7]), abs(s[7] - dry)
    else:
        s[7] = held = _dry(free, p)
    force = grease - held
    s[4] -= (1.0 - e[0, 0]) * force * per_ki
    s[5] += per_newton * force
    s[6] += w * w * e[2, 0] * per_ki * force
    mean = (s[5] - x) / dt
    if abs(s[6] - mean) * per_w < UNMOVED:  # steep friction: the rest of the speed is braked at once
        s[6] = mean
    told = _rubs(mean, p)
    off = max(off, abs(_rubs(v, p) - told), abs(_rubs(s[6], p) - told))
    if p[8] == 0.0:
        off = max(off, abs(told + force))
    elif min(v * s[6], v * mean) < 0.0 and max(abs(v), abs(s[6])) * dt > TURN * p[8]:
        off = math.inf  # it turns within the step, and much of presliding goes and comes
    limited = abs(_asked(p, target, (target - s[2]) / dt, s[4], s[5], s[6])) > p[9] - abs(p[16])
    if limited or off > UNMOVED * p[1] or abs(s[5]) > _END_STOP:
        s[4], s[5], s[6], s[7] = integral, x, v, dry
        return False
    return True


@njit(cache=True, error_model="numpy")
def _sticks(s: FloatArray, p: FloatArray, target: float, load: float, dt: float) -> bool:
    """One long step in which dry friction holds the axis where it is.

    Returns whether it was taken; else ``s`` is as before."""
    if s[6] != 0.0 or p[8] > 0.0 or p[20] > 0.0:
        return False
    x, rho = s[5], (target - s[2]) / dt
    integral = s[4] + dt * (0.5 * (s[2] + target) - x)
    before, behind = _asked(p, s[2], rho, s[4], x, 0.0), _asked(p, target, rho, integral, x, 0.0)
    # The load has the part of the target that is not seen already; the force fed forward is late.
    more = (p[22] - p[17]) * rho - p[13] * x
    pushed, pushes = before + p[23] * s[2] + more + s[3], behind + p[23] * target + more + load
    if max(abs(pushed), abs(pushes)) >= p[5] or max(abs(before), abs(behind)) > p[9] - abs(p[16]):
        return False
    s[4], s[7] = integral, pushes
    return True


@njit(cache=True, error_model="numpy")
def _withheld(p: FloatArray, x: float, asked: float, answers: float) -> tuple[float, bool]:
    """Force (N) that a coil at ``x`` m gives beside the mean one ``asked``, of a step at whose middle the controller
    ``answers`` each newton of it by so many against it; and whether the coil is at its limit."""
    limit, extra, given = p[9], 0.0, 0.0
    share = max(1.0 + p[11] * x + p[12] * x * x, 0.05)
    for _ in range(6):
        force = asked - answers * extra
        real = force * share + p[16]
        given = limit * math.tanh(real / limit) if p[15] > 0.0 else min(max(real, -limit), limit)
        extra = given - p[16] - force
    return extra, abs(given) >= limit


@njit(cache=True, error_model="numpy", inline="always")
def _braked(s: FloatArray, p: FloatArray, v: float, gain: float, h: float) -> tuple[float, bool]:
    """Dry friction (N), kept in ``s``, over a step of ``h`` s that would end at ``v`` m/s without it, where each newton
    adds ``gain`` m/s; and whether it stops the axis."""
    if p[20] > 0.0:
        return eased(0.5 * (s[6] + v), 0.5 * gain, p[5], p[20]), False
    if p[5] <= 0.0 and p[6] <= 0.0:
        return 0.0, False
    level = _level(0.5 * (s[6] + v - gain * s[7]), p)  # with the friction of the step before
    if p[8] > 0.0:
        before = s[7]
        s[7] = bristle(before, 0.5 * (s[6] + v), 0.25 * gain, level, h / p[8])
        return -0.5 * (before + s[7]), False
    dry = min(max(-v / gain, -level), level)
    s[7] = -dry
    return dry, abs(dry) < level


@njit(cache=True, error_model="numpy", inline="always")
def _run(
    s: FloatArray,
    p: FloatArray,
    w: float,
    e: FloatArray,
    target: float,
    load: float,
    h: float,
    steps: int,
) -> None:
    """From the last target and load in ``s`` to these in ``steps`` of ``h`` s; ``e`` is the exponential of one."""
    kp, ki, kd, drag = p[1], p[2], p[3], p[4]
    windup, spring, soft, nearest = p[10], p[13], p[15], p[9] - abs(p[16])
    even = p[11] == 0.0 and p[12] == 0.0 and soft == 0.0
    gain = w * w * e[2, 0] / ki  # of the speed at the end of the step, per newton
    answers = 0.5 * (kp * w * e[1, 0] / ki + 1.0 - e[0, 0] + kd * gain)
    rho = (target - s[2]) / (h * steps)
    lam = (load - s[3]) / (h * steps) - spring * rho
    for k in range(steps):
        r0, r1 = s[2] + rho * h * k, s[2] + rho * h * (k + 1)
        load0 = s[3] + (load - s[3]) / steps * k - spring * (r0 + lam / ki)
        ip0 = ((kd + drag - p[22]) * rho - load0 + kp * lam / ki) / ki
        d0, d1, d2 = w * (s[4] - ip0), s[5] - (r0 + lam / ki), (s[6] - rho) / w
        integral = ip0 - lam * h / ki + (e[0, 0] * d0 + e[0, 1] * d1 + e[0, 2] * d2) / w
        x = r1 + lam / ki + e[1, 0] * d0 + e[1, 1] * d1 + e[1, 2] * d2
        v = rho + w * (e[2, 0] * d0 + e[2, 1] * d1 + e[2, 2] * d2)
        before, behind = _asked(p, r0, rho, s[4], s[5], s[6]), _asked(p, r1, rho, integral, x, v)
        extra, limited, grease = 0.0, False, 0.0
        if not even or max(abs(before), abs(behind)) > nearest:
            extra, limited = _withheld(p, s[5], 0.5 * (before + behind), answers)
            v += gain * extra
        if p[18] > 0.0:
            grease = thinned(0.5 * (s[6] + v), 0.5 * gain, p[18], p[19])
            v += gain * grease
        dry, stops = _braked(s, p, v, gain, h)
        force = extra + grease + dry
        v += gain * dry
        x += w * e[1, 0] * force / ki
        integral -= (1.0 - e[0, 0]) * force / ki
        if stops:
            v = 0.0
            if s[6] == 0.0:  # and stood before: it stays where it is
                x, integral = s[5], s[4] + h * (0.5 * (r0 + r1) - s[5])
        if limited:
            integral = s[4] + windup * (integral - s[4])
        elif soft > 0.0:  # it tracks the coil's force: back-calculation by the force withheld over Kp
            integral += (1.0 - windup) * h * extra / kp
        if abs(x) > _END_STOP:
            x, v = math.copysign(_END_STOP, x), 0.0
        s[4], s[5], s[6] = integral, x, v
