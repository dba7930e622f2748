"""An axis that sticks and slips: its record is smoothed no wider than it moves, and bins have the mean they have."""

from __future__ import annotations

import numpy as np

from gap.data.binning import node_times
from gap.data.smoothing import significant
from gap.null.robot_grid import averaged, nodes_within, sticking

TIME = np.arange(0.0, 4.0, 1e-3)
NOISE = 4e-6


def _slipping(time: np.ndarray) -> np.ndarray:
    """Slips of 160 um within 20 ms, one in 130 ms."""
    k = np.floor(time / 0.13)
    return np.asarray(160e-6 * (k + np.clip((time - 0.13 * k) / 0.02, 0.0, 1.0)))


def test_a_slip_within_20_ms_is_not_smoothed_away():
    """The narrowest kernel, 10 ms, was up to 33 um off beside each slip: 20 mN of skin, ten times a leg's noise."""
    recorded = _slipping(TIME) + NOISE * np.random.default_rng(0).normal(size=len(TIME))
    off = np.abs(significant(TIME, recorded) - _slipping(TIME))[100:-100]
    assert off.max() < 20e-6
    assert np.sqrt(np.mean(off**2)) < 0.8 * NOISE


def test_two_nodes_do_for_smooth_motion_and_miss_the_mean_of_slips():
    centre = np.arange(0.2, 3.8, 0.1)
    ends = node_times(centre, np.full(len(centre), 0.1 / 12**0.5), 0.0)
    smooth = {"axis_1": (TIME, 1e-3 * np.sin(TIME))}
    assert not sticking(smooth, ends, 3e-4).any()
    slips = {**smooth, "axis_2": (TIME, _slipping(TIME))}
    found = sticking(slips, ends, 3e-4)
    assert found.mean() > 0.3
    grid = np.union1d(np.arange(0.0, 4.0, 0.1), nodes_within(ends[:, found]))
    means = averaged(grid, [_slipping(grid)], ends[:, found])[0]
    true = averaged(TIME, [_slipping(TIME)], ends[:, found])[0]
    pairs = _slipping(ends[:, found]).mean(axis=0)
    assert np.abs(means - true).max() < 2e-6
    assert np.abs(pairs - true).max() > 10e-6
