"""Curved commands are resolved: bins and time steps follow how fast they turn."""

from __future__ import annotations

import numpy as np
import pytest

from gap.data.binning import TURN, WIDEST, bin_edges
from gap.data.command import command


def sine(frequency: float, rate: float = 100.0):
    time = np.arange(0.0, 10.0, 1 / rate)
    return command(time, 1e-3 * np.sin(2 * np.pi * frequency * time))


@pytest.mark.parametrize("frequency", [0.2, 0.8, 1.5, 3.0])
def test_a_sine_turns_as_fast_as_its_angular_frequency(frequency: float) -> None:
    assert sine(frequency).turning(1.0, 9.0) == pytest.approx(2 * np.pi * frequency, rel=0.2)


def test_straight_lines_do_not_turn() -> None:
    ramps = command(np.array([0.0, 1.0, 1.1, 5.0]), np.array([0.0, 0.0, 1.0, 1.0]))
    assert ramps.turning(1.0, 1.1) == 0.0
    assert ramps.turning(1.1, 5.0) == 0.0
    assert ramps.turning(1.0, 1.0) == 0.0


def test_a_step_at_an_end_is_no_curve() -> None:
    held = command(np.array([0.0, 1.0, 1.0, 5.0, 5.0, 9.0]), np.array([0.0, 0.0, 1.0, 1.0, 0.0, 0.0]))
    assert [held.turning(*pair) for pair in ((0.0, 1.0), (1.0, 5.0), (5.0, 9.0))] == [0.0, 0.0, 0.0]


def test_a_command_that_is_rounded_hardly_differs_from_a_straight_line() -> None:
    time = np.arange(0.0, 10.0, 0.01)
    assert command(time, np.round(30e3 * time / 10.0, -2)).turning(0.0, 9.99) == 0.0


@pytest.mark.parametrize(("frequency", "widest"), [(0.1, WIDEST), (1.5, TURN / (3.0 * np.pi))])
def test_bins_are_narrow_where_a_command_turns_fast(frequency: float, widest: float) -> None:
    edges = bin_edges(0.0, 9.9, np.array([0.0]), 0.002, turning=sine(frequency).turning)
    assert np.diff(edges).max() == pytest.approx(widest, rel=0.1)
