"""Commands that a controller looks at now and then, told by the ripple of the axes that follow them.

A command that is held until the next look is late by a sawtooth, so that the axis lacks its speed times this sawtooth:
a line at the rate of the looks (or at its alias) that grows with the speed, turns with it and is not there at rest. A
pump's line knows nothing of the speed.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import median_filter
from scipy.stats import gamma

from acquire.recording.model import Recording
from sim_devices.chain import FloatArray

DIFFERENCE = np.array([1.0, -4.0, 6.0, -4.0, 1.0])
"""Fourth differences: of a smooth path they leave the ripple and the noise."""
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
CLIPPED = 6.0
"""Times its median up to which a difference counts: edges of a path have lines of their own."""


def looks_at_commands(recordings: Sequence[Recording], names: Sequence[str]) -> float | None:
    """Frequency, Hz, of the ripple that follows the speed in the channels ``names``, in all recordings together; None
    where there is none."""
    paths = [
        (np.asarray(s.time, dtype=float), np.asarray(s.value, dtype=float))
        for r in recordings
        for s in (r.streams[n] for n in names if n in r.streams)
        if len(s.value) >= LEAST and np.all(np.isfinite(s.value)) and np.ptp(s.value) > 0
    ]
    if not paths:
        return None
    step = float(np.median([float(t[-1] - t[0]) / (len(t) - 1) for t, _ in paths]))
    if not step > 0.0:
        return None
    rate = 1.0 / step
    size = 2 ** int(np.ceil(np.log2(2 * max(len(v) for _, v in paths))))
    frequency = np.fft.rfftfreq(size, 1.0 / rate)
    among = (frequency > SLOWEST) & (frequency < QUICKEST * rate)
    above = []
    with_speed, without = np.zeros(len(frequency)), np.zeros(len(frequency))
    for _, value in paths:
        ripple, speed = _ripple(value, max(int(SMOOTH * rate), 2))
        if speed.any() and ripple.any():
            moving, always = _power(ripple, speed, size), _power(ripple, np.ones(len(ripple)), size)
            above.append(_above(moving, int(WIDTH * size / rate)))
            with_speed, without = with_speed + moving, without + always
    if len(above) < 2:
        return None
    together = np.sum(above, axis=0) - np.max(above, axis=0)  # the one that speaks for it the most does not count
    together[~among] = 0.0
    k = int(np.argmax(together))
    likely = gamma.sf(together[k], len(above) - 1) * np.count_nonzero(among) < CHANCE
    # A line that is always there has its power apart where it is multiplied by a speed that turns.
    always_there = float(np.max(without[np.abs(frequency - frequency[k]) < NEAR]))
    return float(frequency[k]) if likely and with_speed[k] > SHARE * always_there else None


def _ripple(value: FloatArray, half: int) -> tuple[FloatArray, FloatArray]:
    """Fourth differences of a path (n,), clipped, and its speed where they are, over its rms."""
    change = np.convolve(value, DIFFERENCE, "valid")
    usual = float(np.median(np.abs(change))) or float(np.std(change)) or 1.0
    speed = np.zeros(len(value))
    speed[half:-half] = value[2 * half :] - value[: -2 * half]
    speed = speed[2:-2]
    size = float(np.sqrt(np.mean(np.square(speed)))) or 1.0
    return np.clip(change / usual, -CLIPPED, CLIPPED), speed / size


def _power(ripple: FloatArray, times: FloatArray, size: int) -> FloatArray:
    """By frequency, what a wave times ``times`` (n,) explains of a ripple (n,)."""
    window = np.hanning(len(ripple)) * times
    return np.asarray(np.abs(np.fft.rfft(ripple * window, size)) ** 2 / np.sum(np.square(window)))


def _above(power: FloatArray, width: int) -> FloatArray:
    """Power over the usual one within ``width`` frequencies: exponential where it is noise."""
    usual = median_filter(power, width | 1, mode="reflect")
    return np.asarray(power * np.log(2.0) / np.maximum(usual, 1e-9 * power.max()))
