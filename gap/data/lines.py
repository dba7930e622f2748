"""Lines in the spectra of several recordings' noise, all at the same frequency."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.ndimage import median_filter

from sim_devices.chain import FloatArray

DIFFERENCE = np.array([1.0, -4.0, 6.0, -4.0, 1.0])
"""Fourth differences: of a smooth signal they leave the noise."""
CLIPPED = 6.0
"""Times its median up to which a difference counts: edges of a path have lines of their own."""


@dataclass(frozen=True)
class Spectra:
    """Frequencies (k,) Hz that are the same for all runs, sampled at ``rate`` Hz, of up to ``longest`` samples."""

    rate: float
    longest: int

    @cached_property
    def size(self) -> int:
        return int(2 ** np.ceil(np.log2(2 * self.longest)))

    @cached_property
    def frequency(self) -> FloatArray:
        return np.asarray(np.fft.rfftfreq(self.size, 1.0 / self.rate))

    def power(self, signal: FloatArray) -> FloatArray:
        """Power (k,) of a run (n,)."""
        return np.asarray(np.abs(np.fft.rfft(signal, self.size)) ** 2)

    def above(self, power: FloatArray, width: float) -> FloatArray:
        """Power (k,) over the usual one within ``width`` Hz: exponential where it is noise."""
        usual = median_filter(power, int(width * self.size / self.rate) | 1, mode="reflect")
        return np.asarray(power * np.log(2.0) / np.maximum(usual, 1e-9 * power.max()))


def rate_of(times: Sequence[FloatArray]) -> float:
    """Samples per second of the usual one of some runs; 0 of runs that take no time. Stamps may come in blocks."""
    step = float(np.median([float(t[-1] - t[0]) / (len(t) - 1) for t in times]))
    return 1.0 / step if step > 0.0 else 0.0


def differences(value: FloatArray) -> FloatArray:
    """Fourth differences (n - 4,) of a path (n,) over their median size, clipped; nought of one that has none."""
    change = np.convolve(value, DIFFERENCE, "valid")
    usual = float(np.median(np.abs(change))) or float(np.std(change)) or 1.0
    return np.asarray(np.clip(change / usual, -CLIPPED, CLIPPED))


def without_the_loudest(each: Sequence[FloatArray]) -> tuple[FloatArray, int]:
    """What runs (k,) each have together, without the one that speaks the most for it where there are several; and how
    many are counted."""
    together = np.sum(each, axis=0)
    return (together - np.max(each, axis=0), len(each) - 1) if len(each) > 1 else (together, 1)
