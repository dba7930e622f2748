"""The robot's three driven axes: voice coil, moving mass and the PID loop that closes over them.

m x'' = F - (c + drag) x' - friction + load, F = Kp (b r - x) + Ki ∫e - Kd x' + Kf r' + Ka r'' with e = r - x, r the
target. The linear loop is integrated exactly for targets and loads that are linear in a step: about the particular
solution x = r + λ/Ki, x' = ρ (ρ, λ the slopes of target and load) the deviation moves by the matrix exponential. The
nonlinear part (friction, force limit, uneven force constant) acts as a force held over substeps of at most
``SUBSTEP``; dry friction takes at most the impulse that stops the axis, so that sticking is exact.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit

from sim_devices.chain import FloatArray, Signals
from sim_devices.stages.friction import THIN_AT, bristle, eased, thinned
from sim_devices.stages.kernels import SAME, STEPS, place
from sim_devices.stages.operators import Wired

MASS = 0.060
"""Moving mass of an axis, kg (assumed)."""
LOOP_RATE = 100.0
"""Triple pole of the nominal closed loop, 1/s (assumed): Kp = 3 m p², Ki = m p³, Kd = 3 m p."""
FORCE_LIMIT = 10.0
"""Greatest force of a coil, N (assumed)."""
SUBSTEP = 1e-3
"""s, where a nonlinearity is present."""
UNMOVED = 1e-7
"""m by which friction that changes within a step may move an axis, if it is taken as held."""
TURN = 0.1
"""Of the presliding length, which an axis may go forth and back within a step."""
_END_STOP = 6e-3  # m from the centre; only a lost control of an axis leads there
_RUBBING = [4, 5, 6, 8, 18]  # of a loop's parameters: drag, dry friction, stiction, presliding, drag that thins
_LONGEST = 14  # and the longest substep, s
_UNSEEN = 23  # N/m of the target that the proportional part does not see
_STATE = 9  # [0] started [1] time [2] target [3] load [4] integral [5] position [6] velocity [7] dry friction [8] slope


@dataclass(frozen=True)
class AxisLoop(Wired):
    """Closed loop of each axis. Sources are the targets (m), then the loads on the axes (N; absent means none).

    ``rate`` (1/s) sets the gains. The rest are imperfections, zero when there are none: ``drag`` N s/m; ``coulomb`` N,
    ``stiction`` N above it near standstill with Stribeck speed ``stribeck_speed`` m/s, ``presliding`` m (0: none), or
    dry friction in proportion to tanh(x'/``easing``), m/s (0: none);
    ``force_limit`` N, met abruptly, or approached as by tanh if ``soft`` is 1; ``carried`` N of a coil's force hold a
    weight, so that the limit is nearer one way; ``windup`` 0 (integrator frozen while the force is limited) to 1
    (runs on); relative change of the force constant ``slope`` 1/m and ``curvature`` 1/m². Grease that shear thins
    brakes with ``thinning`` N at 1 mm/s and with ``thinning_power`` of the speed, air that swirls with a power of 2.
    What rubs is of the axis ``alone`` (1 to 3), or of all (0).
    ``fed`` N s/m (Kf) is the controller's force in proportion to the target's speed, ``weight`` (b) the share of the
    target that its proportional part sees (Åström and Hägglund, set-point weighting), ``thrust`` kg (Ka) what it gives
    for the target's acceleration: a kick where the target turns. ``kick`` s is how long a coil pushes at its limit
    where the target jumps, as its card sees a rate for some cycles: at a jump of d the axis gains at most Kf d / m.
    ``lag`` s is how late the coil's force is: a card's cycle, its filters, the coil's current. It is short against the
    loop's time constant, and taken to first order: F(t - lag) = F - lag F' takes lag Ki off Kp, lag Kp off Kd,
    lag b Kp off Kf, lag Kf off Ka, and lag Kd off the mass.
    ``spring`` N/m holds each axis towards zero: the stiffness that loops through a tissue assume of it
    (``robot.closed_loop``), so that only the difference is iterated. A step has ``most_substeps``, however long it is:
    where nodes are dense after kinks and wide elsewhere, few are enough.
    """

    rate: float = LOOP_RATE
    mass: float = MASS
    drag: float = 0.0
    coulomb: float = 0.0
    stiction: float = 0.0
    stribeck_speed: float = 1e-3
    presliding: float = 0.0
    force_limit: float = FORCE_LIMIT
    soft: float = 0.0
    windup: float = 0.0
    slope: float = 0.0
    curvature: float = 0.0
    spring: float = 0.0
    carried: float = 0.0
    alone: int = 0
    fed: float = 0.0
    weight: float = 1.0
    thrust: float = 0.0
    kick: float = 0.0
    lag: float = 0.0
    thinning: float = 0.0
    thinning_power: float = 0.5
    easing: float = 0.0
    most_substeps: float = math.inf

    def controller(self) -> tuple[float, float, float]:
        """Proportional, integral and derivative gain, N/m, N/(m s), N s/m."""
        return 3 * self.mass * self.rate**2, self.mass * self.rate**3, 3 * self.mass * self.rate

    def fresh(self) -> Any:
        (kp, ki, kd), late = self.controller(), self.lag
        linear = not (self.coulomb or self.stiction or self.slope or self.curvature or self.soft or self.thinning)
        values = (
            self.mass - late * kd, kp - late * ki, ki, kd - late * kp,
            self.drag, self.coulomb, self.stiction, self.stribeck_speed, self.presliding,
            self.force_limit, self.windup, self.slope, self.curvature, self.spring,
            math.inf if linear else SUBSTEP, self.soft, self.carried, self.fed,
            self.thinning, self.thinning_power, self.easing, self.most_substeps, self.fed - late * self.weight * kp,
            (1.0 - self.weight) * kp, (self.thrust - late * self.fed) / (self.mass - late * kd),
            self.kick,
        )  # fmt: skip
        return np.zeros((len(self.target), _STATE)), np.array(values)

    def advance(self, state: Any, time: FloatArray, signals: Signals) -> None:
        rows, parameters = state
        smooth = parameters.copy()
        smooth[_RUBBING] = 0.0
        if not (self.slope or self.curvature or self.soft):
            smooth[_LONGEST] = math.inf
        n = len(self.target)
        wires = zip(rows, self.source[:n], self.source[n:], self.target, strict=True)
        for axis, (row, source, load, target) in enumerate(wires, start=1):
            out = np.empty(len(time))
            push = signals[load] if load in signals else np.zeros(len(time))
            if self.weight != 1.0:  # the part of the target that the controller does not see is as a load
                push = push - parameters[_UNSEEN] * signals[source]
            own = parameters if self.alone in (0, axis) else smooth
            _advance_axis(row, time, signals[source], push, own, out)
            signals[target] = out


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
def _advance_axis(
    s: FloatArray, t: FloatArray, target: FloatArray, load: FloatArray, p: FloatArray, y: FloatArray
) -> None:
    m, kp, ki, kd, drag, spring, longest = p[0], p[1], p[2], p[3], p[4], p[13], p[14]
    w = math.sqrt(abs(kp / m))  # rad/s, of the loop without its integral: an integral may be as slow as it likes
    per_ki, per_w = 1.0 / ki, 1.0 / w
    # State (w ∫e, x, x'/w): the same size each, so that the series converges fast.
    a = np.zeros((3, 3))
    a[0, 1], a[1, 2] = -w, w
    a[2, 0], a[2, 1], a[2, 2] = ki / (m * w * w), -(kp + spring) / (m * w), -(kd + drag) / m
    bound = 2.0 * w + ki / (m * w * w) + (abs(kd) + drag) / m + spring / (m * w)
    known, exponentials = np.zeros(STEPS), np.empty((STEPS, 3, 3))
    only_rubs = longest < math.inf and _only_rubs(p)
    if s[0] == 0.0 and t.size:
        s[0], s[1], s[2], s[3] = 1.0, t[0], target[0], load[0]
    for i in range(t.size):
        dt = t[i] - s[1]
        if dt > 1e-7:
            if p[24] != 0.0:
                rho = (target[i] - s[2]) / dt
                s[6] += p[24] * (rho - s[8])
                s[8] = rho
            if dt < p[25]:  # the rest of what the limit lets through, which a step so short does not
                jump, limit = target[i] - s[2], p[9] - abs(p[16])
                rest = min(p[17] * abs(jump) - limit * dt, limit * (p[25] - dt))
                s[6] += math.copysign(max(rest, 0.0), jump) / m
            steps = max(math.ceil(dt / (SUBSTEP if longest == math.inf else longest) * (1.0 - 1e-9)), 1)
            steps = steps if steps < p[21] else int(p[21])
            if longest == math.inf:
                e = _of_length(dt, a, bound, known, exponentials)
                # Only a coil at its limit forbids one long step.
                steps = 0 if _glides(s, p, w, per_ki, per_w, e, target[i], load[i], dt) else steps
            elif only_rubs and steps > 1:
                e = _of_length(dt, a, bound, known, exponentials)
                if _sticks(s, p, target[i], load[i], dt) or _slides(s, p, w, per_ki, per_w, e, target[i], load[i], dt):
                    steps = 0
            if steps:
                h = dt / steps
                _run(s, p, w, _of_length(h, a, bound, known, exponentials), target[i], load[i], h, steps)
        s[1], s[2], s[3] = t[i], target[i], load[i]
        y[i] = s[5]


@njit(cache=True, error_model="numpy", inline="always")
def _only_rubs(p: FloatArray) -> bool:
    """Whether of all that is not linear only friction acts."""
    return bool(p[11] == 0.0 and p[12] == 0.0 and p[15] == 0.0)


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
    kp, ki, kd, spring, per_dt = p[1], p[2], p[3], p[13], 1.0 / dt
    rho = (target - s[2]) * per_dt
    ahead = ((load - s[3]) * per_dt - spring * rho) * per_ki
    ip0 = ((kd + p[4] - p[22]) * rho - s[3] + spring * (s[2] + ahead) + kp * ahead) * per_ki
    d0, d1, d2 = w * (s[4] - ip0), s[5] - (s[2] + ahead), (s[6] - rho) * per_w
    integral = ip0 - ahead * dt + (e[0, 0] * d0 + e[0, 1] * d1 + e[0, 2] * d2) * per_w
    x = target + ahead + e[1, 0] * d0 + e[1, 1] * d1 + e[1, 2] * d2
    v = rho + w * (e[2, 0] * d0 + e[2, 1] * d1 + e[2, 2] * d2)
    before = kp * (s[2] - s[5]) + ki * s[4] - kd * s[6] + p[17] * rho - p[23] * s[2]
    behind = kp * (target - x) + ki * integral - kd * v + p[17] * rho - p[23] * target
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
    force = thinned(mean, yields, p[18], p[19]) if p[18] > 0.0 else 0.0
    free = mean + yields * force
    if p[20] > 0.0:
        force += eased(free, yields, p[5], p[20])
    elif p[8] > 0.0:
        s[7] = bristle(dry, free, 0.5 * yields, _level(free - yields * dry, p), dt / p[8])
        force -= 0.5 * (dry + s[7])
    else:
        force -= _dry(free, p)
    s[4] -= (1.0 - e[0, 0]) * force * per_ki
    s[5] += per_newton * force
    s[6] += w * w * e[2, 0] * per_ki * force
    mean = (s[5] - x) / dt
    if abs(s[6] - mean) * per_w < UNMOVED:  # steep friction: what held one leaves of the speed is gone at once
        s[6] = mean
    told = _rubs(mean, p)
    off = max(abs(_rubs(v, p) - told), abs(_rubs(s[6], p) - told), abs(s[7] - dry))
    if p[8] == 0.0:
        off = max(off, abs(told + force))
    elif min(v * s[6], v * mean) < 0.0 and max(abs(v), abs(s[6])) * dt > TURN * p[8]:
        off = math.inf  # it turns within the step, and much of presliding goes and comes
    if off > UNMOVED * p[1] or abs(s[5]) > _END_STOP:
        s[4], s[5], s[6], s[7] = integral, x, v, dry
        return False
    return True


@njit(cache=True, error_model="numpy")
def _sticks(s: FloatArray, p: FloatArray, target: float, load: float, dt: float) -> bool:
    """One long step in which dry friction holds the axis where it is.

    Returns whether it was taken; else ``s`` is as before."""
    kp, ki, spring, x, limit = p[1], p[2], p[13], s[5], p[9] - abs(p[16])
    if s[6] != 0.0 or p[8] > 0.0 or p[20] > 0.0:
        return False
    fed = p[17] * (target - s[2]) / dt
    ahead = p[22] * (target - s[2]) / dt  # as fed, but late
    integral = s[4] + dt * (0.5 * (s[2] + target) - x)
    before = kp * (s[2] - x) + ki * s[4]
    behind = kp * (target - x) + ki * integral
    pull = max(abs(before + ahead + s[3] - spring * x), abs(behind + ahead + load - spring * x))
    if pull >= p[5] or max(abs(before + fed - p[23] * s[2]), abs(behind + fed - p[23] * target)) > limit:
        return False
    s[4] = integral
    return True


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
    kp, ki, kd, drag, coulomb, stiction, presliding = p[1], p[2], p[3], p[4], p[5], p[6], p[8]
    limit, windup, slope, curvature, spring, soft, carried = p[9], p[10], p[11], p[12], p[13], p[15], p[16]
    rho = (target - s[2]) / (h * steps)
    lam = (load - s[3]) / (h * steps) - spring * rho
    for k in range(steps):
        r0, r1 = s[2] + rho * h * k, s[2] + rho * h * (k + 1)
        error = r0 - s[5] + 0.5 * h * (rho - s[6])  # at the middle of the step, about its mean
        force = kp * error + ki * (s[4] + 0.5 * h * error) - kd * s[6] + p[17] * rho - p[23] * 0.5 * (r0 + r1)
        real = force * max(1.0 + slope * s[5] + curvature * s[5] * s[5], 0.05) + carried
        limited = abs(real) >= limit and soft == 0.0
        extra = (limit * math.tanh(real / limit) if soft > 0.0 else min(max(real, -limit), limit)) - carried - force
        load0 = s[3] + (load - s[3]) / steps * k - spring * (r0 + lam / ki)
        ip0 = ((kd + drag - p[22]) * rho - load0 - extra + kp * lam / ki) / ki
        d0, d1, d2 = w * (s[4] - ip0), s[5] - (r0 + lam / ki), (s[6] - rho) / w
        integral = ip0 - lam * h / ki + (e[0, 0] * d0 + e[0, 1] * d1 + e[0, 2] * d2) / w
        x = r1 + lam / ki + e[1, 0] * d0 + e[1, 1] * d1 + e[1, 2] * d2
        v = rho + w * (e[2, 0] * d0 + e[2, 1] * d1 + e[2, 2] * d2)
        gain = w * w * e[2, 0] / ki  # of the speed at the end of the step, per newton
        if p[18] > 0.0:
            grease = thinned(0.5 * (s[6] + v), 0.5 * gain, p[18], p[19])
            v += gain * grease
            x += w * e[1, 0] * grease / ki
            integral -= (1.0 - e[0, 0]) * grease / ki
        if p[20] > 0.0:
            dry = eased(0.5 * (s[6] + v), 0.5 * gain, coulomb, p[20])
            v += gain * dry
            x += w * e[1, 0] * dry / ki
            integral -= (1.0 - e[0, 0]) * dry / ki
        elif coulomb > 0.0 or stiction > 0.0:
            level = _level(0.5 * (s[6] + v - gain * s[7]), p)  # with the friction of the step before
            if presliding > 0.0:
                after = bristle(s[7], 0.5 * (s[6] + v), 0.25 * gain, level, h / presliding)
                dry, s[7] = -0.5 * (s[7] + after), after
            else:
                dry = min(max(-v / gain, -level), level)
                s[7] = -dry
            v += gain * dry
            x += w * e[1, 0] * dry / ki
            integral -= (1.0 - e[0, 0]) * dry / ki
            if presliding == 0.0 and abs(dry) < level:  # stopped
                v = 0.0
                if s[6] == 0.0:  # and was: stays where it is
                    x, integral = s[5], s[4] + h * (0.5 * (r0 + r1) - s[5])
        if limited:
            integral = s[4] + windup * (integral - s[4])
        if abs(x) > _END_STOP:
            x, v = math.copysign(_END_STOP, x), 0.0
        s[4], s[5], s[6] = integral, x, v
