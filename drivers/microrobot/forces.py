"""From transducer voltages to the force of the skin on the probe.

Three transducers (Honeywell FSS1500NC) at the apices of an equilateral triangle carry the probe: leg a at -√3 w/2, b at
0, c at +√3 w/2 in x. R = M F (Flynn et al., the relation of the three-axis probe), with w from centroid to apex and h
the height of the tip above the transducers. Forces in N, compressions positive; R is the force the skin exerts on the
probe, in the fixed frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]

TRIANGLE_SIDE = 15e-3
"""Side of the transducers' triangle, m (paper)."""
TRANSDUCER_RADIUS = TRIANGLE_SIDE / np.sqrt(3.0)
"""w: centroid to apex, m."""
PROBE_HEIGHT = 20e-3
"""h, m (assumed)."""
GRAM_FORCE = 9.80665e-3
"""N"""
SENSITIVITY = 0.12e-3 / GRAM_FORCE
"""V/N at 5 V excitation (datasheet: 0.12 mV/g, 0.10 to 0.14)."""
FULL_SCALE = 1500 * GRAM_FORCE
"""N (datasheet)."""


@dataclass(frozen=True)
class Calibration:
    """Of the three transducers: ``sensitivity`` V/N and ``null`` V, each (3,) or one number."""

    sensitivity: float | tuple[float, float, float] = SENSITIVITY
    null: float | tuple[float, float, float] = 0.0


def matrix(w: float = TRANSDUCER_RADIUS, h: float = PROBE_HEIGHT) -> FloatArray:
    """M (3, 3) of R = M F. Raises ValueError unless w and h (m) are positive."""
    if not (w > 0 and h > 0):
        raise ValueError(f"the force matrix needs positive w and h, got w = {w} m, h = {h} m")
    lever = np.sqrt(3.0) * w / (2 * h)
    return np.array([[-lever, 0.0, lever], [-w / (2 * h), w / h, -w / (2 * h)], [-1.0, -1.0, -1.0]])


def transducer_forces(volts: ArrayLike, calibration: Calibration | None = None) -> FloatArray:
    """Compressions (..., 3) N for voltages (..., 3) V at 5 V excitation."""
    known = calibration or Calibration()
    force: FloatArray = (np.asarray(volts, dtype=float) - np.asarray(known.null)) / np.asarray(known.sensitivity)
    return force


def transducer_volts(forces: ArrayLike, calibration: Calibration | None = None) -> FloatArray:
    """Voltages (..., 3) V for compressions (..., 3) N."""
    known = calibration or Calibration()
    volts_out: FloatArray = np.asarray(forces, dtype=float) * np.asarray(known.sensitivity) + np.asarray(known.null)
    return volts_out


def reaction(forces: ArrayLike, w: float = TRANSDUCER_RADIUS, h: float = PROBE_HEIGHT) -> FloatArray:
    """R (..., 3) N for tared transducer forces (..., 3) N."""
    return np.asarray(forces, dtype=float) @ matrix(w, h).T


def legs(tip_force: ArrayLike, w: float = TRANSDUCER_RADIUS, h: float = PROBE_HEIGHT) -> FloatArray:
    """Transducer forces (..., 3) N that balance R (..., 3) N: the inverse of ``reaction``."""
    legs: FloatArray = np.asarray(tip_force, dtype=float) @ np.linalg.inv(matrix(w, h)).T
    return legs


def tare(forces: ArrayLike) -> FloatArray:
    """Mean (3,) N of forces (n, 3) taken with the probe at rest, to be subtracted.

    Raises ValueError if there are none.
    """
    array = np.asarray(forces, dtype=float)
    if array.ndim != 2 or array.shape[1] != 3 or not len(array):
        raise ValueError(f"a tare needs samples of shape (n, 3) with n >= 1, got {array.shape}")
    if not np.isfinite(array).all():
        raise ValueError("a tare needs finite samples")
    return np.asarray(array.mean(axis=0))


def out_of_range(forces: ArrayLike) -> NDArray[np.bool_]:
    """(..., 3) of bool: untared compressions that the transducer cannot carry (pulled, or over its full scale)."""
    array = np.asarray(forces, dtype=float)
    return (array < 0) | (array > FULL_SCALE)
