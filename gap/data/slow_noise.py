"""Noise that means over a bin keep: a sensor's noise is white only in part.

A share that forgets within some tenths of a second to seconds is as good as the same for all samples of a bin, so that
the bin's mean is off by all of it. It is read from third differences of means of neighbouring blocks, which any signal
that is smooth over four blocks leaves alone: away from kinks of the command, in rests and late in holds, and in ramps
where there are few of these: ripple that is there in motion alone (of a set-point that is polled) is no sensor's noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sim_devices.chain import FloatArray

LENGTHS, QUICK = (0.1, 0.2, 0.4, 0.8, 1.6), (0.0125, 0.025, 0.05)
"""s of a block, and of one that shows noise which forgets within few samples."""
AGE = 3.0
"""Lengths of a block after a kink before blocks count: relaxation is then smooth enough."""
STILL, CHANCE = 0.02, 6.0
"""Share of a channel's range, and standard deviations of a block's mean, by which neighbouring four blocks of a rest or
late in a hold differ at most;"""
FEWEST = 12
"""Third differences at least, of which there is a variance to tell."""
WHITE = 20.0
"""Variance of a third difference of white noise of variance 1."""
GROWS, DOUBLES = 2.5, 1.5
"""Growth of the part that is not white, from one length of block to its double, above which it is the signal's own
curve: noise that forgets grows by 2 at most. Above the lesser one it may be either, and the next length has to tell."""
CURVED = 64.0
"""The same growth of a signal that is curved."""
KEPT = 3.2
"""Variance of noise with an exponential autocorrelation, over the largest that third differences show of it at any
length of block (at 1.5 times its correlation time; at a length of a third of that it is twice as much)."""
SPREAD = 2.0
"""Relative error of the variance that the median of n differences tells, times the root of n: so much is not counted,
as the largest over some lengths is meant to be noise and not chance."""

ALIKE, ORDINARY = 2.0, 0.25
"""Times the slow noise of the middle one of channels that are alike, or share of its own white noise, up to which one's
slow noise is believed: a single channel has an error of half of it."""


Runs = Sequence[tuple[FloatArray, FloatArray]]
"""Time (n,) s and value (n,) of a channel, sampled evenly, in each recording."""


class Colour(NamedTuple):
    """By which ``factors`` (k,) the variance of a mean over so many samples, ``sizes`` (k,), is above white noise's:
    noise that forgets within a few samples averages, but more slowly."""

    sizes: tuple[float, ...] = (1.0,)
    factors: tuple[float, ...] = (1.0,)

    def of_mean(self, counts: FloatArray) -> FloatArray:
        """The factor (n,) of means over ``counts`` (n,) samples."""
        return np.asarray(np.interp(np.log(counts), np.log(self.sizes), self.factors))


WHITE_NOISE = Colour()


def colour(runs: Runs, kinks: FloatArray, white: float) -> Colour:
    """How much less than white noise of ``white`` the noise of ``runs`` averages, in rests and late in holds; the
    command has ``kinks`` (k,) s."""
    moves = _moves(runs)
    sizes, factors, most = [1.0], [1.0], np.inf
    for length in QUICK:
        blocks = [_third(time, value, kinks, length) for time, value in runs]
        still = [b.still(moves, white) for b in blocks]
        count = sum(map(len, still))
        if count < FEWEST:
            continue
        size = float(np.average([b.size for b in blocks], weights=[len(d) for d in still]))
        variance, averaged = _typical(still) / WHITE, white**2 / size
        excess = variance - averaged
        if excess > GROWS * max(most, averaged):  # the signal's own curve
            break
        chance = variance * SPREAD / np.sqrt(count)
        most = excess + chance
        sizes.append(size)
        factors.append(max(1.0 + (excess - chance) / averaged, 1.0))
    return Colour(tuple(sizes), tuple(factors))


def slow_variance(runs: Runs, kinks: FloatArray, white: float, quick: Colour = WHITE_NOISE) -> float:
    """Variance of the noise that averaging over a bin keeps, in ``runs`` whose command has ``kinks`` (k,) s; ``white``
    is the standard deviation of a sample's white noise, which averages as ``quick`` has it. 0 where none shows."""
    moves = _moves(runs)
    at_rest: bool | None = None
    found: list[float] = []
    most, unsure = np.inf, False
    for length in LENGTHS:
        blocks = [_third(time, value, kinks, length) for time, value in runs]
        still = [b.still(moves, white) for b in blocks]
        at_rest = sum(map(len, still)) >= FEWEST if at_rest is None else at_rest
        differences = still if at_rest else [b.difference for b in blocks]
        count = sum(map(len, differences))
        if count < FEWEST:
            break
        sizes = np.average([b.size for b in blocks], weights=[len(d) for d in differences])
        averaged = white**2 / float(sizes) * float(quick.of_mean(np.array(sizes)))
        variance = _typical(differences) / WHITE
        excess = variance - averaged
        if excess > GROWS * max(most, averaged):
            found[-1] -= excess / CURVED
            unsure = False
            break
        unsure = excess > DOUBLES * max(most, averaged)
        chance = variance * SPREAD / np.sqrt(count)
        found.append(excess - chance)
        most = excess + chance
    if unsure:
        found.pop()
    return KEPT * max([0.0, *found])


def no_jerks(noise: Sequence[tuple[float, float]]) -> Sequence[float]:
    """The slow noise of channels that are alike, by the white and slow noise (white, slow) that each seems to have.

    An axis that sticks and slips seems to have slow noise; the others, by the same kind of sensor, tell.
    """
    if len(noise) < 3:
        return [slow for _, slow in noise]
    middle = float(np.median([slow for _, slow in noise]))
    return [min(slow, max(ALIKE * middle, ORDINARY * white)) for white, slow in noise]


def _moves(runs: Runs) -> float:
    """By how much neighbouring blocks of a channel's ``runs`` differ at rest."""
    values = np.concatenate([v[np.isfinite(v)] for _, v in runs] or [np.zeros(0)])
    return STILL * float(np.ptp(values)) if len(values) else 0.0


def _typical(runs: Sequence[FloatArray]) -> float:
    """Mean square of differences, runs of (n,): the median by run, as few differences may still hold a signal's curve,
    and of these the median by difference, as one run may be all curve (a slow sine). 0.455 is the median of a squared
    normal."""
    known = sorted((float(np.median(np.square(d))), len(d)) for d in runs if len(d))
    reached = np.cumsum([n for _, n in known])
    return known[int(np.searchsorted(reached, 0.5 * reached[-1]))][0] / 0.455


class _Blocks(NamedTuple):
    """Third differences (n,) of means over blocks of ``size`` samples, and by how much the outer two of each differ."""

    difference: FloatArray
    moved: FloatArray
    size: int

    def still(self, moves: float, white: float) -> FloatArray:
        """Those of neighbours that differ by no more than ``moves``, or than noise of ``white`` lets them."""
        return np.asarray(self.difference[self.moved <= max(moves, CHANCE * white / np.sqrt(self.size))])


def _third(time: FloatArray, value: FloatArray, kinks: FloatArray, length: float) -> _Blocks:
    """Of blocks of ``length`` s, none of which lies within `AGE` lengths after a kink."""
    nothing = _Blocks(np.zeros(0), np.zeros(0), 1)
    good = np.isfinite(value)
    time, value = time[good], value[good]
    if len(time) < 8:
        return nothing
    size = round(length / max(float(np.median(np.diff(time))), 1e-9))
    count = len(time) // size if size >= 4 else 0
    if count < 4:
        return nothing
    means = value[: count * size].reshape(count, size).mean(axis=1)
    begin, end = time[: count * size : size], time[size - 1 : count * size : size]
    first, last = begin[:-3], end[3:]
    known = np.concatenate([[-np.inf], kinks])
    since = first - known[np.searchsorted(known, last, side="right") - 1]
    aged = since > AGE * length
    return _Blocks(np.diff(means, 3)[aged], np.abs(means[3:] - means[:-3])[aged], size)
