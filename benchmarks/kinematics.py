"""Poses per second and round trip of the micro-robot's kinematics, one core: ``python benchmarks/kinematics.py``."""

from __future__ import annotations

import time

import numpy as np

from drivers.microrobot.kinematics import GEOMETRY, forward, inverse, jacobian


def main() -> None:
    """Print the figures beside their targets."""
    half = GEOMETRY.stroke / 2
    axis = np.random.default_rng(0).uniform(-half, half, (1_000_000, 3))
    tip = forward(axis)
    for name, function, points in (("forward", forward, axis), ("inverse", inverse, tip), ("jacobian", jacobian, axis)):
        function(points[:1])  # compiled or loaded before the clock runs
        start = time.perf_counter()
        function(points)
        rate = len(points) / (time.perf_counter() - start)
        print(f"{name:9s} {rate:12,.0f} poses/s  (target 1,000,000, ratio {rate / 1e6:.1f})")
    error = np.abs(forward(inverse(tip)) - tip).max()
    print(f"round trip over the workspace {error:.1e} m  (target 1e-9)")


if __name__ == "__main__":
    main()
