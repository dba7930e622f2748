"""Nodes of the robot's loop."""

from __future__ import annotations

import numpy as np

from gap.null.robot_grid import KINK, loop_grid
from sim_devices.stages.operators import Delay, Polled


def test_a_step_begins_when_it_comes() -> None:
    """From the node before it, up to 20 ms away, the loop was simulated as on a ramp: sound robots were told a latency
    of 5 ms."""
    time, value = np.array([0.0, 1.5, 1.5, 3.0]), np.array([0.0, 0.0, 1.0, 1.0])
    grid = loop_grid(np.array([0.0, 1.5, 3.0]), time, -0.5, 3.5)
    signal = np.interp(grid, time, value)
    assert np.max(signal[grid < 1.5 - 0.5 * KINK]) == 0.0
    assert grid[grid < 1.5 - 0.5 * KINK][-1] >= 1.5 - 1.5 * KINK
    assert np.interp(1.499, grid, signal) == 0.0


def test_a_step_that_is_late_begins_when_it_is_due() -> None:
    """What is delayed is read between nodes: there are some on both sides of the step, and of when it is due."""
    time = np.array([0.0, 1.5, 1.5, 3.0])
    late = Delay("latency", "timing", ("u",), ("v",), delay=0.0123)
    grid = loop_grid(np.array([0.0, 1.5, 3.0]), time, -0.5, 3.5, (late,))
    for moment in (1.5, 1.5123):
        assert np.min(np.abs(grid - (moment - KINK))) < 0.1 * KINK
        assert np.min(np.abs(grid - moment)) < 0.1 * KINK


def test_looks_that_begin_anew_are_nodes() -> None:
    looks = Polled("polled", "timing", ("u",), ("v",), period=0.2, phase=0.5, marks=(0.0, 1.05))
    grid = loop_grid(np.array([0.0, 3.0]), np.array([0.0, 3.0]), -0.5, 3.5, (looks,))
    for moment in (0.1, 0.9, 1.15, 2.95):
        assert np.min(np.abs(grid - moment)) < 0.1 * KINK
