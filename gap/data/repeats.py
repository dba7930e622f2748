"""Values that come again: how often, and how often they should by chance."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from acquire.recording.model import Recording, Series
from gap.data.noise import finest_step, high_band_sigma
from sim_devices.chain import FloatArray

COUNTED = 400
"""Small changes from whose number that of no change is foretold."""
COARSE = 1.5
"""Noise, in steps of its grid, below which a channel's stillness is no news."""
TOGETHER = 3
"""Channels at least that must stand at once to say something together."""
ABOUT = 51
"""Samples within which a channel stands as often as about one of them."""
JUMPS = 6.0
"""σ of its noise by which a channel jumps that stood still while its signal went on."""
OLD = 32
"""Samples by which one that was delivered late may be old."""
UNALIKE = 1e-3
"""Least chance with which one channel of another sample's value is told: files are written to some digits."""
SELDOM = 0.2
"""Share of the samples above which those that come again are how an instrument is asked, and no fault."""


def repeated_values(series: Sequence[Series]) -> tuple[int, float, int]:
    """How often a channel repeats its last value, how often it should, and of how many samples that can be told."""
    repeated, expected, counted = 0, 0.0, 0
    for s in series:
        v = s.value[np.isfinite(s.value)]
        if len(v) < 30 or np.ptp(v) == 0:
            continue
        step = finest_step(v)
        if step == 0 and len(np.unique(v)) < 0.97 * (1 + np.count_nonzero(np.diff(v))):
            continue  # values come back, not only stand: computed from coarse channels, its repeats are theirs
        if _coarse(v, step):
            continue
        change = np.diff(v)
        inside = (v[1:] > v.min()) & (v[1:] < v.max())  # values at an extreme are clipped, not repeated
        repeated += int(np.sum((change == 0) & inside))
        expected += repeats_foretold(change[inside], step)
        counted += len(v)
    return repeated, expected, counted


def _coarse(v: FloatArray, step: float) -> bool:
    """Whether a channel (n,) lies on so coarse a grid of ``step`` that stillness is no news: in the middle between two
    marks it stands for long, and goes on with the next step of its command."""
    return bool(step) and high_band_sigma(v) < COARSE * step


def repeats_foretold(change: FloatArray, step: float) -> float:
    """How many of the changes (n,) of a channel on a grid of ``step`` should be nought, by how many are small.

    The density of changes of noise is flat about nought: so many as there are within the least change that occurs
    often enough, shared among the steps that it spans.
    """
    if step <= 0 or not len(change):
        return 0.0
    counts = np.sort(np.abs(np.round(change[change != 0] / step)))
    if not len(counts):
        return 0.0
    reach = counts[min(COUNTED, len(counts) - 1, max(len(counts) // 4, 1))]
    share: float = float(np.searchsorted(counts, reach, side="right")) / (2.0 * max(reach, 1.0))
    return share


def repeats_surprise(repeated: int, expected: float) -> float:
    """Nats against so many repeats by chance (the Poisson likelihood ratio; one is always possible)."""
    foretold = max(expected, 1.0)
    if repeated <= foretold:
        return 0.0
    return float(repeated * np.log(repeated / foretold) - (repeated - foretold))


def stale_rows(recordings: Sequence[Recording], names: Sequence[str]) -> tuple[int, float]:
    """Of how many samples all channels ``names`` repeat the values of the one before, and of how many they would if
    each did by itself, as often as it does nearby. None of channels that are not sampled together."""
    rows, expected, counted = 0, 0.0, 0
    for recording in recordings:
        series = [recording.streams[n].value for n in names if n in recording.streams]
        if len(series) < TOGETHER or len({len(v) for v in series}) > 1 or len(series[0]) <= ABOUT:
            continue
        still = np.array([np.diff(v) == 0 for v in series])
        nearby = [np.convolve(one, np.full(ABOUT, 1.0 / ABOUT), "same") for one in still]
        rows += int(np.sum(np.all(still, axis=0)))
        expected += float(np.sum(np.prod(nearby, axis=0)))
        counted += still.shape[1]
    return (rows, expected) if rows <= SELDOM * counted else (0, 0.0)


def held_values(series: Sequence[Series]) -> tuple[int, float]:
    """How often a channel holds a value for longer than its noise would let it, and jumps to another one then; and the
    nats of that against chance, which had every sample to begin at."""
    runs, nats = 0, 0.0
    for s in series:
        v = s.value[np.isfinite(s.value)]
        if len(v) <= 2 * ABOUT or _coarse(v, finest_step(v)):
            continue
        change = np.diff(v)
        moves = np.abs(change[change != 0])
        jump = JUMPS * max(high_band_sigma(v), 0.5 * float(np.median(moves))) if len(moves) else np.inf
        still = (change == 0) & (v[1:] > v.min()) & (v[1:] < v.max())
        for begin, end in runs_of(still):
            unlikely = _unlikely(still[None], begin, end) - np.log(len(v))
            if unlikely > 0 and end < len(change) and abs(change[end]) > jump:
                runs, nats = runs + 1, nats + unlikely
    return runs, nats


def copied_rows(recordings: Sequence[Recording], names: Sequence[str]) -> tuple[int, float]:
    """How many samples are copies of older ones in all channels ``names`` together, and the nats of that against
    chance.

    A sample that was delivered late carries the noise of the instant it was taken at, so that a run of them repeats an
    earlier run to the last digit. Chance makes a run with the product of the shares in which each channel comes again
    after so many samples nearby; it had every sample and every age to begin at.
    """
    copies, nats = 0, 0.0
    for recording in recordings:
        values = [recording.streams[n].value for n in names if n in recording.streams]
        if len(values) < 2 or len({len(v) for v in values}) > 1 or len(values[0]) <= 2 * ABOUT:
            continue
        tries = np.log(OLD * len(values[0]))
        taken = np.zeros(len(values[0]), dtype=bool)
        for age in range(2, OLD + 1):
            again = np.array([v[age:] == v[:-age] for v in values])
            moved = np.any([v[age:] != v[age - 1 : -1] for v in values], axis=0)  # else it stands still
            most = -float(np.sum(np.log(np.maximum(np.mean(again, axis=1), UNALIKE))))  # nats of a row
            for begin, end in runs_of(np.all(again, axis=0) & moved):
                if (end - begin) * most <= tries:
                    continue
                unlikely = _unlikely(again, begin, end) - tries
                if unlikely > 0 and not np.any(taken[begin + age : end + age]):
                    taken[begin + age : end + age] = True
                    copies, nats = copies + end - begin, nats + unlikely
    return copies, nats


def _unlikely(again: NDArray[np.bool_], begin: int, end: int) -> float:
    """Nats against a run of coincidences by chance; ``again`` (channels, n) where each comes again."""
    low, high = max(begin - ABOUT, 0), end + ABOUT
    beside = np.concatenate([again[:, low:begin], again[:, end:high]], axis=1)
    nearby = (np.sum(beside, axis=1) + 0.5) / (beside.shape[1] + 1.0)
    chance = np.maximum(np.maximum(nearby, np.mean(again, axis=1)), UNALIKE)
    return float((begin - end) * np.sum(np.log(chance)))


def runs_of(at: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Begin and end of each run of true values among ``at`` (n,)."""
    edges = np.flatnonzero(np.diff(np.r_[False, at, False]))
    return [(int(b), int(e)) for b, e in edges.reshape(-1, 2)]
