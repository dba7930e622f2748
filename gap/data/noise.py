"""How much of a signal is noise: the floor against which a gap counts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from sim_devices.chain import FloatArray

BLOCKS = (4, 8, 16, 32)
"""Lengths of block, in samples, for which a correlation is looked for."""
FEWEST_BLOCKS = 16
CHANCE = 1.5
"""Standard errors of a variance that are chance's."""
STILL = 40
"""Samples over which a channel on a grid must hardly move for its noise to be read there."""


def high_band_sigma(value: FloatArray) -> float:
    """Standard deviation of a sample's noise from the high band: third differences, robustly.

    Third differences of white noise have variance 20 σ². On a grid it is `dithered_sigma` and the grid's own, step/√12.
    """
    v = value[np.isfinite(value)]
    if len(v) < 8:
        return (float(np.std(v)) if len(v) else 0.0) or 1.0
    scale = float(np.ptp(v)) or max(abs(float(v[0])), 1.0)
    step = grid_step(v)
    if step and (noise := dithered_sigma(v, step)) is not None:
        return max(float(np.hypot(noise, step / np.sqrt(12.0))), 1e-7 * scale)
    differences = np.abs(np.diff(v, 3))
    median = float(np.median(differences))
    if not median and np.any(differences):  # coarse levels, but on no even grid
        changes = np.abs(np.diff(v))
        step = float(np.median(changes[changes > 0]))
    sigma: float = max(median / 0.6745 / np.sqrt(20.0), step / np.sqrt(12.0), 1e-7 * scale)
    return sigma


def dithered_sigma(value: FloatArray, step: float) -> float | None:
    """Standard deviation of the noise that samples (n,) had before they were rounded to a grid of ``step``; None where
    the signal is seldom still.

    Rounding keeps the mean absolute difference of two samples, if every place between two levels is as likely: of
    white noise it is 2 σ/√π. It is taken where the signal hardly moves for `STILL` samples.
    """
    windows = (len(value) - 1) // STILL
    part = value[: windows * STILL].reshape(windows, STILL)
    apart = np.abs(np.diff(part, axis=1)).mean(axis=1)
    # Of white noise so many samples span four times their mean difference, where they rise or fall evenly forty times.
    still = np.ptp(part, axis=1) <= np.maximum(2.0 * step, 6.0 * apart)
    return float(np.sqrt(np.pi) / 2.0 * np.mean(apart[still])) if np.sum(still) > 3 else None


def rounding_floor(sigma: float, step: float) -> float:
    """The part that averaging does not lower of the error that a grid of ``step`` makes, rms, for samples of noise
    ``sigma`` (rounding included).

    Noise dithers: the mean of rounded samples is off by at most (step/π) exp(−2π² r²), r = noise/step, the first
    term of the rounding error's Fourier series (Widrow and Kollár, "Quantization Noise", ch. 5).
    """
    if step <= 0:
        return 0.0
    r2 = max(sigma**2 / step**2 - 1.0 / 12.0, 0.0)
    return float(step / (np.pi * np.sqrt(2.0)) * np.exp(-2.0 * np.pi**2 * r2))


def grid_step(value: FloatArray) -> float:
    """The step of the grid that values lie on, 0.0 when they lie on none.

    The smallest difference between distinct values, if all others are its multiples.
    """
    distinct = np.unique(value[np.isfinite(value)])
    if len(distinct) < 3 or len(distinct) > 0.5 * len(value):
        return 0.0
    gaps = np.diff(distinct)
    step = float(np.min(gaps[gaps > 1e-12 * np.ptp(distinct)], initial=np.inf))
    if not np.isfinite(step):
        return 0.0
    multiples = gaps / step
    return step if np.mean(np.abs(multiples - np.round(multiples)) < 0.05) > 0.95 else 0.0


def finest_step(value: FloatArray) -> float:
    """The step of the grid that values lie on, however fine it is against their noise; 0.0 when they lie on none.

    Of n samples with noise over k steps some lie on neighbouring levels unless k is far above n².
    """
    distinct = np.unique(value[np.isfinite(value)])
    if len(distinct) < 3:
        return 0.0
    gaps = np.diff(distinct)
    gaps = gaps[gaps > 1e-9 * np.ptp(distinct)]  # a difference by rounding to SI is no level
    step = float(np.min(gaps))
    step = float(np.mean(gaps[gaps < 1.5 * step]))
    off = np.abs(gaps / step - np.round(gaps / step))[gaps < 100 * step]
    return step if np.mean(off < 0.1) > 0.95 else 0.0


@dataclass(frozen=True)
class Counts:
    """The ``levels`` (k,) that a coarse channel comes in, ``step`` apart, and the noise on top of them."""

    levels: FloatArray
    step: float
    sigma: float


def coarse_counts(value: FloatArray) -> Counts | None:
    """The counts of a channel (n,) that stands on each for several samples, steps to the next and rarely goes back;
    None of an ordinary one.

    A sound converter is fine, or its signal's noise dithers it. Ten to 500 steps to the range: fewer may be a staircase
    that was commanded, more leave nothing to be seen.
    """
    v = value[np.isfinite(value)]
    if len(v) < 100 or np.ptp(v) == 0:
        return None
    gaps = np.diff(np.sort(v))
    falling = np.sort(gaps)[::-1][: len(v) // 5]
    fall = falling[9:-1] / np.maximum(falling[10:], 1e-9 * np.ptp(v))
    at = 9 + int(np.argmax(fall))
    if fall[at - 9] < 4.0:
        return None  # no line between noise about a level and a step
    edges = np.flatnonzero(gaps > np.sqrt(falling[at] * max(falling[at + 1], 1e-9 * np.ptp(v)))) + 1
    groups = np.split(np.sort(v), edges)
    levels = np.array([np.mean(g) for g in groups])
    step = float(np.median(np.diff(levels)))
    scatter = np.concatenate([g - np.mean(g) for g in groups if len(g) > 2] or [np.zeros(1)])
    sigma = float(np.sqrt(np.mean(np.square(scatter))))
    counts = np.searchsorted(0.5 * (levels[1:] + levels[:-1]), v)
    moves = np.sign(np.diff(counts))
    moves, still = moves[moves != 0], float(np.mean(moves == 0))
    back = float(np.mean(moves[1:] != moves[:-1])) if len(moves) > 1 else 1.0
    coarse = 2e-3 < step / np.ptp(v) < 0.1 and sigma < 0.2 * step and still > 0.6 and back < 0.3
    # Of exact counts, less noise than a tenth of a step cannot be told.
    return Counts(levels, step, sigma if sigma > 1e-6 * step else 0.1 * step) if coarse else None


def correlation_time(residual: FloatArray, limit: int = 2000) -> float:
    """Integrated autocorrelation time in samples, ≥ 1: so many samples count as one.

    Sum of the autocorrelation up to its first crossing of 0.05 (Sokal's windowing, simplified).
    """
    r = residual - residual.mean()
    n = len(r)
    if n < 16 or not np.any(r):
        return 1.0
    size = 1 << int(np.ceil(np.log2(2 * n)))
    spectrum = np.abs(np.fft.rfft(r, size)) ** 2
    rho = np.fft.irfft(spectrum, size)[: min(limit, n // 4)]
    rho = rho / rho[0]
    below = np.flatnonzero(rho < 0.05)
    end = int(below[0]) if len(below) else len(rho)
    return max(1.0, float(1.0 + 2.0 * np.sum(rho[1:end])))


def long_run_share(runs: Sequence[FloatArray]) -> float:
    """How many times larger the variance of sums over neighbouring samples is than were they independent, ≥ 1, for the
    length of block where that is most and surest.

    A small correlation over many samples, which `correlation_time` cuts off, imitates a smooth effect.
    """
    square = float(np.mean(np.square(np.concatenate(runs)))) if len(runs) else 0.0
    most = 1.0
    for length in BLOCKS:
        sums = [v[: len(v) // length * length].reshape(-1, length).sum(axis=1) for v in runs]
        summed = np.concatenate(sums or [np.zeros(0)])
        if square > 0 and len(summed) >= FEWEST_BLOCKS:
            ratio = float(np.mean(np.square(summed))) / (length * square)
            most = max(most, ratio * (1.0 - CHANCE * np.sqrt(2.0 / len(summed))))
    return most


def mean_correlation(residual: FloatArray, recording: NDArray[np.int64]) -> float:
    """How many rows of a ``residual`` (n,) count as one: the mean over recordings, each row's number (n,), or that of
    all in long blocks where it is more."""
    runs = [residual[recording == r] for r in np.unique(recording)]
    times = [correlation_time(run) for run in runs]
    return max(float(np.mean(times)), long_run_share(runs)) if times else 1.0


SMOOTH, SHRUNK = 0.25, 3.0
"""s over which what a record has beyond its fitted actuator is smoothed, and standard errors by which it is shrunk."""


def smoothed_error(sigma: float, dt: float, width: float = SMOOTH) -> float:
    """Standard error that white noise of ``sigma``, every ``dt`` s, leaves in a Gaussian mean over ``width`` s."""
    return float(sigma / np.sqrt(2.0 * np.sqrt(np.pi) * max(width / dt, 1.0)))


def denoised(time: FloatArray, remainder: FloatArray, width: float = SMOOTH, shrunk: float = SHRUNK) -> FloatArray:
    """The part of a record beyond its fitted actuator, (n,), without the sensor's noise: smoothed over ``width`` s and
    ``shrunk`` by so many standard errors; over a few samples only where it moves quickly.

    Raw noise, fed to a tissue, imitates friction and preload; what is left of it at rest, where skin is softest, a
    leaning probe.
    """
    dt = float(np.median(np.diff(time)))
    sigma = high_band_sigma(remainder)
    wide = gaussian_filter1d(remainder, max(width / dt, 1.0), mode="nearest")
    wide = np.sign(wide) * np.maximum(np.abs(wide) - shrunk * smoothed_error(sigma, dt, width), 0.0)
    narrow = gaussian_filter1d(remainder, 1.0, mode="nearest")
    moving = gaussian_filter1d((np.abs(narrow - wide) > 2.5 * sigma).astype(float), 3.0, mode="nearest")
    trust = np.clip(4.0 * moving - 0.4, 0.0, 1.0)
    near = np.where(np.abs(remainder - narrow) > 6 * sigma, remainder, narrow)
    return np.asarray(trust * near + (1 - trust) * wide)
