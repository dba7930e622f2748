"""Plans of a session: which recordings a lab makes with an instrument, and the grids they are simulated on.

Pressures are suctions (positive pascals) inside this package; bundles carry them negative. Lengths are metres.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from .laboratory import Laboratory, nominal
from .signals import Array

STEP = 2.5e-3  # s, integration step of the suction chain during a recording
REST_STEP = 0.05  # s, between recordings, where nothing is commanded
JUMP = 1e-3  # s, a commanded step is a ramp this long
APPROACH = 0.4  # s, that a robot's tip takes to a waveform aside, and back
MBAR = 100.0  # Pa
_COMMAND_RATE = {"cutometer": 100.0, "aspiration": 100.0, "microrobot": 20.0}  # rows a second


@dataclass(frozen=True)
class Recording:
    """One recording: commanded waveform ``corners`` (time from start [s], suction [Pa] or displacement [m]).

    ``onset`` is when the first loading is commanded, in seconds from the start. For the robot ``direction`` is the
    unit vector of the commanded motion. ``table`` are the set-points as the laboratory has them, where they are not
    ``corners``, and ``events`` (time from start, code) those of its log. ``properties`` are the stated ones of a
    reference specimen (see ``specimens``), ``experiment`` is the id of the one it answers. A waveform that does not
    begin at rest is approached ``ahead`` s earlier, and left when it is over.
    """

    start: float
    duration: float
    corners: tuple[tuple[float, float], ...]
    onset: float
    condition: str
    repeat: int
    specimen: str = "skin"
    direction: tuple[float, float, float] = (0.0, 0.0, 0.0)
    table: tuple[tuple[float, float], ...] = ()
    events: tuple[tuple[float, str], ...] = ()
    properties: tuple[tuple[str, tuple[tuple[float, ...], float, str]], ...] = ()
    experiment: str = ""
    ahead: float = 0.0

    @property
    def begins(self) -> float:
        """When the instrument first moves for it, s on the session's clock."""
        return self.start - self.ahead

    def way(self) -> list[tuple[float, float]]:
        """Corners on the session's clock, with the approach and the return of a waveform aside."""
        corners = [(self.start + t, v) for t, v in self.corners]
        if not self.ahead:
            return corners
        end = self.start + max(self.duration, self.corners[-1][0])
        first, last = self.corners[0][1], self.corners[-1][1]
        return [(self.begins, 0.0), (self.begins + APPROACH, first), *corners, (end, last), (end + APPROACH, 0.0)]

    def command(self, t: Array) -> Array:
        """Commanded value at session times ``t`` (linear between corners, 0 or last value outside)."""
        times, values = np.array(self.corners).T
        level: Array = np.interp(t - self.start, times, values)
        return level


@dataclass(frozen=True)
class Session:
    """All recordings of a case in order, the laboratory, and the simulation grid ``t`` (N,), steps ``dt``.

    ``before`` are corners (session's clock) of a loading that nobody recorded. ``span`` is the end of what was planned
    first, s; 0 where nothing was recorded after it.
    """

    instrument: str
    recordings: tuple[Recording, ...]
    lab: Laboratory
    t: Array = field(repr=False)
    dt: Array = field(repr=False)
    before: tuple[tuple[float, float], ...] = ()
    span: float = 0.0

    @property
    def rate(self) -> float:
        """Samples a second."""
        return self.lab.rate

    @property
    def length(self) -> float:
        """s that whatever goes on through the session takes."""
        return self.span or float(self.t[-1])

    def stamps(self, k: int) -> Array:
        """Time stamps (n,) of recording k on the session's clock [s]."""
        r = self.recordings[k]
        number = np.arange(round(r.duration * self.rate))
        scatter = np.random.default_rng(k).uniform(-0.5, 0.5, number.size) * self.lab.uneven
        return np.asarray(r.start + np.round((number + scatter) / self.rate, 4))

    def sampled(self, when: Array, x: Array, fx: Mapping[str, float]) -> Array:
        """A signal x (N,) on the grid at instants ``when`` (n,), or its mean over the period before and after them."""
        if not fx.get("averaged", 0.0):
            return np.interp(when, self.t, x)
        total = np.concatenate([[0.0], np.cumsum(0.5 * (x[1:] + x[:-1]) * np.diff(self.t))])
        half = 0.5 / self.rate
        mean: Array = (np.interp(when + half, self.t, total) - np.interp(when - half, self.t, total)) / (2 * half)
        return mean

    def command(self, t: Array) -> Array:
        """Commanded scalar at any session times; each recording's waveform rests at 0 between recordings."""
        corners = [(-1e3, 0.0), *self.before, *(c for r in self.recordings for c in r.way()), (1e9, 0.0)]
        times, values = np.array(corners).T
        level: Array = np.interp(t, times, values)
        return level

    def commanded(self, k: int) -> tuple[Array, dict[str, Array]]:
        """Times and commanded values of recording k: the laboratory's table, or a grid and every corner, so that linear
        between rows is exact."""
        r = self.recordings[k]
        if r.table:
            times, value = np.array(r.table).T
            t = np.round(r.start + times, 4)
        else:
            rate = _COMMAND_RATE[self.instrument]
            rows = r.start + np.arange(int(r.duration * rate) + 1) / rate
            corners = r.start + np.array([c[0] for c in r.corners])
            t = np.unique(np.round(np.concatenate([rows, corners]), 4))
            value = r.command(t)
        if self.instrument == "microrobot":
            return t, {f"probe_{axis}": value * d for axis, d in zip("xyz", r.direction, strict=True)}
        return t, {"pressure": -value}

    def per_recording(self, values: Sequence[float] | Array) -> Array:
        """A step function of time on the grid: ``values[k]`` from when recording k begins to the next."""
        index = np.searchsorted([r.begins for r in self.recordings], self.t, side="right") - 1
        return np.asarray(values, float)[np.clip(index, 0, None)]


def grid(recordings: Sequence[Recording], rest_step: float, step: float) -> tuple[Array, Array]:
    pieces, now = [np.array([0.0])], 0.0
    for r in recordings:
        for end, h in ((r.start, rest_step), (r.start + r.duration + 0.5, step)):
            n = max(1, int(np.ceil((end - now) / h - 1e-9)))
            if end > now:
                pieces.append(now + (end - now) * np.arange(1, n + 1) / n)
                now = end
    t = np.concatenate(pieces)
    # Rounded so that equal steps are equal numbers: exponentials are then computed once.
    return t, np.round(np.diff(t, prepend=-step), 9).astype(np.float64)


def hold_and_rest(level: float, onset: float, hold: float, rest: float) -> tuple[list[tuple[float, float]], float]:
    end = onset + hold
    corners = [(0.0, 0.0), (onset, 0.0), (onset + JUMP, level), (end, level), (end + JUMP, 0.0)]
    return corners, end + rest


def triangle(level: float, onset: float, leg: float, rest: float) -> tuple[list[tuple[float, float]], float]:
    corners = [(0.0, 0.0), (onset, 0.0), (onset + leg, level), (onset + 2 * leg, 0.0)]
    return corners, onset + 2 * leg + rest


def cycles(level: float, onset: float, hold: float, rest: float, n: int) -> tuple[list[tuple[float, float]], float]:
    corners, now = [(0.0, 0.0)], onset
    for _ in range(n):
        corners += [(now, 0.0), (now + JUMP, level), (now + hold, level), (now + hold + JUMP, 0.0)]
        now += hold + rest
    return corners, now + 1.0


def place(
    items: list[tuple[str, list[tuple[float, float]], float, str]], onset: float, gaps: Array
) -> tuple[Recording, ...]:
    made: list[Recording] = []
    seen: dict[str, int] = {}
    now = 1.0
    for (name, corners, length, specimen), gap in zip(items, gaps, strict=True):
        key = f"{name}/{specimen}"
        seen[key] = seen.get(key, 0) + 1
        duration = np.ceil(length * 25) / 25
        made.append(Recording(round(now, 2), float(duration), tuple(corners), onset, name, seen[key], specimen))
        now += duration + gap
    return tuple(made)


def suction_session(
    instrument: str, rng: np.random.Generator, reference: bool, lab: Laboratory | None = None
) -> Session:
    """A suction session: step-holds at several levels with repeats, a linear ramp up and down, sometimes cycles.

    With ``reference`` one step-hold and one ramp on a rigid block are recorded too, before or after the skin.
    """
    cut = instrument == "cutometer"
    levels = np.sort(rng.choice(np.arange(150, 451, 50) if cut else [66, 100, 133, 166, 200], 3, replace=False)) * MBAR
    hold, rest = (rng.uniform(8, 14), rng.uniform(4, 7)) if cut else (rng.uniform(12, 20), rng.uniform(5, 8))
    onset = round(float(rng.uniform(0.5, 1.2)), 2)
    rate = rng.choice([15.0, 20.0, 30.0] if cut else [15.0, 20.0]) * MBAR
    hold, rest = round(float(hold), 1), round(float(rest), 1)

    def step(level: float, specimen: str = "skin") -> tuple[str, list[tuple[float, float]], float, str]:
        return (f"hold {level:.0f}", *hold_and_rest(level, onset, hold, rest), specimen)

    def ramp(level: float, specimen: str = "skin") -> tuple[str, list[tuple[float, float]], float, str]:
        return (f"ramp {level:.0f}", *triangle(level, onset, level / rate, rest), specimen)

    items = [step(levels[0]), step(levels[1]), step(levels[2]), step(levels[1])]
    items += [ramp(levels[int(rng.integers(1, 3))])] * int(rng.integers(1, 3))
    if rng.random() < 0.5:
        items.append(("cycles", *cycles(levels[1], onset, 4.0, 3.0, 3), "skin"))
    order = rng.permutation(len(items))
    items = [items[k] for k in order]
    if reference:
        block = [step(levels[1], "rigid block"), ramp(levels[2], "rigid block")]
        items = block + items if rng.random() < 0.5 else items + block
    recordings = place(items, onset, rng.uniform(20, 50, len(items)).round(1))
    return Session(instrument, recordings, lab or nominal(instrument), *grid(recordings, REST_STEP, STEP))


def robot_session(rng: np.random.Generator, reference: bool, lab: Laboratory | None = None) -> Session:
    """A robot session: three 0.1 Hz triangles in each of several directions, one repeated, and another waveform.

    The other waveform is a quick push, a hold and a return, or triangles three times as fast. With ``reference`` one
    direction is moved in open air (probe not glued) too.
    """
    amplitude = float(rng.choice([1.2, 1.3, 1.4])) * 1e-3
    onset = 1.0

    def triangles(period: float) -> tuple[list[tuple[float, float]], float]:
        corners = [(0.0, 0.0), (onset, 0.0)]
        for k in range(3):
            corners += [(onset + (k + 0.5) * period, amplitude), (onset + (k + 1) * period, 0.0)]
        return corners, onset + 3 * period + 1.0

    held = [(0.0, 0.0), (onset, 0.0), (onset + 0.4, amplitude), (onset + 8.4, amplitude), (onset + 8.8, 0.0)]
    first = int(rng.integers(0, 12)) * 30.0
    azimuths = (first + np.array([0.0, 90.0, 180.0]) + 30 * rng.integers(0, 2, 3)) % 360
    angles = [(float(a), 0.0) for a in azimuths]
    angles.append((0.0, 90.0) if rng.random() < 0.5 else (float(rng.choice([0.0, 45.0, 90.0])), 45.0))
    plan = [("slow", *triangles(10.0), a, "skin") for a in angles]
    again = int(rng.integers(0, 3))
    other = ("hold", held, onset + 13.0) if rng.random() < 0.5 else ("quick", *triangles(10.0 / 3))
    plan.insert(int(rng.integers(1, 5)), plan[again])
    plan.append((*other, angles[again], "skin"))
    if reference:
        plan.insert(0 if rng.random() < 0.5 else len(plan), ("slow", *triangles(10.0), angles[again], "open air"))
    made: list[Recording] = []
    now, seen = 1.0, dict[str, int]()
    for name, corners, length, (theta, phi), specimen in plan:
        th, ph = np.radians(theta), np.radians(phi)
        direction = (float(np.cos(ph) * np.cos(th)), float(np.cos(ph) * np.sin(th)), float(np.sin(ph)))
        condition = f"{name} {theta:.0f} {phi:.0f}"
        seen[condition + specimen] = seen.get(condition + specimen, 0) + 1
        made.append(
            Recording(now, length, tuple(corners), onset, condition, seen[condition + specimen], specimen, direction)
        )
        now = round(now + length + float(rng.uniform(1.5, 4.0)), 1)
    return Session("microrobot", tuple(made), lab or nominal("microrobot"), *grid(made, 5e-3, 5e-3))
