"""A person's pulse or breath in a record: a hump in the spectrum of what is left where the command rests.

A heart's rate wanders by a tenth within a minute, a breath's by more, so that no sine of one frequency and phase fits a
session; the power about its rate is there all the same. It is compared with that beside it, which noise of any colour
has as well.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray
from scipy.stats import f as f_ratio

from acquire.recording.model import Recording
from gap.data.command import command
from gap.data.quantities import significant
from gap.data.signatures import Signature
from sim_devices.chain import FloatArray
from sim_devices.stages.sampling import JUMP

CHANNELS = ("apex_height", "transducer_force_a", "transducer_force_b", "transducer_force_c")
MOVERS = ("pressure", "axis_position_1", "axis_position_2", "axis_position_3")
"""Channels that move skin: a rhythm that they have as well is an instrument's."""


@dataclass(frozen=True)
class Rhythm:
    """A rhythm of a person: its ``rates`` Hz, by how much it wanders (Hz), the bands (of a rate) that tell the noise
    beside it, how many times above these the bend of a coloured spectrum is by itself; and the stretches that count:
    from ``after`` s behind a kink of the command on, of a least and greatest length (s), less their part that is slower
    than ``slow`` Hz (2 slow polynomials in each second)."""

    name: str
    rates: FloatArray
    wanders: float
    beside: tuple[tuple[float, float], ...]
    bend: float
    after: float
    shortest: float
    longest: float
    slow: float


PULSE = Rhythm(
    "a pulse", np.arange(0.8, 2.2, 0.05), wanders=0.1, beside=((0.6, 0.8), (1.4, 1.9)), bend=1.15,
    after=1.0, shortest=4.0, longest=20.0, slow=0.25,
)  # fmt: skip
BREATH = Rhythm(
    "breath", np.arange(0.16, 0.44, 0.02), wanders=0.04, beside=((2.6, 3.6),), bend=12.0,
    after=4.0, shortest=12.0, longest=60.0, slow=0.06,
)  # fmt: skip
"""Twice the rate, a pulse's own overtone, is left out. Below a breath is what a stretch's own curve takes away,
and of a few breaths the power reaches far: noise is told well above, where a colour of 1/f² has a ninth of it."""
STILL = 1e-3
"""Of a command's range: change from which on it moves, and what answers it is no noise."""
CHANCE = 1e-5
"""Chance, rates tried included, below which a hump is a pulse: two of 165 development sessions had one, by 1e-8 and
less, and no other by .03."""
NATS = 8.0
"""Of evidence for a pulse: as much as a mark may add, so that an effect that explains more still leads."""


def pulse(recordings: Sequence[Recording]) -> list[Signature]:
    """The marks of a pulse, or of breath, in the channels that a person's skin moves, of recordings on skin."""
    return [mark for rhythm in (PULSE, BREATH) for mark in _marks(recordings, rhythm)]


def _marks(recordings: Sequence[Recording], rhythm: Rhythm) -> Iterator[Signature]:
    """The marks of one rhythm."""
    own = [r for r in recordings if r.info.specimen in ("", "skin")]
    rates = [found[0] for mover in MOVERS if (found := _hump(_pieces(own, mover, rhythm), rhythm)) is not None]
    for channel in CHANNELS:
        if (found := _hump(_pieces(own, channel, rhythm), rhythm)) is None:
            continue
        rate, ratio = found
        if any(abs(rate - other) <= rhythm.wanders for other in rates):
            continue
        text = f"{channel} has {significant(ratio)} times the noise's power about {rate:.2f} Hz, as from {rhythm.name}"
        yield Signature("pulse_breathing", channel, NATS, text, noise=float(np.sqrt(ratio)), alone=False)


def _pieces(recordings: Sequence[Recording], channel: str, rhythm: Rhythm) -> list[tuple[FloatArray, FloatArray]]:
    return [piece for r in recordings for piece in _stretches(r, channel, rhythm)]


def _stretches(recording: Recording, channel: str, rhythm: Rhythm) -> Iterator[tuple[FloatArray, FloatArray]]:
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
        whole = end - begin - rhythm.after
        inside = [np.interp([begin + JUMP, end - JUMP], c.time, c.value) for c in commands]
        moves = any(abs(x[1] - x[0]) > STILL * np.ptp(c.value) for x, c in zip(inside, commands, strict=True))
        if whole < rhythm.shortest or moves:
            continue
        cuts = np.linspace(begin + rhythm.after, end, int(np.ceil(whole / rhythm.longest)) + 1)
        for first, last in pairwise(cuts):
            t, v = time[(time > first) & (time < last)], value[(time > first) & (time < last)]
            if len(t) > 8 * (last - first) and last - first >= rhythm.shortest:
                x = 2.0 * (t - first) / (last - first) - 1.0
                basis = legendre.legvander(x, int(np.ceil(2.0 * rhythm.slow * (last - first))) + 2)
                yield t, v - basis @ np.linalg.lstsq(basis, v, rcond=None)[0]


def _hump(pieces: Sequence[tuple[FloatArray, FloatArray]], rhythm: Rhythm) -> tuple[float, float] | None:
    """The rate, Hz, about which pieces of a record have most power above that of the bands beside it, and how many
    times; None where chance does as much."""
    seconds = sum(float(np.ptp(t)) for t, _ in pieces)
    if seconds < 2.0 * rhythm.shortest:
        return None
    step = 0.5 * rhythm.wanders
    lowest, highest = min(1.0, rhythm.beside[0][0]) * rhythm.rates[0], rhythm.beside[-1][1] * rhythm.rates[-1]
    frequency = np.arange(lowest - rhythm.wanders, highest + step, step)
    power = np.zeros(len(frequency))
    for t, v in pieces:
        turns = np.exp(-2j * np.pi * np.outer(frequency, t - t[0]))
        power += np.abs(turns @ (v * np.hanning(len(v)))) ** 2 / len(v)
    best = (1.0, -1.0, 0.0)
    for rate in rhythm.rates:
        here = np.abs(frequency - rate) <= rhythm.wanders + 1e-9
        sides = [(frequency >= low * rate) & (frequency <= high * rate) for low, high in rhythm.beside]
        level = float(np.exp(np.mean([np.log(max(power[side].mean(), 1e-300)) for side in sides])))
        ratio = float(power[here].mean()) / (rhythm.bend * level)
        free = _free(seconds, frequency, here)
        # The variance of a logarithm's mean is that of its parts over the square of their number.
        other = len(sides) ** 2 / sum(1.0 / _free(seconds, frequency, side) for side in sides)
        best = min(best, (float(f_ratio.sf(ratio, free, other)) * len(rhythm.rates), -ratio, float(rate)))
    chance, less, rate = best
    return (rate, -less) if chance < CHANCE else None


def _free(seconds: float, frequency: FloatArray, part: NDArray[np.bool_]) -> float:
    """Degrees of freedom of the power in a part of a spectrum, two for each independent frequency of a Hann window."""
    return max(2.0 * seconds * float(np.ptp(frequency[part])) / 1.5, 2.0)
