"""Nodes of the robot's loop."""

from __future__ import annotations

import numpy as np
import pytest

from gap.null.robot_grid import KINK, commanded, loop_grid
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
    """Delays show the command's own rows, and those of every quantity: there are nodes on both sides of when a step is
    due, though the command of another axis rests."""
    steps = np.array([0.0, 1.5, 1.5, 3.0]), np.array([0.0, 0.0, 1.0, 1.0])
    tables = {"command_x": (np.array([0.0, 3.0]), np.zeros(2)), "command_y": steps}
    late = Delay("latency", "timing", tuple(tables), ("due_x", "due_y"), delay=0.0123)
    grid = loop_grid(np.array([0.0, 1.5, 3.0]), np.unique(steps[0]), -0.5, 3.5, (late,))
    due = commanded(grid, tables, (late,))["due_y"]
    before = grid < 1.5123 - 0.5 * KINK
    assert np.max(np.abs(due[before])) < 1e-6
    assert np.min(due[grid > 1.5123 + 0.5 * KINK]) == pytest.approx(1.0, abs=1e-6)
    assert grid[before][-1] >= 1.5123 - 1.5 * KINK


@pytest.mark.parametrize("delay", [0.0, 0.0123])
def test_a_curve_is_as_high_as_it_is(delay: float) -> None:
    """The chords of a sine of 1 Hz and 0.4 mm, 20 ms apart, are 0.5 µm too flat: 70 of χ² in a recording of 12 s."""
    time = np.arange(0.0, 4.0, 1e-3)
    late = Delay("latency", "timing", ("command_x",), ("due_x",), delay=delay)
    grid = np.arange(0.0, 4.0, 0.02)
    made = commanded(grid, {"command_x": (time, 4e-4 * np.sin(2 * np.pi * time))}, (late,))["due_x"]
    fine = np.linspace(0.5, 3.5, 3001)
    off = np.interp(fine, grid, made) - 4e-4 * np.sin(2 * np.pi * (fine - delay))
    means = off[:-1].reshape(-1, 20).mean(axis=1)
    assert np.max(np.abs(means)) < 0.02e-6


def test_looks_that_begin_anew_are_nodes() -> None:
    looks = Polled("polled", "timing", ("u",), ("v",), period=0.2, phase=0.5, marks=(0.0, 1.05))
    grid = loop_grid(np.array([0.0, 3.0]), np.array([0.0, 3.0]), -0.5, 3.5, (looks,))
    for moment in (0.1, 0.9, 1.15, 2.95):
        assert np.min(np.abs(grid - moment)) < 0.1 * KINK
