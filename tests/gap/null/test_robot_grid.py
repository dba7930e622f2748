"""Nodes of the robot's loop."""

from __future__ import annotations

import numpy as np

from gap.null.robot_grid import KINK, loop_grid


def test_a_step_begins_when_it_comes() -> None:
    """From the node before it, up to 20 ms away, the loop was simulated as on a ramp: sound robots were told a latency
    of 5 ms."""
    time, value = np.array([0.0, 1.5, 1.5, 3.0]), np.array([0.0, 0.0, 1.0, 1.0])
    grid = loop_grid(np.array([0.0, 1.5, 3.0]), time, -0.5, 3.5)
    signal = np.interp(grid, time, value)
    assert np.max(signal[grid < 1.5 - 0.5 * KINK]) == 0.0
    assert grid[grid < 1.5 - 0.5 * KINK][-1] >= 1.5 - 1.5 * KINK
    assert np.interp(1.499, grid, signal) == 0.0
