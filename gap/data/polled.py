"""Commands that a controller looks at now and then, told by the ripple of the axes that follow them.

A command that is held until the next look is late by a sawtooth, so that the axis lacks its speed times this sawtooth:
a line at the rate of the looks (or at its alias) that grows with the speed, turns with it and is not there at rest. A
pump's line knows nothing of the speed.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import gamma

from acquire.recording.model import Recording
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
LEAST = 128
"""Samples of a recording that is asked."""


def looks_at_commands(recordings: Sequence[Recording], names: Sequence[str]) -> float | None:
    """Frequency, Hz, of the ripple that follows the speed in the channels ``names``, in all recordings together; None
    where there is none."""
    series = [r.streams[n] for r in recordings for n in names if n in r.streams]
    series = [s for s in series if len(s.value) >= LEAST and np.all(np.isfinite(s.value))]
    rate = rate_of([s.time for s in series]) if series else 0.0
    if rate == 0.0:
        return None
    every = [(differences(s.value), _speed(s.value, max(int(SMOOTH * rate), 2))) for s in series]
    moving = [(ripple, speed) for ripple, speed in every if ripple.any() and speed.any()]
    if len(moving) < 2:
        return None
    return _line_with_speed(moving, Spectra(rate, max(len(s.value) for s in series)))


def _line_with_speed(moving: Sequence[tuple[FloatArray, FloatArray]], spectra: Spectra) -> float | None:
    """Frequency, Hz, of a line that goes with the speed of paths, ripple and speed (n,) each."""
    with_speed = [_explained(spectra, ripple, speed) for ripple, speed in moving]
    always = np.sum([_explained(spectra, ripple, np.ones(len(ripple))) for ripple, _ in moving], axis=0)
    together, counted = without_the_loudest([spectra.above(power, WIDTH) for power in with_speed])
    among = (spectra.frequency > SLOWEST) & (spectra.frequency < QUICKEST * spectra.rate)
    k = int(np.argmax(np.where(among, together, 0.0)))
    likely = gamma.sf(together[k], counted) * np.count_nonzero(among) < CHANCE
    # A line that is always there has its power apart where it is multiplied by a speed that turns.
    near = np.abs(spectra.frequency - spectra.frequency[k]) < NEAR
    turns = float(np.sum(with_speed, axis=0)[k]) > SHARE * float(np.max(always[near]))
    return float(spectra.frequency[k]) if likely and turns else None


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
