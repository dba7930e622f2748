"""How an axis of the robot is stepped, by the parameters that its loop (`axes.AxisLoop.fresh`) states.

The linear loop is integrated exactly for targets and loads that are linear in a step: about the particular solution
x = r + λ/Ki, x' = ρ (ρ, λ the slopes of target and load) the deviation moves by the matrix exponential. The nonlinear
part (friction, force limit, uneven force constant) acts as a force held over substeps of at most ``SUBSTEP``, or over a
whole step in which friction hardly changes; dry friction takes at most the impulse that stops the axis, so that
sticking is exact.
"""

from __future__ import annotations

import math
from typing import NamedTuple

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
STATE = 9  # [0] started [1] time [2] target [3] load [4] integral [5] position [6] velocity [7] dry friction [8] slope
INTEGRAL, POSITION, VELOCITY, DRY = range(4, 8)


class Loop(NamedTuple):
    """The parameters of an axis, as `axes.AxisLoop` has them; of a tuple, unlike of an array, a compiler knows that no
    store of a state changes it."""

    mass: float
    kp: float
    ki: float
    kd: float
    drag: float
    coulomb: float
    stiction: float
    stribeck_speed: float
    presliding: float
    force_limit: float
    windup: float
    slope: float
    curvature: float
    spring: float
    substep: float  # s at most; infinite in a linear loop
    soft: float
    carried: float
    fed: float  # N s/m of the target's rate
    thinning: float
    thinning_power: float
    easing: float
    most_substeps: float
    fed_late: float  # the same once the coils' force is late
    unseen: float  # N/m of the target that the proportional part does not see
    kick: float  # share of the target's change of rate by which the axis changes its speed at once
    kick_time: float  # s for which a coil pushes at its limit where the target jumps


RUBBING = [Loop._fields.index(n) for n in ("drag", "coulomb", "stiction", "presliding", "thinning")]
LONGEST, UNSEEN = Loop._fields.index("substep"), Loop._fields.index("unseen")


class _Derived(NamedTuple):
    """A linear loop's own rate ``w`` (rad/s), inverse of that and of its integral gain, greatest force (N) that meets
    no limit, and drag (N) of grease at 1 m/s."""

    w: float
    per_w: float
    per_ki: float
    free: float
    grease: float


class _Ramp(NamedTuple):
    """Target (m) and load (N) at both ends of a step of ``dt`` s, and their slopes."""

    begin: float
    end: float
    push: float
    pushes: float
    dt: float
    rate: float
    rising: float


class _State(NamedTuple):
    """Integral of the error (m s), position (m), velocity (m/s) and dry friction (N) of an axis."""

    integral: float
    x: float
    v: float
    dry: float


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
def _of_length(h: float, a: FloatArray, bound: float, known: FloatArray, kept: FloatArray) -> int:
    """Where exp(a h) is ``kept``, with others by its length."""
    j = place(h)
    if abs(h - known[j]) > SAME * h:
        known[j] = h
        _exponential(a, h, bound, kept[j])
    return j


@njit(cache=True, error_model="numpy")
def _loop(p: FloatArray) -> Loop:
    """The loop of its parameters (p,)."""
    return Loop(
        p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], p[8], p[9], p[10], p[11], p[12],
        p[13], p[14], p[15], p[16], p[17], p[18], p[19], p[20], p[21], p[22], p[23], p[24], p[25],
    )  # fmt: skip


@njit(cache=True, error_model="numpy")
def advance_axis(
    s: FloatArray, t: FloatArray, target: FloatArray, load: FloatArray, p: FloatArray, y: FloatArray
) -> None:
    """Positions ``y`` (n,) of an axis of state ``s`` and parameters ``p`` at times ``t`` (n,) s, for its ``target``
    and ``load`` (n,) there."""
    loop = _loop(p)
    m, w = loop.mass, math.sqrt(abs(loop.kp / loop.mass))  # without its integral, which may be as slow as it likes
    grease = loop.thinning * THIN_AT**-loop.thinning_power
    own = _Derived(w, 1.0 / w, 1.0 / loop.ki, loop.force_limit - abs(loop.carried), grease)
    # State (w ∫e, x, x'/w): the same size each, so that the series converges fast.
    a = np.zeros((3, 3))
    a[0, 1], a[1, 2] = -w, w
    a[2, 0], a[2, 1] = loop.ki / (m * w * w), -(loop.kp + loop.spring) / (m * w)
    a[2, 2] = -(loop.kd + loop.drag) / m
    bound = 2.0 * w + loop.ki / (m * w * w) + (abs(loop.kd) + loop.drag) / m + loop.spring / (m * w)
    known, kept = np.zeros(STEPS), np.empty((STEPS, 3, 3))
    if s[0] == 0.0 and t.size:
        s[0], s[1], s[2], s[3] = 1.0, t[0], target[0], load[0]
    before, r, f, slope = s[1], s[2], s[3], s[8]
    at = _State(s[INTEGRAL], s[POSITION], s[VELOCITY], s[DRY])
    for i in range(t.size):
        dt = t[i] - before
        if dt > 1e-7:
            ramp = _Ramp(r, target[i], f, load[i], dt, (target[i] - r) / dt, (load[i] - f) / dt)
            kicked = at.v + _kick(ramp, slope, loop, own)
            slope = ramp.rate if loop.kick != 0.0 else slope
            at = _State(at.integral, at.x, kicked, at.dry)
            whole, moved = _whole(at, ramp, kept[_of_length(dt, a, bound, known, kept)], loop, own)
            if whole:
                at = moved
            else:
                steps = max(math.ceil(dt / SUBSTEP * (1.0 - 1e-9)), 1)
                steps = steps if steps < loop.most_substeps else int(loop.most_substeps)
                e = kept[_of_length(dt / steps, a, bound, known, kept)]
                at = _run(at, ramp, e, steps, loop, own)
        before, r, f = t[i], target[i], load[i]
        y[i] = at.x
    s[1], s[2], s[3], s[8] = before, r, f, slope
    s[INTEGRAL], s[POSITION], s[VELOCITY], s[DRY] = at.integral, at.x, at.v, at.dry


@njit(cache=True, error_model="numpy", inline="always")
def _kick(ramp: _Ramp, slope: float, loop: Loop, own: _Derived) -> float:
    """Speed (m/s) that an axis gains at once where its target turns from a ``slope`` (m/s), fed forward, and where it
    jumps, within the coil's limit."""
    out = loop.kick * (ramp.rate - slope) if loop.kick != 0.0 else 0.0
    if ramp.dt < loop.kick_time:  # so short a step itself lets through a part only
        jump = ramp.end - ramp.begin
        rest = min(loop.fed * abs(jump) - own.free * ramp.dt, own.free * (loop.kick_time - ramp.dt))
        out += math.copysign(max(rest, 0.0), jump) / loop.mass
    return out


@njit(cache=True, error_model="numpy", inline="always")
def _whole(at: _State, ramp: _Ramp, e: FloatArray, loop: Loop, own: _Derived) -> tuple[bool, _State]:
    """One long step, ``e`` its exponential, where nothing forbids it: in a linear loop only a coil at its limit.
    Whether it may be taken, and where it leads."""
    if loop.substep == math.inf:
        return _glides(at, ramp, e, loop, own)
    if ramp.dt <= SUBSTEP * (1.0 + 1e-9) or loop.slope != 0.0 or loop.curvature != 0.0 or loop.soft != 0.0:
        return False, at  # more than friction acts
    if at.v == 0.0 and loop.presliding == 0.0 and loop.easing == 0.0:
        sticks, there = _sticks(at, ramp, loop, own)
        if sticks:
            return True, there
    return _slides(at, ramp, e, loop, own)


@njit(cache=True, error_model="numpy", inline="always")
def _asked(loop: Loop, target: float, rate: float, integral: float, x: float, v: float) -> float:
    """Force (N) that the controller asks for at a ``target`` (m) that moves at a ``rate`` (m/s)."""
    return loop.kp * (target - x) + loop.ki * integral - loop.kd * v + loop.fed * rate - loop.unseen * target


@njit(cache=True, error_model="numpy", inline="always")
def _freely(at: _State, ramp: _Ramp, e: FloatArray, loop: Loop, own: _Derived) -> _State:
    """Where one step of the linear loop leads; ``e`` is its exponential."""
    ahead = (ramp.rising - loop.spring * ramp.rate) * own.per_ki
    rest = ramp.begin + ahead
    damped = (loop.kd + loop.drag - loop.fed_late) * ramp.rate
    ip0 = (damped - ramp.push + loop.spring * rest + loop.kp * ahead) * own.per_ki
    d0, d1, d2 = own.w * (at.integral - ip0), at.x - rest, (at.v - ramp.rate) * own.per_w
    return _State(
        ip0 - ahead * ramp.dt + (e[0, 0] * d0 + e[0, 1] * d1 + e[0, 2] * d2) * own.per_w,
        ramp.end + ahead + e[1, 0] * d0 + e[1, 1] * d1 + e[1, 2] * d2,
        ramp.rate + own.w * (e[2, 0] * d0 + e[2, 1] * d1 + e[2, 2] * d2),
        at.dry,
    )


@njit(cache=True, error_model="numpy", inline="always")
def _glides(at: _State, ramp: _Ramp, e: FloatArray, loop: Loop, own: _Derived) -> tuple[bool, _State]:
    """One long step of the linear loop, unless the coil meets its limit; ``e`` is its exponential."""
    there = _freely(at, ramp, e, loop, own)
    before = _asked(loop, ramp.begin, ramp.rate, at.integral, at.x, at.v)
    behind = _asked(loop, ramp.end, ramp.rate, there.integral, there.x, there.v)
    return max(abs(before), abs(behind)) <= own.free, there


@njit(cache=True, error_model="numpy", inline="always")
def _sticks(at: _State, ramp: _Ramp, loop: Loop, own: _Derived) -> tuple[bool, _State]:
    """One long step in which dry friction holds an axis that stands where it is."""
    x, rho = at.x, ramp.rate
    integral = at.integral + ramp.dt * (0.5 * (ramp.begin + ramp.end) - x)
    before, behind = _asked(loop, ramp.begin, rho, at.integral, x, 0.0), _asked(loop, ramp.end, rho, integral, x, 0.0)
    # The load has the part of the target that is not seen already; the force fed forward is late.
    more = (loop.fed_late - loop.fed) * rho - loop.spring * x
    pushed = before + loop.unseen * ramp.begin + more + ramp.push
    pushes = behind + loop.unseen * ramp.end + more + ramp.pushes
    held = max(abs(pushed), abs(pushes)) < loop.coulomb and max(abs(before), abs(behind)) <= own.free
    return held, _State(integral, x, 0.0, pushes)


@njit(cache=True, error_model="numpy", inline="always")
def _level(v: float, loop: Loop) -> float:
    """Greatest dry friction (N) at ``v`` m/s, by Stribeck's curve."""
    if loop.stiction == 0.0:
        return loop.coulomb
    return loop.coulomb + loop.stiction * math.exp(-((v / loop.stribeck_speed) ** 2))


@njit(cache=True, error_model="numpy", inline="always")
def _dry(v: float, loop: Loop) -> float:
    """Dry friction (N) at ``v`` m/s, of an axis without presliding."""
    if loop.easing > 0.0:
        return loop.coulomb * math.tanh(v / loop.easing)
    return math.copysign(_level(v, loop), v) if v != 0.0 and loop.presliding == 0.0 else 0.0


@njit(cache=True, error_model="numpy", inline="always")
def _rubs(v: float, loop: Loop, own: _Derived) -> float:
    """Friction (N) that ``v`` m/s tells: all but that of presliding."""
    if own.grease > 0.0:
        return math.copysign(own.grease * abs(v) ** loop.thinning_power, v) + _dry(v, loop)
    return _dry(v, loop)


@njit(cache=True, error_model="numpy", inline="always")
def _slides(at: _State, ramp: _Ramp, e: FloatArray, loop: Loop, own: _Derived) -> tuple[bool, _State]:
    """One long step in which friction hardly changes, held at that of its mean speed: an axis that creeps, or goes on
    one way. The friction of either end would move it by less than `UNMOVED` beside that."""
    per_newton = own.w * e[1, 0] * own.per_ki
    if per_newton <= 0.0:  # a loop that swings
        return False, at
    glides, there = _glides(at, ramp, e, loop, own)
    if not glides:
        return False, at
    mean, yields = (there.x - at.x) / ramp.dt, per_newton / ramp.dt
    grease = thinned(mean, yields, own.grease, loop.thinning_power) if own.grease > 0.0 else 0.0
    free, off, dry = mean + yields * grease, 0.0, at.dry
    if loop.easing > 0.0:
        dry = held = -eased(free, yields, loop.coulomb, loop.easing)
    elif loop.presliding > 0.0:
        level = _level(free - yields * at.dry, loop)
        dry = bristle(at.dry, free, 0.5 * yields, level, ramp.dt / loop.presliding)
        held, off = 0.5 * (at.dry + dry), abs(dry - at.dry)
    else:
        dry = held = _dry(free, loop)
    force = grease - held
    integral, x = there.integral - (1.0 - e[0, 0]) * force * own.per_ki, there.x + per_newton * force
    v = there.v + own.w * own.w * e[2, 0] * own.per_ki * force
    mean = (x - at.x) / ramp.dt
    if abs(v - mean) * own.per_w < UNMOVED:  # steep friction: the rest of the speed is braked at once
        v = mean
    limited = abs(_asked(loop, ramp.end, ramp.rate, integral, x, v)) > own.free
    if limited or abs(x) > _END_STOP:
        return False, at
    told = _rubs(mean, loop, own) if held != 0.0 else -grease  # which is that of the speed that it leaves
    off = max(off, abs(_rubs(at.v, loop, own) - told), abs(_rubs(v, loop, own) - told))
    if loop.presliding == 0.0:
        off = max(off, abs(told + force))
    elif min(at.v * v, at.v * mean) < 0.0 and max(abs(at.v), abs(v)) * ramp.dt > TURN * loop.presliding:
        return False, at  # it turns within the step, and much of presliding goes and comes
    return off <= UNMOVED * loop.kp, _State(integral, x, v, dry)


@njit(cache=True, error_model="numpy")
def _withheld(loop: Loop, x: float, asked: float, answers: float) -> tuple[float, bool]:
    """Force (N) that a coil at ``x`` m gives beside the mean one ``asked``, of a step at whose middle the controller
    ``answers`` each newton of it by so many against it; and whether the coil is at its limit."""
    limit, extra, given = loop.force_limit, 0.0, 0.0
    share = max(1.0 + loop.slope * x + loop.curvature * x * x, 0.05)
    for _ in range(6):
        force = asked - answers * extra
        real = force * share + loop.carried
        given = limit * math.tanh(real / limit) if loop.soft > 0.0 else min(max(real, -limit), limit)
        extra = given - loop.carried - force
    return extra, abs(given) >= limit


@njit(cache=True, error_model="numpy", inline="always")
def _braked(at: _State, v: float, gain: float, h: float, loop: Loop) -> tuple[float, float, bool]:
    """Dry friction (N) over a step of ``h`` s that would end at ``v`` m/s without it, where each newton adds ``gain``
    m/s; that behind it, which is kept; and whether it stops the axis."""
    if loop.easing > 0.0:
        return eased(0.5 * (at.v + v), 0.5 * gain, loop.coulomb, loop.easing), at.dry, False
    if loop.coulomb <= 0.0 and loop.stiction <= 0.0:
        return 0.0, at.dry, False
    level = _level(0.5 * (at.v + v - gain * at.dry), loop)  # with the friction of the step before
    if loop.presliding > 0.0:
        behind = bristle(at.dry, 0.5 * (at.v + v), 0.25 * gain, level, h / loop.presliding)
        return -0.5 * (at.dry + behind), behind, False
    dry = min(max(-v / gain, -level), level)
    return dry, -dry, abs(dry) < level


@njit(cache=True, error_model="numpy", inline="always")
def _run(at: _State, ramp: _Ramp, e: FloatArray, steps: int, loop: Loop, own: _Derived) -> _State:
    """Where a step leads in so many ``steps``; ``e`` is the exponential of one."""
    h = ramp.dt / steps
    even = loop.slope == 0.0 and loop.curvature == 0.0 and loop.soft == 0.0
    gain = own.w * own.w * e[2, 0] * own.per_ki  # of the speed at the end of the step, per newton
    answers = 0.5 * (loop.kp * own.w * e[1, 0] * own.per_ki + 1.0 - e[0, 0] + loop.kd * gain)
    for k in range(steps):
        r0, r1 = ramp.begin + ramp.rate * h * k, ramp.begin + ramp.rate * h * (k + 1)
        part = _Ramp(r0, r1, ramp.push + ramp.rising * h * k, 0.0, h, ramp.rate, ramp.rising)
        free = _freely(at, part, e, loop, own)
        integral, x, v = free.integral, free.x, free.v
        before = _asked(loop, r0, ramp.rate, at.integral, at.x, at.v)
        behind = _asked(loop, r1, ramp.rate, integral, x, v)
        extra, limited, grease = 0.0, False, 0.0
        if not even or max(abs(before), abs(behind)) > own.free:
            extra, limited = _withheld(loop, at.x, 0.5 * (before + behind), answers)
            v += gain * extra
        if own.grease > 0.0:
            grease = thinned(0.5 * (at.v + v), 0.5 * gain, own.grease, loop.thinning_power)
            v += gain * grease
        dry, kept, stops = _braked(at, v, gain, h, loop)
        force = extra + grease + dry
        v += gain * dry
        x += own.w * e[1, 0] * force * own.per_ki
        integral -= (1.0 - e[0, 0]) * force * own.per_ki
        if stops:
            v = 0.0
            if at.v == 0.0:  # and stood before: it stays where it is
                x, integral = at.x, at.integral + h * (0.5 * (r0 + r1) - at.x)
        if limited:
            integral = at.integral + loop.windup * (integral - at.integral)
        elif loop.soft > 0.0:  # it tracks the coil's force: back-calculation by the force withheld over Kp
            integral += (1.0 - loop.windup) * h * extra / loop.kp
        if abs(x) > _END_STOP:
            x, v = math.copysign(_END_STOP, x), 0.0
        at = _State(integral, x, v, kept)
    return at
