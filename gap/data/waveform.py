"""The kind of waveform that a recording was commanded: which recordings test an effect on another one."""

from __future__ import annotations

import numpy as np

from acquire.recording.model import Recording
from sim_devices.chain import FloatArray

NODES = 4000
"""Places at which commands are looked at."""
WINDOWS = 400
"""Parts of a recording over which a speed is taken: set-points may come in short pieces."""
MOVES = 0.02
"""Share of the greatest speed above which a command moves."""
QUICK = 2.0
"""Ranges a second from which a change of the command is a step."""
RAMPING = 0.15
"""Share of the time that a ramp moves, at least."""
STRAIGHT = 0.8
"""Share of the moving time that a command of straight legs spends at one of its few speeds, at least."""
LEGS, ALIKE = 3, 1.1
"""How many speeds such a command has, at most, and how far apart two are that count as one."""
ONE_LINE = 0.2
"""Share of a curve's variance that one sine leaves, at most, if it is one."""
PLANE = 0.05
"""Variance in a second direction, of that in the first, from which a command is a path in the plane or in space."""
LINES = 318
"""Sines that are tried: from half a cycle in a recording, each with a quarter more."""
LEVELS = 0.08
"""Share of its range by which two levels of a staircase differ, at least."""


def waveform(recording: Recording) -> str:
    """``step``, ``staircase``, ``ramp``, ``sine``, ``multisine`` or ``path`` of what was commanded, with ``, cyclic``
    behind steps and ramps that come again; "-" where nothing was."""
    command = _command(recording)
    if command is None:
        return "-"
    duration, excursions = command
    centred = excursions - excursions.mean(axis=0)
    _, size, directions = np.linalg.svd(centred, full_matrices=False)
    if len(size) > 1 and size[1] ** 2 > PLANE * size[0] ** 2:
        return "path"
    along = excursions @ directions[0]
    along = along / float(np.ptp(along))
    speed = np.abs(np.diff(along)) * (len(along) - 1) / duration
    if float(np.mean((speed > 1e-3) & (speed < QUICK))) <= RAMPING:
        return _again("staircase" if _levels(along) > 2 else "step", along)
    if _curved(along):
        return "sine" if _beside_one_line(along) < ONE_LINE else "multisine"
    return _again("ramp", along)


def _command(recording: Recording) -> tuple[float, FloatArray] | None:
    """Duration (s) and the set-points that move, (nodes, quantities); None without one."""
    moving = [s for s in recording.setpoints.values() if len(s.value) > 1 and np.ptp(np.asarray(s.value, float)) > 0]
    if not moving:
        return None
    begin, end = min(float(s.time[0]) for s in moving), max(float(s.time[-1]) for s in moving)
    grid = np.linspace(begin, end, NODES)
    return end - begin, np.column_stack([np.interp(grid, s.time, np.asarray(s.value, float)) for s in moving])


def _again(kind: str, along: FloatArray) -> str:
    """``kind``, and whether the command comes up more than once from where it began."""
    away = np.abs(along - along[0])
    up = away > 0.5 * float(np.max(away))
    return f"{kind}, cyclic" if int(np.sum(np.diff(up.astype(int)) > 0)) + int(up[0]) > 1 else kind


def _levels(along: FloatArray) -> int:
    """How many levels a command of steps rests at."""
    rests = np.sort(along[:-1][np.abs(np.diff(along)) < 1e-6])
    return 1 + int(np.sum(np.diff(rests) > LEVELS)) if len(rests) else 0


def _curved(along: FloatArray) -> bool:
    """Whether a command's speed takes on all values, not those of a few straight legs only."""
    parts = np.interp(np.linspace(0, len(along) - 1, WINDOWS + 1), np.arange(len(along)), along)
    speed = np.abs(np.diff(parts))
    speed = np.sort(speed[speed > MOVES * float(np.max(speed))])
    moving, straight = len(speed), 0
    for _ in range(LEGS):
        if len(speed):
            ends = np.searchsorted(speed, ALIKE * speed, side="right")
            many = ends - np.arange(len(speed))
            k = int(np.argmax(many))
            straight += int(many[k])
            speed = np.delete(speed, slice(k, int(ends[k])))
    return straight < STRAIGHT * moving


def _beside_one_line(along: FloatArray) -> float:
    """Share of a command's variance that the best single sine, beside an offset, leaves where it moves."""
    moving = np.flatnonzero(np.abs(np.diff(along)) > 1e-6)
    v = along[moving[0] : moving[-1] + 1]
    v = v - v.mean()
    square, left = float(v @ v), [1.0]
    quarter = np.exp(0.5j * np.pi * np.linspace(0.0, 1.0, len(v)))
    wave = quarter**2
    for _ in range(LINES):
        total, twice, along_it = wave.sum(), complex(wave @ wave), complex(wave @ v)
        cosines, sines, cross = 0.5 * (len(v) + twice.real), 0.5 * (len(v) - twice.real), 0.5 * twice.imag
        normal = [[len(v), total.imag, total.real], [total.imag, sines, cross], [total.real, cross, cosines]]
        seen = np.array([0.0, along_it.imag, along_it.real])
        left.append((square - float(seen @ np.linalg.solve(normal, seen))) / max(square, 1e-300))
        wave *= quarter
    return min(left)
