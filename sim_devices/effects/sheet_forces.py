"""Forces of skin on the robot's probe, N, changed in view of its displacement (x, y, z), m; and a rhythm of either."""

from __future__ import annotations

import math

import numpy as np

from sim_devices.chain import FloatArray
from sim_devices.stages import laws

Forces = tuple[FloatArray, FloatArray, FloatArray]


def deep_layer_force(
    time: FloatArray, fx: FloatArray, fy: FloatArray, fz: FloatArray, x: FloatArray, y: FloatArray, z: FloatArray,
    stiffness: float, start: float, width: float,
) -> Forces:  # fmt: skip
    """A spring towards rest that is engaged beyond a displacement of ``start``."""
    far = np.sqrt(x * x + y * y + z * z)
    pull = stiffness * laws.ramp(far, start, width) / np.maximum(far, 1e-12)
    return fx - pull * x, fy - pull * y, fz - pull * z


def stiffening_force(
    time: FloatArray, fx: FloatArray, fy: FloatArray, fz: FloatArray, x: FloatArray, y: FloatArray, z: FloatArray,
    strength: float, exponent: float,
) -> Forces:  # fmt: skip
    """Force times 1 + strength (displacement / 1 mm)^exponent."""
    factor = 1.0 + strength * (np.sqrt(x * x + y * y + z * z) / 1e-3) ** exponent
    return fx * factor, fy * factor, fz * factor


def tension_force(
    time: FloatArray, fx: FloatArray, fy: FloatArray, fz: FloatArray, x: FloatArray, y: FloatArray, z: FloatArray,
    stiffness: float | FloatArray, angle: float,
) -> Forces:  # fmt: skip
    """More tension along ``angle``, as much less across: the mean over directions stays."""
    c, s = math.cos(2 * angle), math.sin(2 * angle)
    return fx - stiffness * (c * x + s * y), fy - stiffness * (s * x - c * y), fz


def fibre_force(
    time: FloatArray, fx: FloatArray, fy: FloatArray, fz: FloatArray, x: FloatArray, y: FloatArray, z: FloatArray,
    stiffness: float, angle: float, slack: float,
) -> Forces:  # fmt: skip
    """Fibres along ``angle`` that pull back, either way, once the skin has moved by more than their ``slack``."""
    c, s = math.cos(angle), math.sin(angle)
    along = c * x + s * y
    pull = stiffness * np.copysign(laws.ramp(np.abs(along), slack, 0.05e-3), along)
    return fx - pull * c, fy - pull * s, fz


def tether_force(
    time: FloatArray, fx: FloatArray, fy: FloatArray, fz: FloatArray, x: FloatArray, y: FloatArray, z: FloatArray,
    stiffness: float, angle: float, slack: float,
) -> Forces:  # fmt: skip
    """A thread that pulls back only when the skin moves away along ``angle`` by more than ``slack``."""
    c, s = math.cos(angle), math.sin(angle)
    pull = stiffness * laws.ramp(c * x + s * y, slack, 0.05e-3)
    return fx - pull * c, fy - pull * s, fz


def tension_for_a_while(
    time: FloatArray, fx: FloatArray, fy: FloatArray, fz: FloatArray, x: FloatArray, y: FloatArray, z: FloatArray,
    stiffness: float, angle: float, moment: float, duration: float,
) -> Forces:  # fmt: skip
    """`tension_force` from a moment on, for a while: a muscle pulls at the skin's edge."""
    return tension_force(time, fx, fy, fz, x, y, z, stiffness * laws.spell(time, moment, duration), angle)


def to_and_fro(
    time: FloatArray, x: FloatArray, y: FloatArray, z: FloatArray,
    amplitude: float, frequency: float, phase: float, azimuth: float, elevation: float, sine: float, cosine: float,
) -> Forces:  # fmt: skip
    """A vector and, along one direction, a rhythm: of forces, or of displacements where the skin moves."""
    wave = laws.pulse(time, np.zeros(len(time)), amplitude, frequency, phase, sine, cosine)
    return _along(x, y, z, wave, azimuth, elevation)


def wandering_force(
    time: FloatArray, fx: FloatArray, fy: FloatArray, fz: FloatArray,
    amplitude: float, frequency: float, seed: float, azimuth: float, elevation: float,
) -> Forces:  # fmt: skip
    """A force and, along one direction, a rhythm whose rate wanders."""
    wave = laws.wandering_pulse(time, np.zeros(len(time)), amplitude, frequency, seed)
    return _along(fx, fy, fz, wave, azimuth, elevation)


def _along(x: FloatArray, y: FloatArray, z: FloatArray, wave: FloatArray, azimuth: float, elevation: float) -> Forces:
    """A vector and a ``wave`` (n,) along one direction (rad)."""
    flat = math.cos(elevation)
    return x + flat * math.cos(azimuth) * wave, y + flat * math.sin(azimuth) * wave, z + math.sin(elevation) * wave
