"""Smoothing that widens as far as the record allows: what it keeps is significant, what it loses is noise."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter1d

from gap.data.noise import high_band_sigma
from sim_devices.chain import FloatArray

WIDTHS = (0.01, 0.02, 0.04, 0.08, 0.16, 0.32, 0.64, 1.3)
"""Standard deviations of the smoothing kernels, s."""
CONFIDENCE = 2.7
"""Half width of the confidence intervals that must intersect, in standard errors."""


NOTHING, ALL = 3.0, 5.0
"""Standard errors below which a smoothed deviation is taken for noise, and above which it is kept as it is."""


def significant(time: FloatArray, value: FloatArray) -> FloatArray:
    """``value`` (n,) smoothed at each point as widely as all narrower smoothings agree with it.

    The intersection of confidence intervals (Goldenshluger and Nemirovski 1997; Katkovnik 1999), on Gaussian kernels.
    """
    return _smoothed(time, value)[0]


def deviation(time: FloatArray, value: FloatArray) -> FloatArray:
    """The same of a ``value`` (n,) that mostly is nought: what does not stand out from its noise vanishes.

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
        smooth = gaussian_filter1d(value, samples, mode="reflect")  # the last sample alone is noise
        standard = sigma / np.sqrt(2 * np.sqrt(np.pi) * samples)
        low = np.maximum(low, smooth - CONFIDENCE * standard)
        high = np.minimum(high, smooth + CONFIDENCE * standard)
        agree &= low <= high
        out, error = np.where(agree, smooth, out), np.where(agree, standard, error)
    return out, error
