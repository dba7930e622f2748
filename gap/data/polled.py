"""Commands that a controller looks at now and then, told by the ripple of the axes that follow them.

A command that is held until the next look is late by a sawtooth, so that the axis lacks its speed times this sawtooth:
a line at the rate of the looks (or at its alias) that grows with the speed, turns with it and is not there at rest. A
pump's line knows nothing of the speed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import gamma

from acquire.recording.model import Recording
from gap.data.command import command
from gap.data.lines import Spectra, differences, rate_of, without_the_loudest
from sim_devices.chain import FloatArray

SLOWEST, QUICKEST = 2.0, 0.49
"""Hz, and of the sampling rate: where a line is looked for."""
WIDTH = 1.5
"""Hz within which noise times speed has an even spectrum."""
NEAR = 1.0
"""Hz about a line within which its parts lie."""
SHARE = 0.5
"""Of what a line that is always there explains, one that goes with the speed must: that of a pump keeps a fifth."""
CHANCE = 1e-9
"""Chance that noise alone has such a line."""
SMOOTH = 0.1
"""s over which a speed is taken."""
ANSWER = 1.0
"""s behind a step of the command in which nothing is looked for: a staircase's answers, as often as its steps, leave a
line, too."""
LEAST = 128
"""Samples of a recording that is asked."""
THINNED = (1, 2, 4, 8)
"""Samples that are averaged to one: of the ripple of rare looks, the noise of quick samples leaves no line. But kinks
of a command that come at equal intervals may then leave one, so that only a fit can tell."""
TURNS, PARTS = 1.5, 10
"""Lines of a recording's own width by which a frequency is refined, and parts of the session's width it is refined to.
"""


@dataclass(frozen=True)
class Ripple:
    """A ripple that goes with the speed: its ``frequency``, Hz, its ``power`` over the usual one, and of each path the
    time (n,) s, the ripple (n,) and its envelope (n,)."""

    frequency: float
    power: float
    paths: tuple[tuple[FloatArray, FloatArray, FloatArray], ...]

    @property
    def intervals(self) -> tuple[float, ...]:
        """s between looks, by one clock that all paths share and by clocks that begin with each path."""
        own = [time - time[0] for time, _, _ in self.paths]
        return tuple(dict.fromkeys(self._interval(times) for times in ([time for time, _, _ in self.paths], own)))

    def _interval(self, times: Sequence[FloatArray]) -> float:
        longest = max(float(np.ptp(time)) for time in times)
        span = max(float(time[-1]) for time in times) - min(float(time[0]) for time in times)
        near = self.frequency + np.arange(-TURNS / longest, TURNS / longest, 1.0 / (PARTS * span))
        time = np.concatenate(times)
        waves = np.concatenate([ripple * envelope for _, ripple, envelope in self.paths])
        power = [abs(np.sum(waves * np.exp(-2j * np.pi * f * time))) for f in near]
        return 1.0 / float(near[int(np.argmax(power))])


def looks_at_commands(recordings: Sequence[Recording], names: Sequence[str]) -> float | None:
    """Frequency, Hz, of the ripple that follows the speed in the channels ``names``, in all recordings together; None
    where there is none."""
    series = [(r, r.streams[n]) for r in recordings for n in names if n in r.streams]
    paths = [(np.asarray(s.time, dtype=float), np.asarray(s.value, dtype=float)) for _, s in series]
    found = _ripple(paths, [_steps(r) for r, _ in series])
    return found.frequency if found else None


def _steps(recording: Recording) -> FloatArray:
    """When a recording's commands step, s."""
    tables = recording.setpoints.values()
    commands = [command(np.asarray(t.time, dtype=float), np.asarray(t.value, dtype=float)) for t in tables]
    return np.concatenate([np.zeros(0), *(c.steps for c in commands)])


def _away(time: FloatArray, steps: FloatArray, reach: float) -> FloatArray:
    """1 where ``time`` (n,) s is not within `ANSWER` behind one of ``steps`` (k,) s, nor within ``reach`` s of that,
    from where the speed and the differences know of it, else 0."""
    out = np.ones(len(time))
    for step in steps:
        out[(time > step - reach) & (time < step + ANSWER + reach)] = 0.0
    return out


def ripple_of(paths: Sequence[tuple[FloatArray, FloatArray]]) -> Ripple | None:
    """The clearest line that follows the speed of paths, time and value (n,) each, in all of them together, also of
    rare looks; None where there is none."""
    found = [_ripple([_thinned(*path, size) for path in paths]) for size in THINNED]
    return max(filter(None, found), key=lambda ripple: ripple.power, default=None)


def _thinned(time: FloatArray, value: FloatArray, size: int) -> tuple[FloatArray, FloatArray]:
    count = len(value) // size
    shape, kept = (count, size), count * size
    return time[:kept].reshape(shape).mean(axis=1), value[:kept].reshape(shape).mean(axis=1)


def _ripple(paths: Sequence[tuple[FloatArray, FloatArray]], steps: Sequence[FloatArray] | None = None) -> Ripple | None:
    """The line that follows the speed of paths, the answers to their ``steps`` (k,) s left out."""
    stepped = zip(paths, steps or [np.zeros(0)] * len(paths), strict=True)
    asked = [(*path, own) for path, own in stepped if len(path[1]) >= LEAST and np.all(np.isfinite(path[1]))]
    rate = rate_of([time for time, _, _ in asked]) if asked else 0.0
    moving = _moving(asked, max(int(SMOOTH * rate), 2)) if rate else []
    if len(moving) < 2:
        return None
    found = _line_with_speed([path[1:] for path in moving], Spectra(rate, max(len(value) for _, value, _ in asked)))
    if found is None:
        return None
    known = tuple((time, ripple, np.hanning(len(ripple)) * speed) for time, ripple, speed in moving)
    return Ripple(*found, known)


def _moving(
    paths: Sequence[tuple[FloatArray, FloatArray, FloatArray]], half: int
) -> list[tuple[FloatArray, FloatArray, FloatArray]]:
    """Time, ripple and speed (over ``half`` samples either way) of those paths, time, value and steps each, that have
    both away from their steps."""
    out = []
    for time, value, steps in paths:
        away = _away(time[2:-2], steps, (half + 2) * float(np.median(np.diff(time))))
        ripple, speed = differences(value) * away, _speed(value, half) * away
        if ripple.any() and speed.any():
            out.append((time[2:-2], ripple, speed))
    return out


def _line_with_speed(moving: Sequence[tuple[FloatArray, FloatArray]], spectra: Spectra) -> tuple[float, float] | None:
    """Frequency, Hz, of a line that goes with the speed of paths, ripple and speed (n,) each, and its power over the
    usual one."""
    with_speed = [_explained(spectra, ripple, speed) for ripple, speed in moving]
    always = np.sum([_explained(spectra, ripple, np.ones(len(ripple))) for ripple, _ in moving], axis=0)
    together, counted = without_the_loudest([spectra.above(power, WIDTH) for power in with_speed])
    among = (spectra.frequency > SLOWEST) & (spectra.frequency < QUICKEST * spectra.rate)
    k = int(np.argmax(np.where(among, together, 0.0)))
    likely = gamma.sf(together[k], counted) * np.count_nonzero(among) < CHANCE
    # A line that is always there has its power apart where it is multiplied by a speed that turns.
    near = np.abs(spectra.frequency - spectra.frequency[k]) < NEAR
    turns = float(np.sum(with_speed, axis=0)[k]) > SHARE * float(np.max(always[near]))
    return (float(spectra.frequency[k]), float(together[k])) if likely and turns else None


def _speed(value: FloatArray, half: int) -> FloatArray:
    """Speed (n - 4,) of a path (n,) where its fourth differences are, over its rms."""
    speed = np.zeros(len(value))
    speed[half:-half] = value[2 * half :] - value[: -2 * half]
    speed = speed[2:-2]
    return np.asarray(speed / (float(np.sqrt(np.mean(np.square(speed)))) or 1.0))


def _explained(spectra: Spectra, ripple: FloatArray, times: FloatArray) -> FloatArray:
    """By frequency (k,), what a wave times ``times`` (n,) explains of a ripple (n,)."""
    window = np.hanning(len(ripple)) * times
    return spectra.power(ripple * window) / float(np.sum(np.square(window)))
