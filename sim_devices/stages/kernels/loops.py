"""Closed loops of pressure that are not linear: a controller with an integral about a proportional valve."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from sim_devices.stages.kernels.base import QUICKEST_LAG, FloatArray


class Loop(NamedTuple):
    """The parameters of a `valve_loop` as its rates need them, without a division; of a tuple, unlike of an array, a
    compiler knows that no store of a state changes it."""

    weighed: float  # gain of the set-point, k b
    gain: float  # k, 1/s
    resets: float  # k r, 1/s²
    widest: float  # Pa/s that the valve gives at most
    per_lag: float  # 1/s, of the valve's lag
    spring: float  # 1/s², of a valve with inertia; 0 if it has none
    drag: float  # 1/s
    softly: float  # share by which the valve comes softly to its end
    highest: float  # Pa above the air's
    rise: float  # fastest, Pa/s
    fall: float
    eased: float  # 1 if these are approached softly
    per_span: float  # 1/Pa
    building: float  # flow of an empty chamber, and how it falls with suction
    less: float
    venting: float  # the same while it is vented, and how it rises
    more: float
    tracks: float  # 1/s, of the integral while the valve is at its end
    resets_then: float  # k r, as far as it goes on meanwhile


PARTS, QUICK_PARTS = 6.0, 2.0
"""Steps in the loop's time constant or the chamber's, and in the valve's, which need not be followed as closely."""
QUICKEST = 3e-3
"""s: a valve that is quicker than this counts as so quick; it saves steps and moves no pressure that is sampled."""
LIGHTEST = 0.05
"""Inertia of a valve, below which it counts as none."""
KEENEST = 500.0
"""1/s: a gain that is larger counts as so large. A fit that tries one, which no valve has, is not to take minutes."""
AT_REST = 1e-9
"""Share of the command's largest value by which pressure may be off it, or move within a step, and be at rest."""
NOTHING, VENTED = -1.0, -50.0
"""Pa above which a command asks for nothing, and a chamber is empty."""
LONG, MOST = 5.0, 5000
"""s of a command that stays as it is, behind which a chamber is at rest; and steps of an interval at most."""
STILL = 0.2
"""Of the nominal flow: where a valve lets less out of an empty chamber, its controller's integral would stay."""
CLEARS = ("never", "unasked", "at air", "touched", "still")
"""When a controller clears its integral: never, while nothing is asked for, once the line has come to the air's
pressure meanwhile, or at once where its command comes to nought, though it only touches it, as a triangle does, or
where it stays there,"""
CLEARING, AT_AIR = 0.05, 5e-3
"""and s within which the second and third do, which a command that touches nought leaves as they are."""
LANDED, TOUCHED, STAYED = 2.0, 3.0, 4.0
"""Places of the last three among them."""
LEAST = 1e-3
"""Of the nominal flow, at the ends of a supply's range."""


@njit(cache=True, error_model="numpy")
def _valve_pace(p: FloatArray) -> tuple[float, float]:
    """Gain k, 1/s, of a `valve_loop`'s controller and lag T, s, of its valve."""
    return min(1.0 / (2.0 * p[1] * max(p[0], 1e-9)), KEENEST), max(p[0] / (2.0 * p[1]), QUICKEST)


@njit(cache=True, error_model="numpy")
def _loop(p: FloatArray, k: float, late: float) -> Loop:
    """The loop of a `valve_loop`'s parameters, of a controller's gain ``k`` 1/s and a valve's lag ``late`` s."""
    drag = 1.0 / (p[16] * late) if p[16] > LIGHTEST else 0.0
    return Loop(
        weighed=k * p[5],
        gain=k,
        resets=k * p[4],
        widest=k * p[11],
        per_lag=1.0 / late,
        spring=drag / late,
        drag=drag,
        softly=p[14],
        highest=p[12],
        rise=p[2],
        fall=p[3],
        eased=p[10],
        per_span=1.0 / p[9],
        building=1.0 + p[8],
        less=p[6],
        venting=1.0 - p[8],
        more=p[7],
        tracks=p[15],
        resets_then=k * min(p[15], p[4]),
    )


@njit(cache=True, error_model="numpy")
def _flow(y: float, x: float, loop: Loop) -> float:
    """Flow into the chamber, Pa/s, of a valve that asks for ``x`` at the pressure ``y``."""
    level = min(max(-y * loop.per_span, 0.0), 1.0)
    gain = loop.building - loop.less * level if x < 0.0 else loop.venting + loop.more * level
    flow, up, down = max(gain, LEAST) * x, loop.rise, loop.fall
    if loop.eased > 0.0:
        limit = up if flow > 0.0 else down
        return float(limit * math.tanh(flow / limit)) if limit < math.inf else flow
    return float(min(max(flow, -down), up))


@njit(cache=True, error_model="numpy")
def _valve_rates(
    y: float, x: float, v: float, integral: float, u: float, loop: Loop
) -> tuple[float, float, float, float]:
    """Rates of pressure, valve, its speed and integral of a `valve_loop` that is asked for ``u``."""
    y = min(y, loop.highest)
    asked, widest = loop.weighed * u - loop.gain * y + integral, loop.widest
    given = min(max(asked, -widest), widest)
    resets = loop.resets if given == asked else loop.resets_then
    if loop.softly > 0.0 and widest < math.inf:
        given += loop.softly * (widest * math.tanh(asked / widest) - given)
    gathers = resets * (u - y) + loop.tracks * (given - asked)
    if loop.spring > 0.0:
        return _flow(y, x, loop), v, loop.spring * (given - x) - loop.drag * v, gathers
    return _flow(y, x, loop), (given - x) * loop.per_lag, 0.0, gathers


@njit(cache=True, error_model="numpy")
def _valve_moved(
    state: tuple[float, float, float, float], begin: float, end: float, h: float, loop: Loop
) -> tuple[float, float, float, float]:
    """Pressure, valve, its speed and integral of a `valve_loop` after a step of ``h`` s, while its command goes from
    ``begin`` to ``end``. Classical Runge-Kutta."""
    y, x, v, i = state
    half, sixth, middle = 0.5 * h, h / 6.0, 0.5 * (begin + end)
    y1, x1, v1, i1 = _valve_rates(y, x, v, i, begin, loop)
    y2, x2, v2, i2 = _valve_rates(y + half * y1, x + half * x1, v + half * v1, i + half * i1, middle, loop)
    y3, x3, v3, i3 = _valve_rates(y + half * y2, x + half * x2, v + half * v2, i + half * i2, middle, loop)
    y4, x4, v4, i4 = _valve_rates(y + h * y3, x + h * x3, v + h * v3, i + h * i3, end, loop)
    return (
        y + sixth * (y1 + 2.0 * (y2 + y3) + y4),
        x + sixth * (x1 + 2.0 * (x2 + x3) + x4),
        v + sixth * (v1 + 2.0 * (v2 + v3) + v4),
        i + sixth * (i1 + 2.0 * (i2 + i3) + i4),
    )


@njit(cache=True, error_model="numpy")
def _valve_on(s: FloatArray, u: float, dt: float, parts: int, late: float, clears: float, loop: Loop) -> None:
    """Bring pressure, valve, its speed and integral of a `valve_loop` through ``dt`` s in ``parts`` steps, while its
    command goes to ``u``, or until it is at rest. It ``clears`` its integral as one of `CLEARS`."""
    before, y, x, v, i, still = s[2], s[3], s[4], s[5], s[6], AT_REST * s[7]
    h, change, highest = dt / max(parts, 1), u - before, loop.highest
    rise = change / max(parts, 1)
    kept = math.exp(-h / (CLEARING if clears < LANDED else AT_AIR)) if 0.0 < clears < TOUCHED else 0.0
    for j in range(parts):
        if change == 0.0 and abs(u - y) + (abs(x) + abs(v) * late) * late < still:
            break
        begin, end = before + j * rise, before + (j + 1) * rise
        cleared = i * kept
        y, x, v, i = _valve_moved((y, x, v, i), begin, end, h, loop)
        y = min(y, highest)
        nothing = max(begin, end) if clears == TOUCHED else min(begin, end)
        waits = (clears == LANDED and y <= VENTED) or (clears == STAYED and change != 0.0)
        if clears > 0.0 and nothing > NOTHING and not waits:
            i = cleared
    s[3], s[4], s[5], s[6] = y, x, v, i


@njit(cache=True, error_model="numpy")
def _valve_rested(s: FloatArray, u: float, k: float, p: FloatArray) -> None:
    """Bring the state of a `valve_loop` of gain ``k`` to the end of a long rest at a command of ``u``."""
    s[5] = 0.0
    if s[3] >= p[12]:  # vented: the integral stays, unless it is cleared
        s[6] = 0.0 if p[13] > 0.0 else s[6]
        s[4] = s[6]
    else:  # the rest of a slow end has gone
        s[3], s[4], s[6] = u, 0.0, k * (1.0 - p[5]) * u


@njit(cache=True, error_model="numpy")
def valve_loop(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """Pressure of a chamber by a PI controller and a proportional valve: y' = g(y, x) x, T x' = v - x,
    v = k (b u - y) + I, I' = k r (u - y), with 1/k = 2 zeta tau and T = tau / (2 zeta); it is a second-order lag where
    b = 1, r = 0 and g = 1. Of a valve with ``inertia``, or with a loop of its own: inertia T² x'' + T x' = v - x.

    The flow that a valve lets through follows the pressure across it (ISO 6358): g = 1 + lean - build q while suction
    builds up, 1 - lean + vent q while it is vented, q = -y / span. An error of ``open`` Pa opens it as far as it goes;
    the integral waits meanwhile or, by back-calculation, ``tracks`` the valve: I' = k r (u - y) + tracks (v - asked),
    of an r no larger than that rate (Åström and Hägglund, PID Controllers, 1995, 3.5). It is emptied in a vented
    chamber from which hardly anything flows, or it would stay; and so it does where a chamber vents to ``highest``, the
    air's pressure, and no further. ``p`` = (tau s, zeta, fastest rise and fall, r 1/s, b, build, vent, lean, span, 1 if
    the limits are approached softly, open, highest, which of `CLEARS`, share by which the valve comes softly to its
    end, tracks 1/s, inertia).
    """
    k, late = _valve_pace(p)
    loop = _loop(p, k, late)
    pace = max(PARTS * k, PARTS * math.sqrt(k / late), QUICK_PARTS / late, QUICK_PARTS * loop.drag)
    empties = 1.0 - p[8] < STILL
    if s[0] == 0.0 and t.size:
        s[0], s[1], s[2] = 1.0, t[0], u[0]
    for i in range(t.size):
        dt = t[i] - s[1]
        s[7] = max(s[7], abs(u[i]))
        long = u[i] == s[2] and dt > LONG
        dt = LONG if long else dt
        parts = min(max(math.ceil(dt * pace), 1), MOST) if dt > 1e-7 else 0
        _valve_on(s, u[i], dt, parts, late, p[13], loop)
        if long:
            _valve_rested(s, u[i], k, p)
        if empties and u[i] > NOTHING and s[3] > VENTED:
            s[6] = 0.0
        s[1], s[2], y[i] = t[i], u[i], s[3]


DOZING = 20.0
"""Steps of `sleeping_loop` and `overlapping_loop` in their time constant: the moment of waking is found no finer."""


@njit(cache=True, error_model="numpy")
def _doze(s: FloatArray, vented: bool, off: float, h: float, p: FloatArray) -> None:
    """Count in s[6] for how long a `sleeping_loop` has been ``off`` (Pa) the command by little, after another ``h`` s,
    and let its valve sleep (s[5] = 1) or wake."""
    band, left, patience = p[2], p[2] * p[3], p[4]
    s[6] = 0.0 if vented or off >= left else s[6] + h
    s[5] = 0.0 if vented or off > band else (1.0 if s[6] > patience else s[5])


@njit(cache=True, error_model="numpy")
def sleeping_loop(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """Pressure by a second-order regulator whose valve sleeps until the pressure is off the command by more than a
    band, and then corrects until it has been off by less than a share of this for a while: tau² y'' + 2 zeta tau y' =
    u - y while awake, 0 while asleep. It is awake where nothing is asked for: the chamber is vented.

    ``p`` = (tau s, zeta, band Pa, share, while s). Midpoint rule; the pressure never rises above the air's.
    """
    tau, zeta, band = max(p[0], QUICKEST_LAG), p[1], p[2]
    if s[0] == 0.0 and t.size:
        s[0], s[1], s[2] = 1.0, t[0], u[0]
    for i in range(t.size):
        dt, change = t[i] - s[1], u[i] - s[2]
        parts = max(math.ceil(dt * DOZING / tau), 1) if dt > 1e-7 else 0
        h = dt / max(parts, 1)
        for j in range(parts):
            now, middle = s[2] + j / parts * change, s[2] + (j + 0.5) / parts * change
            off = abs(now - s[3])
            vented = now > NOTHING
            _doze(s, vented, off, h, p)
            if change == 0.0 and abs(s[4]) * tau < AT_REST * band and (s[5] == 1.0 or off < AT_REST * band):
                s[6] += 0.0 if vented else (parts - j - 1) * h
                break
            awake = 1.0 - s[5]
            rate = s[4] + 0.5 * h * (awake * (now - s[3]) - 2.0 * zeta * tau * s[4]) / (tau * tau)
            half = s[3] + 0.5 * h * s[4]
            s[4] += h * (awake * (middle - half) - 2.0 * zeta * tau * rate) / (tau * tau)
            s[3] += h * rate
            if s[3] > 0.0:
                s[3] = s[4] = 0.0
        s[1], s[2], y[i] = t[i], u[i], s[3]


@njit(cache=True, error_model="numpy", inline="always")
def _lapped(error: float, band: float, rounded: bool) -> float:
    """An error as a valve sees it whose spool laps over its port by ``band``: nothing of it within, or ever less."""
    return error - (band * math.tanh(error / band) if rounded else min(max(error, -band), band))


@njit(cache=True, error_model="numpy")
def overlapping_loop(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """Pressure by a second-order regulator whose valve's spool laps over its port: tau² y'' + 2 zeta tau y' = D(u - y),
    D of `_lapped`. Where nothing is asked for, one that is not rounded vents, with D the error itself.

    ``p`` = (tau s, zeta, band Pa, rounded if > 0.5). Midpoint rule; the pressure never rises above the air's.
    """
    tau, zeta, band, rounded = max(p[0], QUICKEST_LAG), p[1], p[2], p[3] > 0.5
    if s[0] == 0.0 and t.size:
        s[0], s[1], s[2] = 1.0, t[0], u[0]
    for i in range(t.size):
        dt, change = t[i] - s[1], u[i] - s[2]
        parts = max(math.ceil(dt * DOZING / tau), 1) if dt > 1e-7 else 0
        h = dt / max(parts, 1)
        for j in range(parts):
            now, middle = s[2] + j / parts * change, s[2] + (j + 0.5) / parts * change
            first, half = now - s[3], middle - s[3] - 0.5 * h * s[4]
            if rounded or now <= NOTHING:
                first, half = _lapped(first, band, rounded), _lapped(half, band, rounded)
            rate = s[4] + 0.5 * h * (first - 2.0 * zeta * tau * s[4]) / (tau * tau)
            s[4] += h * (half - 2.0 * zeta * tau * rate) / (tau * tau)
            s[3] += h * rate
            if s[3] > 0.0:
                s[3] = s[4] = 0.0
        s[1], s[2], y[i] = t[i], u[i], s[3]


LONGEST = 4e-3
"""s of a step of `free_loop`, whose quickest rates are 100/s or so."""
DRIVE_KNOTS = (0.0, 0.03, 0.1, 0.25, 0.5)
"""Of the largest command: errors between which the drive of `free_loop` is straight."""
SPEED_KNOTS = (0.0, 0.05, 0.15, 0.3)
"""Of the largest command over the time constant: speeds between which its resistance is straight."""
LEAST_SLOPE, MOST_SLOPE = -4.0, 2.0
"""Logarithms between which those of `free_loop` are held: beyond, its step would be too long."""
FARTHEST = 10.0
"""Largest commands beyond which nothing of `free_loop` is believed."""
SETTLES = 0.2
"""s in which the controller's memory of `free_loop` forgets, nominally."""
FREE = 2 * (len(DRIVE_KNOTS) + len(SPEED_KNOTS)) + 12
"""How many logarithms make `free_loop` another than a second order."""


@njit(cache=True, error_model="numpy")
def _broken(x: float, lines: FloatArray, first: int, n: int) -> float:
    """A line through 0 that is straight between knots of |x|, with slopes of its own for either sign: from ``first`` on
    in ``lines``, ``n`` knots, ``n`` slopes below 0 and ``n`` above it."""
    at = first + (n if x < 0.0 else 2 * n)
    size, out = abs(x), 0.0
    for k in range(n):
        begin = lines[first + k]
        if size <= begin:
            break
        end = lines[first + k + 1] if k + 1 < n else math.inf
        out += lines[at + k] * (min(size, end) - begin)
    return -out if x < 0.0 else out


@njit(cache=True, error_model="numpy")
def _grown(q: float, rise: FloatArray, k: int) -> float:
    """How many times larger one of the four lines is at a share ``q`` of the largest command."""
    return math.exp(q * (rise[k] + q * rise[k + 5]))


@njit(cache=True, error_model="numpy")
def _free_rates(
    y: float, v: float, z: float, u: float, p: FloatArray, lines: FloatArray, rise: FloatArray
) -> tuple[float, float, float]:
    """Rates of pressure, its speed and the controller's memory in a `free_loop` whose ``lines`` D and R, knots and
    slopes of each, grow by ``rise``."""
    tau, zeta, span = p[0], p[1], p[2]
    e, q = u - y, min(max(-y / span, 0.0), 1.0)
    side, way = 0 if e < 0.0 else 1, 2 if v < 0.0 else 3
    nd, nr = len(DRIVE_KNOTS), len(SPEED_KNOTS)
    push = _broken(e, lines, 0, nd)
    undone = push - lines[(1 + side) * nd] * e
    push *= _grown(q, rise, side) * (math.exp(rise[4]) if u > NOTHING else 1.0)
    drag = _broken(v, lines, 3 * nd, nr) * _grown(q, rise, way)
    forgets = SETTLES * math.exp(rise[11])
    return v, (push + z - 2.0 * zeta * tau * drag) / (tau * tau), (rise[9] * e + rise[10] * undone - z) / forgets


@njit(cache=True, error_model="numpy")
def free_loop(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """Pressure by a regulator of unknown structure, which is at rest where it meets its command:
    tau² y'' = D(e) + z - 2 zeta tau R(y'), T z' = a e + b (D(e) - D'(0) e) - z, e = u - y, with D and R rising lines
    that are broken at `DRIVE_KNOTS` and `SPEED_KNOTS` and have slopes of their own for either sign and at either end of
    the line's pressure; z is a controller's memory of its error, and of the drive that a limit withheld.

    ``p`` = (tau s, zeta, largest command Pa, log slopes of D below and above 0, those of R, how all of these grow with
    q = -y / span, how D does where nothing is asked for, and how they grow with q², a, b, log T); it is a second-order
    lag where all but the first three are 0. Classical Runge-Kutta.
    """
    tau, span = p[0], p[2]
    nd, nr = len(DRIVE_KNOTS), len(SPEED_KNOTS)
    held = np.minimum(np.maximum(p[3:], LEAST_SLOPE), MOST_SLOPE)
    slopes, rise = np.exp(held[: 2 * (nd + nr)]), held[2 * (nd + nr) :]
    speeds = np.array(SPEED_KNOTS) * span / tau
    # One array: counting the references of a tuple of four in each call takes as long as all else.
    lines = np.concatenate((np.array(DRIVE_KNOTS) * span, slopes[: 2 * nd], speeds, slopes[2 * nd :]))
    if s[0] == 0.0 and t.size:
        s[0], s[1], s[2] = 1.0, t[0], u[0]
    for i in range(t.size):
        dt, change = t[i] - s[1], u[i] - s[2]
        parts = max(math.ceil(dt / LONGEST * (1.0 - 1e-9)), 1) if dt > 1e-7 else 0
        h = dt / max(parts, 1)
        s[6] = max(s[6], abs(u[i]))
        for j in range(parts):
            if change == 0.0 and abs(u[i] - s[3]) + abs(s[4]) * tau + abs(s[5]) < AT_REST * s[6]:
                break
            y0, v0, z0, at, half = s[3], s[4], s[5], s[2] + j / parts * change, 0.5 * h
            middle, end = at + half * change / dt, at + h * change / dt
            a1, b1, c1 = _free_rates(y0, v0, z0, at, p, lines, rise)
            a2, b2, c2 = _free_rates(y0 + half * a1, v0 + half * b1, z0 + half * c1, middle, p, lines, rise)
            a3, b3, c3 = _free_rates(y0 + half * a2, v0 + half * b2, z0 + half * c2, middle, p, lines, rise)
            a4, b4, c4 = _free_rates(y0 + h * a3, v0 + h * b3, z0 + h * c3, end, p, lines, rise)
            s[3] = y0 + h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)
            s[4] = v0 + h / 6.0 * (b1 + 2.0 * (b2 + b3) + b4)
            s[5] = z0 + h / 6.0 * (c1 + 2.0 * (c2 + c3) + c4)
            # Steps are too long for some slopes: a fit that tries these is to get a bad number, not none.
            if not max(abs(s[3]), abs(s[4]) * tau, abs(s[5])) < FARTHEST * span:
                s[3], s[4], s[5] = end, 0.0, 0.0
        s[1], s[2], y[i] = t[i], u[i], s[3]
