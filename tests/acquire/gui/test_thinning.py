"""Thinned curves show every extreme and stay small."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from acquire.gui.thinning import Trace, extremes

VALUES = arrays.arrays(float, st.integers(1, 300), elements=st.floats(-1e3, 1e3))


@settings(max_examples=40, deadline=None)
@given(VALUES, st.floats(0.001, 10.0))
def test_extremes_keep_the_least_and_the_greatest(value: np.ndarray, width: float) -> None:
    time = np.arange(len(value)) * 0.01
    thin_time, thin = extremes(time, value, width)
    assert thin.min() == value.min()
    assert thin.max() == value.max()
    assert np.all(np.diff(thin_time) >= 0)
    assert thin_time[0] == time[0]
    assert thin_time[-1] == time[-1]
    assert len(thin) <= 2 * (np.floor(time[-1] / width) + 1)


def test_a_falling_edge_falls_and_a_rising_one_rises() -> None:
    time = np.arange(200) * 0.01
    falling = np.where(time < 0.97, 300.0, 0.0)  # the edge is inside a stretch
    _, thin = extremes(time, falling, 0.05)
    assert np.all(np.diff(thin) <= 0)
    _, thin = extremes(time, falling[::-1], 0.05)
    assert np.all(np.diff(thin) >= 0)
    ramp = Trace(capacity=100)
    ramp.add(time, -time)
    ramp.add(time + 2.0, -2.0 - time)
    assert np.all(np.diff(ramp.between(0.0, 4.0, 20)[1]) <= 0)


def test_a_gap_stays_one_only_where_nothing_was_measured() -> None:
    _, thin = extremes(np.arange(4.0), np.array([1.0, np.nan, np.nan, np.nan]), 2.0)
    np.testing.assert_array_equal(thin, [1.0, 1.0, np.nan, np.nan])


def test_a_trace_does_not_grow_and_forgets_no_extreme() -> None:
    trace = Trace(capacity=1000)
    noise = np.random.default_rng(0)
    least, greatest = np.inf, -np.inf
    for k in range(100):
        value = noise.normal(size=137)
        least, greatest = min(least, value.min()), max(greatest, value.max())
        trace.add(k + np.arange(137) / 137, value)
        assert len(trace) <= 1000
    _, value = trace.between(0.0, 100.0, 10_000)
    assert (value.min(), value.max()) == (least, greatest)
    assert trace.last[0] == 99 + 136 / 137
    assert len(trace.between(0.0, 100.0, 100)[0]) <= 204


def test_a_part_longer_than_the_trace() -> None:
    trace = Trace(capacity=100)
    trace.add(np.linspace(0, 1, 5000), np.arange(5000.0))
    assert len(trace) <= 100
    assert trace.last == (1.0, 4999.0)


def test_a_clock_that_begins_anew_begins_a_new_curve() -> None:
    trace = Trace()
    trace.add(np.array([5.0, 6.0]), np.zeros(2))
    trace.add(np.array([0.0]), np.ones(1))
    assert len(trace) == 1
