"""Reduction of a drive to segments, and interpolation back to its samples."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from skinrig_solver.suction.schedule import Segment, corners, interpolation, noise, polyline_fit, segments


@settings(max_examples=30, deadline=None)
@given(st.lists(st.tuples(st.floats(0.01, 10.0), st.floats(-5e4, 0.0)), min_size=1, max_size=6), st.floats(1e-3, 0.1))
def test_segments_follow_any_polyline(legs: list[tuple[float, float]], tolerance: float) -> None:
    knots = np.concatenate([[0.0], np.cumsum([length for length, _ in legs])])
    values = np.concatenate([[0.0], [p for _, p in legs]])
    time = np.unique(np.concatenate([np.linspace(0.0, knots[-1], 300), knots]))
    drive = np.interp(time, knots, values)
    span = max(np.abs(drive).max(), 1.0)
    kept = corners(time, drive, tolerance * span)
    assert np.abs(np.interp(time, time[kept], drive[kept]) - drive).max() <= tolerance * span * (1 + 1e-9)
    pieces = segments(time, drive, 0.01)
    assert pieces[0].start == time[0]
    assert pieces[-1].stop == time[-1]
    for piece in pieces:
        assert np.all(np.diff(np.concatenate([[piece.start], piece.times])) > 0)
        assert np.isclose(piece.times[-1], piece.stop)
        assert np.allclose(piece.step_number(piece.times), np.arange(1, piece.steps + 1))


def test_interpolation_is_exact_at_steps_and_for_a_line() -> None:
    pieces = [Segment(0.0, 1.0, 0.0, 1.0, 4, 1.0), Segment(1.0, 60.0, 1.0, 1.0, 6, 2.3)]
    steps = np.concatenate([[0.0], pieces[0].times, pieces[1].times])
    values = np.random.default_rng(0).normal(size=len(steps))
    assert np.allclose(interpolation(pieces, steps) @ values, values)
    time = np.linspace(0.0, 60.0, 500)
    weights = interpolation(pieces, time).toarray()
    assert np.allclose(weights.sum(axis=1), 1.0)
    ramp = time[time < 1.0]
    assert np.allclose(weights[: len(ramp)] @ steps, ramp)


def test_a_step_and_hold_takes_few_steps() -> None:
    time = np.arange(0.0, 60.0, 0.01)
    drive = np.where(time > 0.005, -3e4, 0.0)
    assert sum(piece.steps for piece in segments(time, drive, 0.01)) < 25


def test_noise_does_not_multiply_the_steps() -> None:
    rng, time = np.random.default_rng(1), np.arange(0.0, 60.0, 0.01)
    clean = np.where(time > 0.005, -3e4, 0.0)
    noisy = clean + 50.0 * rng.normal(size=len(time))
    assert 40.0 < noise(noisy) < 60.0
    pieces = segments(time, noisy, 0.01)
    assert sum(piece.steps for piece in pieces) < 40
    assert abs(pieces[-1].drive_stop + 3e4) < 10.0  # the hold is averaged, not sampled


def test_polyline_fit_recovers_knots() -> None:
    time, knots, values = np.linspace(0.0, 10.0, 200), np.array([0.0, 3.0, 10.0]), np.array([1.0, -2.0, 5.0])
    assert np.allclose(polyline_fit(time, np.interp(time, knots, values), knots), values)


def test_a_drive_already_on_at_the_first_sample_has_been_ramped() -> None:
    time = np.linspace(0.0, 1.0, 11)
    pieces = segments(time, np.full(11, -1e4), 0.02)
    assert pieces[0].start == -0.02
    assert pieces[0].drive_start == 0.0
    weights = interpolation(pieces, time).toarray()
    assert np.argmax(weights[0]) == pieces[0].steps


def test_no_drive_at_all() -> None:
    time = np.linspace(0.0, 1.0, 11)
    pieces = segments(time, np.zeros(11), 0.01)
    assert sum(piece.steps for piece in pieces) == 2
