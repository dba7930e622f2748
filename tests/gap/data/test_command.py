"""Commands from tables of set-points: nothing that was commanded goes, and kinks are told from curves."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gap.data.command import COLLINEAR, command, in_whole_steps

ROWS = np.arange(0.0, 60.0, 0.02)


def off(time: np.ndarray, value: np.ndarray) -> float:
    """Largest difference between a table and its command, as a share of the range."""
    c = command(time, value)
    fine = np.linspace(time[0], time[-1], 30001)
    return float(np.max(np.abs(np.interp(fine, c.time, c.value) - np.interp(fine, time, value))) / np.ptp(value))


@pytest.mark.parametrize("hertz", [0.01, 0.03, 0.05, 0.1, 0.5, 2.0])
def test_a_slow_sine_in_a_dense_table_stays_one(hertz: float) -> None:
    """Of rows of 20 ms on a sine below 0.1 Hz none bends by much: a straight line was made of it."""
    assert off(ROWS, 1e-3 * np.sin(2 * np.pi * hertz * ROWS)) < 2 * COLLINEAR


def test_a_sum_of_sines_and_a_coarse_table_stay_what_they_are() -> None:
    many = sum(np.sin(2 * np.pi * f * ROWS + f) for f in (0.03, 0.11, 0.4))
    assert off(ROWS, many) < 2 * COLLINEAR
    assert off(ROWS[::25], many[::25]) < 2 * COLLINEAR


def test_smooth_commands_have_no_kinks_and_triangles_have_theirs() -> None:
    assert list(command(ROWS, np.sin(2 * np.pi * 0.08 * ROWS)).kinks) == [ROWS[0], ROWS[-1]]
    corners = np.array([0.0, 1.0, 6.0, 11.0, 16.0, 59.98])
    triangle = command(ROWS, np.interp(ROWS, corners, [0, 0, 1, 0, 1, 1]))
    assert triangle.kinks == pytest.approx(corners)
    assert len(triangle.time) == len(corners)


def test_a_jump_between_two_rows_is_a_step_at_the_later() -> None:
    c = command(ROWS, np.where((ROWS > 2.01) & (ROWS < 10.0), -3e4, 0.0))
    jumps = np.flatnonzero(np.diff(c.time) == 0)
    assert c.time[jumps] == pytest.approx([2.02, 10.0])
    assert set(c.time[jumps]) <= set(c.kinks)


def test_a_table_that_writes_its_steps_is_straight_between_other_rows() -> None:
    """Break points before a sampled sine, each step of them as two rows of one time: the way from the last of them to
    the sine's first row was taken for a step, 40 ms early."""
    rows = np.arange(5.04, 25.0, 0.04)
    time = np.concatenate([[0.0, 2.0, 2.0, 5.0], rows])
    c = command(time, np.concatenate([[0.0, 0.0, -20.0, -20.0], -35.0 - 5.0 * np.sin(rows)]))
    assert c.time[np.flatnonzero(np.diff(c.time) == 0)] == pytest.approx([2.0])
    assert np.interp(5.02, c.time, c.value) == pytest.approx(0.5 * (-20.0 - 35.0 - 5.0 * np.sin(5.04)))


def test_held_rows_are_late_by_half_an_interval_but_for_steps() -> None:
    sine = np.where(ROWS < 10.0, 0.0, -3e4) + 1e3 * np.sin(ROWS)
    c = command(ROWS, sine)
    time, value = c.table(held=True)
    assert np.all(np.diff(time) >= 0.0)
    stairs = np.repeat(ROWS, 2)[1:], np.repeat(sine, 2)[:-1]
    fine = np.arange(0.1, 59.0, 1e-4)
    paths = [np.interp(fine, *table) for table in (stairs, (time, value), c.table(held=False))]
    true, late, straight = (np.convolve(v, np.full(200, 1 / 200), "valid")[::200] for v in paths)  # over rows of 20 ms
    assert np.max(np.abs(late - true)) < 10.0  # of half a row beside the step, where rows differ by up to 20
    assert np.median(np.abs(late - true)) < 0.1 * np.median(np.abs(straight - true))
    assert c.steps == pytest.approx([10.0])


def test_corners_of_a_protocol_are_no_sampled_rows() -> None:
    corners = np.arange(0.0, 40.0, 1.0)
    assert not np.any(command(corners, np.sin(corners)).late)
    assert not np.any(command(ROWS, np.zeros(len(ROWS))).late)


def test_levels_are_held_at_whole_steps_and_ramps_go_through_them() -> None:
    time = np.array([0.0, 1.0, 1.0, 3.0, 5.0, 6.0, 8.0, 8.0, 9.0])
    value = np.array([0.0, 0.0, 10.4, 10.4, 20.3, 20.3, 5.7, 0.0, 0.0])
    t, v = in_whole_steps(time, value, 1.0)
    for at, level in ((0.5, 0.0), (2.0, 10.0), (4.0, 0.5 * (10.4 + 20.3)), (5.5, 20.0), (7.0, 0.5 * (20.3 + 5.7))):
        assert np.interp(at, t, v) == pytest.approx(level)
    again = in_whole_steps(time, np.round(value), 1.0)
    assert np.array_equal(again[0], time)
    assert np.array_equal(again[1], np.round(value))


def test_a_command_may_be_on_its_way_when_it_steps() -> None:
    """A sine that was cut off between two rows of 50 ms was a ramp: 90 sigma of a sound instrument."""
    rows = np.arange(0.0, 20.0, 0.05)
    sine = np.where(rows < 9.98, 18.0 + 7.0 * np.sin(np.pi * rows / 2.0), 0.0)
    c = command(rows, sine)
    assert c.time[np.flatnonzero(np.diff(c.time) == 0)] == pytest.approx([10.0])
    quick = np.sin(2 * np.pi * 1.7 * rows)
    assert not np.any(np.diff(command(rows, quick).time) == 0)


@pytest.mark.parametrize("share", [0.003, 0.3, 0.66, 0.995])
def test_a_step_that_was_sampled_on_its_way_comes_in_two(share: float) -> None:
    """It was taken for a ramp of two intervals, 10 ms early: a sound regulator was 19 sigma off."""
    table = np.where(ROWS > 5.0, 1.0, 0.0)
    k = int(np.argmax(table > 0))
    table[k] = share
    c = command(ROWS, table)
    before, between, after = np.interp([ROWS[k] - 1e-6, ROWS[k] + 1e-6, ROWS[k + 1] + 1e-6], c.time, c.value)
    assert (before, between, after) == pytest.approx((0.0, share, 1.0), abs=1e-3)
    assert np.interp(ROWS[k + 1] - 1e-6, c.time, c.value) == pytest.approx(share, abs=1e-3)


def test_a_ramp_of_two_intervals_stays_one() -> None:
    table = np.interp(ROWS, [5.0, 5.04], [0.0, 1.0])
    assert off(ROWS, table) < 2 * COLLINEAR


def test_rows_that_somebody_chose_are_straight_lines_however_many() -> None:
    """A ramp of 0.1 s ahead of a sine in 160 rows of 102 ms was made a step at its end."""
    sine = 1.5 + 0.1018 * np.arange(160)
    time = np.r_[0.0, 1.1, 1.2, sine]
    value = np.r_[0.0, 0.0, -1e4, -1e4 * np.cos(2 * np.pi * 0.1 * (sine - sine[0]))]
    assert off(time, value) < 2 * COLLINEAR


def test_quick_edges_of_a_binary_sequence_stay_where_they_are_and_are_kinks() -> None:
    """Edges of 1 ms every 0.33 s: half of them became steps 1 ms late, none a kink, as all around bend alike."""
    rng = np.random.default_rng(50001)
    bits = np.where(rng.random(40) < 0.5, -3e4, -1e4)
    begins = 1.0 + 0.328 * np.arange(40)
    time = np.ravel(np.column_stack([begins, begins + 1e-3]))
    value = np.ravel(np.column_stack([np.r_[0.0, bits[:-1]], bits]))
    c = command(np.r_[0.0, time], np.r_[0.0, value])
    assert not np.any(np.diff(c.time) == 0)
    edges = begins[np.r_[0.0, bits[:-1]] != bits]
    assert set(np.round(np.r_[edges, edges + 1e-3], 6)) <= set(np.round(c.kinks, 6))


def test_a_sampled_command_in_whole_milliseconds_still_steps() -> None:
    time = np.round(np.arange(200) / 30, 3)
    c = command(time, np.where((time > 2.01) & (time < 5.0), -3e4, 0.0))
    assert c.time[np.flatnonzero(np.diff(c.time) == 0)] == pytest.approx([2.033, 5.0])


@settings(max_examples=40, deadline=None)
@given(st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=60), st.floats(0.01, 1.0))
def test_any_table_of_few_rows_is_met_at_every_row(values: list[float], period: float) -> None:
    time, value = period * np.arange(len(values)), np.asarray(values)
    c = command(time, value)
    if len(time) < 50 and np.ptp(value) > 1e-9:
        assert np.interp(time, c.time, c.value) == pytest.approx(value, abs=1.01 * COLLINEAR * np.ptp(value) + 1e-12)
