"""Smoothing that widens as far as the record allows: it keeps significant detail and loses noise."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.signal import oaconvolve
from scipy.signal.windows import gaussian

from gap.data.noise import high_band_sigma
from sim_devices.chain import FloatArray

WIDTHS = (0.0025, 0.005, 0.01, 0.02, 0.04, 0.08, 0.16, 0.32, 0.64, 1.3)
"""Standard deviations of the smoothing kernels, s."""
CONFIDENCE = 2.7
"""Half width of the confidence intervals that must intersect, in standard errors."""
LONG = 40.0
"""Samples of a kernel's standard deviation from which on a Fourier transform is quicker."""
NOTHING, ALL = 3.0, 5.0
"""Standard errors below which a smoothed deviation is taken for noise, and above which it is kept as it is."""


def significant(time: FloatArray, value: FloatArray) -> FloatArray:
    """``value`` (n,) smoothed at each point as widely as all narrower smoothings agree with it.

    The intersection of confidence intervals (Goldenshluger and Nemirovski 1997; Katkovnik 1999), on Gaussian kernels.
    """
    return _smoothed(time, value)[0]


def deviation(time: FloatArray, value: FloatArray) -> FloatArray:
    """The same of a ``value`` (n,) that mostly is nought: whatever is within its noise vanishes.

    Firm shrinkage (Gao and Bruce 1997). The widest kernel alone leaves a wander of a twentieth of the noise.
    """
    smooth, error = _smoothed(time, value)
    return np.asarray(smooth * np.clip((np.abs(smooth) / error - NOTHING) / (ALL - NOTHING), 0.0, 1.0))


def _smoothed(time: FloatArray, value: FloatArray) -> tuple[FloatArray, FloatArray]:
    """``value`` (n,) as `significant` has it, and its standard error (n,)."""
    dt = float(np.median(np.diff(time)))
    sigma = high_band_sigma(value)
    out = value.astype(float)
    error = np.full(len(value), sigma)
    low, high = np.full(len(value), -np.inf), np.full(len(value), np.inf)
    agree = np.ones(len(value), bool)
    for width in WIDTHS:
        samples = width / dt
        if samples < 0.7:
            continue
        smooth = blurred(value, samples)
        standard = sigma / np.sqrt(2 * np.sqrt(np.pi) * samples)
        low = np.maximum(low, smooth - CONFIDENCE * standard)
        high = np.minimum(high, smooth + CONFIDENCE * standard)
        agree &= low <= high
        out, error = np.where(agree, smooth, out), np.where(agree, standard, error)
    return out, error


def blurred(value: FloatArray, samples: float) -> FloatArray:
    """``value`` (n,) smoothed by a Gaussian of ``samples`` standard deviation, mirrored at its ends: the last sample
    alone is noise. Wide kernels by fast Fourier transform: a second of a fast record is a thousand samples."""
    if samples < LONG:
        return np.asarray(gaussian_filter1d(value, samples, mode="reflect"))
    reach = int(4.0 * samples + 0.5)
    kernel = gaussian(2 * reach + 1, samples)
    padded = np.pad(value.astype(float), reach, mode="symmetric")
    return np.asarray(oaconvolve(padded, kernel / kernel.sum(), mode="valid"))
