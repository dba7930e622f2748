"""How much of a signal is noise: the floor against which a gap counts."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter1d

from gap.hypothesis import FloatArray


def high_band_sigma(value: FloatArray) -> float:
    """Standard deviation of a sample's noise from the high band: third differences, robustly.

    Third differences of white noise have variance 20 σ². On a grid they come in steps: their median is taken as if each
    were spread over its step, and the grid's own σ = step/√12 is the least.
    """
    v = value[np.isfinite(value)]
    if len(v) < 8:
        return (float(np.std(v)) if len(v) else 0.0) or 1.0
    scale = float(np.ptp(v)) or max(abs(float(v[0])), 1.0)
    step = grid_step(v)
    differences = np.abs(np.diff(v, 3))
    median = step * _grouped_median(differences / step) if step else float(np.median(differences))
    if not median and np.any(differences):  # coarse levels, but on no even grid
        changes = np.abs(np.diff(v))
        step = float(np.median(changes[changes > 0]))
    return max(median / 0.6745 / np.sqrt(20.0), step / np.sqrt(12.0), 1e-7 * scale)


def _grouped_median(values: FloatArray) -> float:
    """Median of non-negative values on the grid 0, 1, 2 …, each spread evenly over ± ½ (0 over 0 … ½)."""
    share = np.cumsum(np.bincount(np.rint(values).astype(np.int64))) / len(values)
    k = int(np.searchsorted(share, 0.5))
    below = float(share[k - 1]) if k else 0.0
    low, high = max(k - 0.5, 0.0), k + 0.5
    return low + (high - low) * (0.5 - below) / (float(share[k]) - below)


def rounding_floor(sigma: float, step: float) -> float:
    """What averaging does not lower of the error that a grid of ``step`` makes, rms, for samples of noise ``sigma``
    (rounding included).

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


def denoised(time: FloatArray, remainder: FloatArray, width: float = 0.25) -> FloatArray:
    """What a record shows beyond its fitted actuator, (n,), without the sensor's noise: smoothed over ``width`` s and
    shrunk by three standard errors; over a few samples only where it moves quickly.

    Raw noise, fed to a tissue, imitates friction and preload; what is left of it at rest, where skin is softest, a
    leaning probe.
    """
    dt = float(np.median(np.diff(time)))
    sigma = high_band_sigma(remainder)
    samples = max(width / dt, 1.0)
    wide = gaussian_filter1d(remainder, samples, mode="nearest")
    standard_error = sigma / np.sqrt(2.0 * np.sqrt(np.pi) * samples)
    wide = np.sign(wide) * np.maximum(np.abs(wide) - 3.0 * standard_error, 0.0)
    narrow = gaussian_filter1d(remainder, 1.0, mode="nearest")
    moving = gaussian_filter1d((np.abs(narrow - wide) > 2.5 * sigma).astype(float), 3.0, mode="nearest")
    trust = np.clip(4.0 * moving - 0.4, 0.0, 1.0)
    near = np.where(np.abs(remainder - narrow) > 6 * sigma, remainder, narrow)
    return np.asarray(trust * near + (1 - trust) * wide)
