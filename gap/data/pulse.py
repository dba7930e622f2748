"""A person's pulse in a record: a hump in the spectrum of what is left where the command rests.

A heart's rate wanders by a tenth within a minute, so that no sine of one frequency and phase fits a session; the power
about its rate is there all the same. It is compared with that below and above, which noise of any colour has as well.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray
from scipy.stats import f as f_ratio

from acquire.recording.model import Recording
from gap.data.command import command
from gap.data.signatures import Signature
from sim_devices.chain import FloatArray
from sim_devices.stages.sampling import JUMP

CHANNELS = ("apex_height", "transducer_force_a", "transducer_force_b", "transducer_force_c")
RATES = np.arange(0.8, 2.2, 0.05)
"""Hz: where a pulse may be."""
HALF_WIDTH = 0.1
"""Hz about a rate within which it wanders."""
BELOW, ABOVE = (0.6, 0.8), (1.4, 1.9)
"""Of the rate: the bands that tell the noise there. Twice the rate, a pulse's own overtone, is left out."""
AFTER_KINK, SHORTEST, LONGEST = 1.0, 4.0, 10.0
"""s after a kink of the command from which on stretches count, and their least and greatest length."""
STILL = 1e-3
"""Of a command's range: change from which on it moves, and what answers it is no noise."""
SLOW = 0.25
"""Hz: the slower part of a stretch is its own curve (2 SLOW polynomials in each second)."""
CURVED = 1.15
"""Ratio that the bend of a coloured spectrum makes by itself."""
CHANCE = 1e-5
"""Chance, rates tried included, below which a hump is a pulse: two of 165 development sessions had one, by 1e-8 and
less, and no other by .03."""
NATS = 8.0
"""Of evidence for a pulse: as much as a mark may add, so that an effect that explains more still leads."""


def pulse(recordings: Sequence[Recording]) -> list[Signature]:
    """The marks of a pulse in the channels that a person's skin moves, of recordings on skin."""
    out = []
    for channel in CHANNELS:
        pieces = [p for r in recordings if r.info.specimen in ("", "skin") for p in _stretches(r, channel)]
        if (found := _hump(pieces)) is not None:
            rate, ratio = found
            text = f"{channel} has {ratio:.1f} times the noise's power about {rate:.2f} Hz, as from a pulse"
            out.append(Signature("pulse_breathing", channel, NATS, text, noise=float(np.sqrt(ratio)), alone=False))
    return out


def _stretches(recording: Recording, channel: str) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Times and values (n,) of a channel while the command rests, less their own slow curve."""
    series = recording.streams.get(channel)
    if series is None or not recording.setpoints:
        return
    time, value = np.asarray(series.time, dtype=float), np.asarray(series.value, dtype=float)
    good = np.isfinite(value)
    time, value = time[good], value[good]
    commands = [command(np.asarray(s.time, float), np.asarray(s.value, float)) for s in recording.setpoints.values()]
    edges = np.unique(np.concatenate([*(c.time for c in commands), time[:1], time[-1:]]))
    for begin, end in pairwise(edges):
        whole = end - begin - AFTER_KINK
        inside = [np.interp([begin + JUMP, end - JUMP], c.time, c.value) for c in commands]
        moves = any(abs(x[1] - x[0]) > STILL * np.ptp(c.value) for x, c in zip(inside, commands, strict=True))
        if whole < SHORTEST or moves:
            continue
        cuts = np.linspace(begin + AFTER_KINK, end, int(np.ceil(whole / LONGEST)) + 1)
        for first, last in pairwise(cuts):
            t, v = time[(time > first) & (time < last)], value[(time > first) & (time < last)]
            if len(t) > 8 * (last - first) and last - first >= SHORTEST:
                x = 2.0 * (t - first) / (last - first) - 1.0
                basis = legendre.legvander(x, int(np.ceil(2.0 * SLOW * (last - first))) + 2)
                yield t, v - basis @ np.linalg.lstsq(basis, v, rcond=None)[0]


def _hump(pieces: Sequence[tuple[FloatArray, FloatArray]]) -> tuple[float, float] | None:
    """The rate, Hz, about which pieces of a record have most power above that of the bands beside it, and how many
    times; None where chance does as much."""
    seconds = sum(float(np.ptp(t)) for t, _ in pieces)
    if seconds < 2.0 * SHORTEST:
        return None
    step = 0.5 * HALF_WIDTH
    frequency = np.arange(RATES[0] * BELOW[0], RATES[-1] * ABOVE[1] + step, step)
    power = np.zeros(len(frequency))
    for t, v in pieces:
        turns = np.exp(-2j * np.pi * np.outer(frequency, t - t[0]))
        power += np.abs(turns @ (v * np.hanning(len(v)))) ** 2 / len(v)
    best = (1.0, 0.0, 1.0)
    for rate in RATES:
        here = np.abs(frequency - rate) <= HALF_WIDTH + 1e-9
        sides = [(frequency >= low * rate) & (frequency <= high * rate) for low, high in (BELOW, ABOVE)]
        level = float(np.exp(np.mean([np.log(max(power[side].mean(), 1e-300)) for side in sides])))
        ratio = float(power[here].mean()) / (CURVED * level)
        free = [_free(seconds, frequency, part) for part in (here, *sides)]
        other = 2.0 / (1.0 / free[1] + 1.0 / free[2])
        best = min(best, (float(f_ratio.sf(ratio, free[0], other)) * len(RATES), float(rate), ratio))
    chance, rate, ratio = best
    return (rate, ratio) if chance < CHANCE else None


def _free(seconds: float, frequency: FloatArray, part: NDArray[np.bool_]) -> float:
    """Degrees of freedom of the power in a part of a spectrum, two for each independent frequency of a Hann window."""
    return max(2.0 * seconds * float(np.ptp(frequency[part])) / 1.5, 2.0)
