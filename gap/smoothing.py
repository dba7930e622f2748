"""Smoothing that widens as far as the record allows: what it keeps is significant, what it loses is noise."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter1d

from gap.hypothesis import FloatArray
from gap.noise import high_band_sigma

WIDTHS = (0.01, 0.02, 0.04, 0.08, 0.16, 0.32, 0.64, 1.3)
"""Standard deviations of the smoothing kernels, s."""
CONFIDENCE = 2.7
"""Half width of the confidence intervals that must intersect, in standard errors."""


def significant(time: FloatArray, value: FloatArray) -> FloatArray:
    """``value`` (n,) smoothed at each point as widely as all narrower smoothings agree with it.

    The intersection of confidence intervals (Goldenshluger and Nemirovski 1997; Katkovnik 1999), on Gaussian kernels.
    """
    dt = float(np.median(np.diff(time)))
    sigma = high_band_sigma(value)
    out = value.astype(float)
    low, high = np.full(len(value), -np.inf), np.full(len(value), np.inf)
    agree = np.ones(len(value), bool)
    for width in WIDTHS:
        samples = width / dt
        if samples < 0.7:
            continue
        smooth = gaussian_filter1d(value, samples, mode="nearest")
        error = CONFIDENCE * sigma / np.sqrt(2 * np.sqrt(np.pi) * samples)
        low, high = np.maximum(low, smooth - error), np.minimum(high, smooth + error)
        agree &= low <= high
        out = np.where(agree, smooth, out)
    return out
