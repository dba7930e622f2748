"""Plans of a session: which recordings a lab makes with an instrument, and the grids they are simulated on.

Pressures are suctions (positive pascals) inside this package; bundles carry them negative. Lengths are metres.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from .signals import Array

STEP = 2.5e-3  # s, integration step of the suction chain during a recording
REST_STEP = 0.05  # s, between recordings, where nothing is commanded
JUMP = 1e-3  # s, a commanded step is a ramp this long
MBAR = 100.0  # Pa


@dataclass(frozen=True)
class Recording:
    """One recording: commanded waveform ``corners`` (time from start [s], suction [Pa] or displacement [m]).

    ``onset`` is when the first loading is commanded, in seconds from the start. For the robot ``direction`` is the
    unit vector of the commanded motion.
    """

    start: float
    duration: float
    corners: tuple[tuple[float, float], ...]
    onset: float
    condition: str
    repeat: int
    specimen: str = "skin"
    direction: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def stamps(self, rate: float) -> Array:
        """Nominal sampling instants on the session's clock [s]."""
        return self.start + np.arange(round(self.duration * rate)) / rate

    def command(self, t: Array) -> Array:
        """Commanded value at session times ``t`` (linear between corners, 0 or last value outside)."""
        times, values = np.array(self.corners).T
        return np.interp(t - self.start, times, values)


@dataclass(frozen=True)
class Session:
    """All recordings of a case in order, their sampling rate [Hz], and the simulation grid ``t`` (N,), steps ``dt``."""

    instrument: str
    recordings: tuple[Recording, ...]
    rate: float
    t: Array = field(repr=False)
    dt: Array = field(repr=False)

    def command(self, t: Array) -> Array:
        """Commanded scalar at any session times; each recording's waveform rests at 0 between recordings."""
        times: list[float] = [-1e3]
        values: list[float] = [0.0]
        for r in self.recordings:
            times += [r.start + c[0] for c in r.corners]
            values += [c[1] for c in r.corners]
        return np.interp(t, [*times, 1e9], [*values, 0.0])

    def per_recording(self, values: Sequence[float] | Array) -> Array:
        """A step function of time on the grid: ``values[k]`` from the start of recording k to the next start."""
        index = np.searchsorted([r.start for r in self.recordings], self.t, side="right") - 1
        return np.asarray(values, float)[np.clip(index, 0, None)]


def _grid(recordings: Sequence[Recording], rest_step: float, step: float) -> tuple[Array, Array]:
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


def _hold(level: float, onset: float, hold: float, rest: float) -> tuple[list[tuple[float, float]], float]:
    end = onset + hold
    corners = [(0.0, 0.0), (onset, 0.0), (onset + JUMP, level), (end, level), (end + JUMP, 0.0)]
    return corners, end + rest


def _triangle(level: float, onset: float, leg: float, rest: float) -> tuple[list[tuple[float, float]], float]:
    corners = [(0.0, 0.0), (onset, 0.0), (onset + leg, level), (onset + 2 * leg, 0.0)]
    return corners, onset + 2 * leg + rest


def _cycles(level: float, onset: float, hold: float, rest: float, n: int) -> tuple[list[tuple[float, float]], float]:
    corners, now = [(0.0, 0.0)], onset
    for _ in range(n):
        corners += [(now, 0.0), (now + JUMP, level), (now + hold, level), (now + hold + JUMP, 0.0)]
        now += hold + rest
    return corners, now + 1.0


def _place(
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


def suction_session(instrument: str, rng: np.random.Generator, reference: bool) -> Session:
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
        return (f"hold {level:.0f}", *_hold(level, onset, hold, rest), specimen)

    def ramp(level: float, specimen: str = "skin") -> tuple[str, list[tuple[float, float]], float, str]:
        return (f"ramp {level:.0f}", *_triangle(level, onset, level / rate, rest), specimen)

    items = [step(levels[0]), step(levels[1]), step(levels[2]), step(levels[1])]
    items += [ramp(levels[int(rng.integers(1, 3))])] * int(rng.integers(1, 3))
    if rng.random() < 0.5:
        items.append(("cycles", *_cycles(levels[1], onset, 4.0, 3.0, 3), "skin"))
    order = rng.permutation(len(items))
    items = [items[k] for k in order]
    if reference:
        block = [step(levels[1], "rigid block"), ramp(levels[2], "rigid block")]
        items = block + items if rng.random() < 0.5 else items + block
    recordings = _place(items, onset, rng.uniform(20, 50, len(items)).round(1))
    t, dt = _grid(recordings, REST_STEP, STEP)
    return Session(instrument, recordings, 100.0 if cut else 25.0, t, dt)


def robot_session(rng: np.random.Generator, reference: bool) -> Session:
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
    t, dt = _grid(made, 5e-3, 5e-3)
    return Session("microrobot", tuple(made), 100.0, t, dt)
