"""Sessions as other laboratories make them: staircases, slow sines and sums of them, pauses, starts at any phase.

A laboratory's set-points are straight lines between the rows of its table, however coarse; the command around
a pause its table has within some tens of milliseconds only, and its log says that there was one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from .laboratory import Laboratory
from .session import (
    JUMP,
    MBAR,
    REST_STEP,
    STEP,
    Recording,
    Session,
    cycles,
    grid,
    hold_and_rest,
    place,
    triangle,
)

Corners = list[tuple[float, float]]
Item = tuple[str, Corners, float, str]
PAUSED = 0.35  # share of sessions with a paused recording
ASIDE = 0.4  # share of robot sessions whose waveforms are about a place beside the centre


def staircase(levels: Sequence[float], onset: float, each: float, rest: float) -> tuple[Corners, float]:
    """Steps through ``levels``, ``each`` s long."""
    corners, now, last = [(0.0, 0.0)], onset, 0.0
    for level in [*levels, 0.0]:
        corners += [(now, last), (now + JUMP, level)]
        now, last = now + each, level
    return corners, now - each + rest


def smooth(
    level: float, onset: float, hertz: Sequence[float], seconds: float, rows: float, rng: np.random.Generator
) -> tuple[Corners, float]:
    """A raised sine, or a sum of several, that comes from and goes to rest within a second, ``rows`` a second."""
    phase = rng.uniform(0, 2 * np.pi, len(hertz))
    if len(hertz) == 1 and rng.random() < 0.6:
        phase = np.array([-np.pi / 2])
    t = np.arange(int(seconds * rows) + 1) / rows
    wave = sum(np.sin(2 * np.pi * f * t + p) for f, p in zip(hertz, phase, strict=True)) / len(hertz)
    way = level * (0.55 + 0.45 * wave) * np.clip(t, 0, 1) * np.clip(seconds - t, 0, 1)
    return [(0.0, 0.0), *zip((onset + t).tolist(), way.tolist(), strict=True)], onset + seconds + 4.0


def _on_a_grid(corners: Corners, length: float, rows: float) -> Corners:
    """Corners as a table of even rows has them: a jump between two rows is at the later one."""
    t = np.arange(int(length * rows) + 1) / rows
    times, values = np.array(corners).T
    v = np.interp(t + 1e-9, times, values)
    steep = np.abs(np.diff(v)) > 0.5 * np.ptp(values) / max(rows * 0.1, 1.0)
    out: Corners = [(0.0, float(v[0]))]
    for k in range(1, t.size):
        if steep[k - 1]:
            out.append((float(t[k]) - JUMP, float(v[k - 1])))
        out.append((float(t[k]), float(v[k])))
    return out


def _paused(r: Recording, rng: np.random.Generator) -> Recording:
    """The recording with a pause: vented while it lasts, then the interrupted hold from its beginning."""
    times, values = np.array(r.corners).T
    holds = [(a, b, v) for a, b, v, w in zip(times[:-1], times[1:], values[:-1], values[1:], strict=True)
             if v == w and v > 0 and b - a > 2.0]  # fmt: skip
    if not holds:
        return r
    begin, _, level = (float(x) for x in holds[int(rng.integers(len(holds)))])
    stop, pause = begin + float(rng.uniform(0.8, 1.8)), float(rng.uniform(3.0, 8.0))

    def with_it(late: float, early: float) -> Corners:
        first = [(float(t), float(v)) for t, v in zip(times, values, strict=True) if t < stop]
        again = stop + pause
        then = [(float(t) + again - begin, float(v)) for t, v in zip(times, values, strict=True) if t > begin]
        return [*first, (stop + late, level), (stop + late + JUMP, 0.0), (again + early, 0.0),
                (again + early + JUMP, level), *then]  # fmt: skip

    late = rng.uniform(0.0, 0.03, 2)
    done = with_it(float(late[0]), float(late[1]))
    added = stop + pause - begin
    events = ((stop, "pause"), (stop + pause, "resume"))
    longer = float(np.ceil((r.duration + added) * 25) / 25)
    return replace(r, corners=tuple(done), table=tuple(with_it(0.0, 0.0)), duration=longer, events=events)


def _one_paused(recordings: Sequence[Recording], rng: np.random.Generator) -> list[Recording]:
    """One of the recordings with a pause, those after it as much later."""
    k = int(rng.integers(len(recordings)))
    longer = _paused(recordings[k], rng)
    moved = round(longer.duration - recordings[k].duration, 2)
    later = (replace(r, start=round(r.start + moved, 2)) for r in recordings[k + 1 :])
    return [*recordings[:k], longer, *later]


def _tabled(r: Recording, lab: Laboratory) -> Recording:
    """Set-points in the way of the laboratory's tables."""
    if lab.table == "grid" and not r.table:
        on_rows = _on_a_grid(list(r.corners), r.duration, 50.0)
        kept = [c for c in on_rows if abs(c[0] * 50.0 - round(c[0] * 50.0)) < 1e-6]
        return replace(r, corners=tuple(on_rows), table=tuple(kept))
    if lab.table == "corners" and not r.table:
        return replace(r, table=r.corners)
    return r


def _after_a_try(recordings: list[Recording], top: float) -> tuple[list[Recording], tuple[tuple[float, float], ...]]:
    """The recordings a minute after somebody tried the probe up to ``top`` Pa, and the suction (s, Pa) of that."""
    later = [replace(r, start=r.start + 60.0) for r in recordings]
    return later, ((5.0, 0.0), (5.0 + JUMP, top), (25.0, top), (25.0 + JUMP, 0.0))


def wide_suction(instrument: str, rng: np.random.Generator, reference: bool, lab: Laboratory) -> Session:
    """A suction session of another laboratory: holds of one level twice at least, and two to four other waveforms."""
    cut = instrument == "cutometer"
    levels = np.sort(rng.uniform(*((120, 450) if cut else (50, 220)), 3).round()) * MBAR
    onset = round(float(rng.uniform(0.3, 2.0)), 2)
    hold, rest = round(float(rng.uniform(6, 20)), 1), round(float(rng.uniform(3, 8)), 1)
    rate, rows = float(rng.choice([15.0, 20.0, 30.0])) * MBAR, float(rng.choice([50.0, 50.0, 4.0]))

    def wave(kind: str) -> tuple[str, Corners, float]:
        top = float(levels[int(rng.integers(1, 3))])
        if kind == "ramp":
            return (f"ramp {top:.0f}", *triangle(top, onset, top / rate, rest))
        if kind == "staircase":
            steps = [0.4 * top, 0.7 * top, top, 0.5 * top]
            return (f"ramp stairs {top:.0f}", *staircase(steps, onset, float(rng.uniform(2, 6)), rest))
        if kind == "slow":
            hertz = float(rng.uniform(0.02, 0.1))
            return (f"ramp sine {top:.0f}", *smooth(top, onset, [hertz], round(1.5 / hertz), rows, rng))
        if kind == "many":
            hertz = np.sort(rng.uniform(0.03, 0.6, 5)).tolist()
            return (f"ramp sines {top:.0f}", *smooth(top, onset, hertz, 30.0, 50.0, rng))
        return ("cycles", *cycles(float(levels[1]), onset, 4.0, 3.0, 3))

    items: list[Item] = [(f"hold {v:.0f}", *hold_and_rest(float(v), onset, hold, rest), "skin")
                         for v in (*levels, levels[1])]  # fmt: skip
    kinds = rng.choice(["ramp", "staircase", "slow", "many", "cycles"], int(rng.integers(1, 4)), replace=False)
    items += [(*wave(str(kind)), "skin") for kind in kinds]
    items = [items[k] for k in rng.permutation(len(items))]
    if reference:
        block: list[Item] = [(*item[:3], "rigid block") for item in items[:2]]
        items = block + items if rng.random() < 0.5 else items + block
    recordings = list(place(items, onset, rng.uniform(8, 40, len(items)).round(1)))
    if rng.random() < PAUSED:
        recordings = _one_paused(recordings, rng)
    before: tuple[tuple[float, float], ...] = ()
    if rng.random() < 0.25:
        recordings, before = _after_a_try(recordings, float(levels[0]))
    done = tuple(_tabled(r, lab) for r in recordings)
    return Session(instrument, done, lab, *grid(done, REST_STEP, STEP), before)


def wide_robot(rng: np.random.Generator, reference: bool, lab: Laboratory) -> Session:
    """A robot session of another laboratory: triangles or slow sines in several directions, one again, and another
    waveform: a staircase, a sum of sines, or a push that is held."""
    amplitude, onset = float(rng.uniform(0.8, 1.4)) * 1e-3, round(float(rng.uniform(0.3, 1.5)), 2)

    def triangles(period: float) -> tuple[Corners, float]:
        corners = [(0.0, 0.0), (onset, 0.0)]
        for k in range(3):
            corners += [(onset + (k + 0.5) * period, amplitude), (onset + (k + 1) * period, 0.0)]
        return corners, onset + 3 * period + 1.0

    def sine(period: float) -> tuple[Corners, float]:
        t = np.arange(int(2.5 * period * 50) + 1) / 50
        first = 0.0 if rng.random() < 0.5 else float(rng.uniform(0, 2 * np.pi))
        way = amplitude * np.sin(2 * np.pi * t / period + first)
        way *= np.clip(t, 0, 1) * np.clip(t[-1] - t, 0, 1)
        return [(0.0, 0.0), *zip((onset + t).tolist(), way.tolist(), strict=True)], onset + float(t[-1]) + 1.0

    slow = sine if rng.random() < 0.5 else triangles
    period = float(rng.choice([8.0, 10.0, 12.5]))
    held: Corners = [(0.0, 0.0), (onset, 0.0), (onset + 0.4, amplitude), (onset + 8.4, amplitude), (onset + 8.8, 0.0)]
    others = {
        "hold": (held, onset + 13.0),
        "quick": triangles(period / 3),
        "quick stairs": staircase_slowly(amplitude, onset),
        "quick sines": smooth(amplitude, onset, np.sort(rng.uniform(0.05, 0.8, 4)).tolist(), 24.0, 50.0, rng),
    }
    azimuths = (rng.uniform(0, 360) + np.array([0.0, 90.0, 180.0])) % 360
    angles = [(float(a), 0.0) for a in azimuths.round()] + [(float(azimuths[0].round()), float(rng.choice([45, 90])))]
    shape = slow(period)
    plan = [("slow", *shape, a, "skin") for a in angles]
    again = int(rng.integers(0, 3))
    plan.insert(int(rng.integers(1, 5)), plan[again])
    other = str(rng.choice(list(others)))
    plan.append((other, *others[other], angles[again], "skin"))
    if reference:
        plan.insert(0 if rng.random() < 0.5 else len(plan), ("slow", *shape, angles[again], "open air"))
    aside = float(rng.uniform(-0.3, 0.3)) * amplitude if rng.random() < ASIDE else 0.0
    made: list[Recording] = []
    now, seen = 1.0, dict[str, int]()
    for name, corners, length, (theta, phi), specimen in plan:
        th, ph = np.radians(theta), np.radians(phi)
        direction = (float(np.cos(ph) * np.cos(th)), float(np.cos(ph) * np.sin(th)), float(np.sin(ph)))
        key = f"{name} {theta:.0f} {phi:.0f}"
        seen[key + specimen] = seen.get(key + specimen, 0) + 1
        duration = float(np.ceil(length * 25) / 25)
        ahead = round(float(rng.uniform(0.8, 8.0)), 1) if aside else 0.0
        now = round(now + ahead, 1)
        r = Recording(now, duration, tuple((t, v + aside) for t, v in corners), onset, key, seen[key + specimen],
                      specimen, direction, ahead=ahead)  # fmt: skip
        made.append(_tabled(r, lab))
        now = round(now + duration + float(rng.uniform(1.5, 6.0)), 1)
    return Session("microrobot", tuple(made), lab, *grid(made, 5e-3, 5e-3))


def staircase_slowly(amplitude: float, onset: float) -> tuple[Corners, float]:
    """Steps of a displacement [m] at 2 mm/s, held for two seconds each."""
    corners, now, last = [(0.0, 0.0)], onset, 0.0
    for share in (0.4, 0.8, 1.0, 0.5, 0.0):
        corners += [(now, last), (now + abs(share * amplitude - last) / 2e-3, share * amplitude)]
        now, last = now + 2.5, share * amplitude
    return corners, now + 1.0
