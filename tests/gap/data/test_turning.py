"""Curved commands are resolved: bins and time steps follow how fast they turn."""

from __future__ import annotations

import numpy as np
import pytest

from gap.data.binning import TURN, WIDEST, bin_edges, bin_means, node_times
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


@pytest.mark.parametrize("bits", [2, 3, 10])
def test_two_kinks_that_rounding_parts_hold_no_curve(bits: int) -> None:
    """The time of a step may lie some bits from that of another kink, in which no time passes from one node to the
    next."""
    stepped = command(np.array([0.0, 5.0, 5.0, 10.0]), np.array([0.0, 0.0, 1.0, 1.0]))
    before, after = 5.0 - bits * np.spacing(4.0), 5.0 + np.spacing(5.0)
    assert stepped.turning(before, after) == 0.0


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


def moves(begins: list[float], lasts: float, rate: float = 200.0):
    """Minimum-jerk moves, there and back, with holds between: nothing of it is a kink."""
    time = np.arange(0.0, begins[-1] + 6.0, 1 / rate)
    value = np.zeros(len(time))
    for k, begin in enumerate(begins):
        x = np.clip((time - begin) / lasts, 0.0, 1.0)
        value += (-1.0) ** k * x**3 * (10.0 - 15.0 * x + 6.0 * x**2)
    return command(time, 1e-3 * value)


def test_a_curve_ends_where_a_long_line_begins() -> None:
    begins = [4.0, 10.0, 15.0]
    made = moves(begins, 0.9)
    assert not any(np.any(np.abs(made.kinks - (b + 0.9)) < 0.3) for b in begins)
    for begin in begins:  # but for the slow beginning and end of a move, which are as good as straight
        for end in (begin, begin + 0.9):
            assert np.min(np.abs(made.curve_ends - end)) < 0.1
    assert made.turning(4.0, 4.9) > 3.0 * made.turning(0.0, 20.0)


@pytest.mark.parametrize("frequency", [0.02, 0.2, 1.5])
def test_a_sine_is_one_curve(frequency: float) -> None:
    assert len(sine(frequency).curve_ends) == 0


def test_bins_are_narrow_in_a_move_between_holds_and_grow_behind_it() -> None:
    made = moves([4.0, 10.0, 15.0], 0.9)
    edges = bin_edges(0.0, 21.0, np.array([0.0]), 0.004, widest=0.4, turning=made.turning, curve_ends=made.curve_ends)
    width, at = np.diff(edges), edges[:-1]
    assert np.all(width[(at > 10.1) & (at < 10.8)] < 0.2)
    assert np.all(width[(at > 10.8) & (at < 11.1)] < 0.2)
    assert np.max(width[at > 19.0]) == pytest.approx(0.4, abs=0.05)
    means = bin_means(made_time := np.arange(0.0, 21.0, 0.004), np.interp(made_time, made.time, made.value), edges)
    nodes = np.interp(node_times(means.time, means.spread, 0.0), made.time, made.value).mean(axis=0)
    assert np.max(np.abs(nodes - means.value)) < 1e-3 * 1e-3
