"""Narrow effects are found from the residual: rhythms, looks at a command, clocks that wander, jumps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from gap.data.rhythms import humps, jumps, lines, looks, since_the_start, spells, wanderings
from gap.inference.hypothesis import Lateness


def moments(seed: int, n: int = 12) -> np.ndarray:
    return np.sort(np.random.default_rng(seed).uniform(0, 300, n))


def stepped(time: np.ndarray, late: np.ndarray, sd: float) -> Lateness:
    """Lateness of steps of a command."""
    return Lateness(time, late, np.full(len(time), sd), np.ones(len(time), dtype=bool))


def test_lines_of_a_residual_are_found() -> None:
    rng = np.random.default_rng(0)
    time = np.sort(rng.uniform(0, 200, 1500))
    residual = np.sin(2 * np.pi * 1.13 * time) + rng.normal(size=len(time))
    assert lines(time, residual, 0.15, 2.0)[0] == pytest.approx(1.13, abs=0.01)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 999), interval=st.floats(0.008, 0.2), phase=st.floats(0.0, 0.99))
@example(seed=690, interval=0.12158581149738976, phase=0.0)  # a part of which looks like a clock's skew
@example(seed=93, interval=0.2, phase=0.1875)  # without the skew that it looks like it spreads further than it is
def test_waits_for_the_next_look_are_explained(seed: int, interval: float, phase: float) -> None:
    """By some interval: with few commands another one may do as well."""
    time = moments(seed)
    wait = interval * np.mod(phase - time / interval, 1.0)
    late = wait + 2e-3 + np.random.default_rng(seed).normal(0, 2e-4, len(time))
    found = looks(stepped(time, late, 3e-4))
    if np.ptp(wait) > 0.5 * interval:
        assert found
        assert found[0][2] > 0.8


def test_the_interval_of_many_looks_is_found() -> None:
    time = moments(3, 24)
    late = 0.05 * np.mod(0.3 - time / 0.05, 1.0)
    interval, phase, share = looks(stepped(time, late, 1e-4))[0]
    assert interval == pytest.approx(0.05, rel=1e-4)
    assert share > 0.99
    waits = interval * np.mod(phase - time / interval, 1.0)
    np.testing.assert_allclose(waits, late, atol=1e-3)


def test_looks_by_clocks_that_begin_with_each_recording_are_found() -> None:
    """A host that begins to look anew with each recording has other phases on the session's clock; one of an outside
    author, which looked each 24 ms, was not told."""
    since, begins = moments(7, 40) / 10.0, np.repeat([3.0137, 51.2, 99.0071, 160.3003], 10)
    late = 0.024 * np.mod(0.3 - since / 0.024, 1.0)
    seen = stepped(begins + since, late, 1e-4)
    interval, phase, share = looks(replace(seen, since=since))[0]
    assert (interval, phase) == (pytest.approx(0.024, rel=1e-4), pytest.approx(0.3, abs=0.05))
    assert share > 0.99 > looks(seen)[0][2]


def test_ramps_are_late_by_the_mean_wait() -> None:
    """Between looks a ramp is a staircase, late by half an interval whenever it begins: only steps wait for a look."""
    time, steps = moments(4, 40), np.arange(40) % 4 == 0
    late = 0.04 * np.where(steps, np.mod(0.3 - time / 0.04, 1.0), 0.5)
    interval, _, share = looks(Lateness(time, late, np.full(40, 1e-4), steps))[0]
    assert interval == pytest.approx(0.04, rel=1e-4)
    assert share > 0.99


def test_a_rhythm_that_keeps_no_phase_is_a_hump() -> None:
    """A heart's rate that wanders by 5 % has no line, and a colour of noise no hump."""
    rng = np.random.default_rng(4)
    time = np.sort(rng.uniform(0.0, 150.0, 2000))
    piece = (time // 30.0).astype(np.int64)
    rate = 1.3 * (1.0 + 0.07 * np.sin(time / 7.0))
    beat = np.sin(2 * np.pi * np.cumsum(rate * np.gradient(time)))
    colour = np.convolve(rng.normal(size=2000), np.exp(-np.arange(60) / 12.0), "same")
    assert humps(time, piece, 0.7 * beat + 0.5 * colour + rng.normal(size=2000), 0.15, 2.0)[0] == pytest.approx(
        1.3, rel=0.1
    )


@pytest.mark.parametrize("late", [np.zeros(12), np.full(12, 0.04)])
def test_equal_lateness_asks_for_no_looks(late: np.ndarray) -> None:
    assert looks(stepped(moments(1), late, 1e-4)) == []


def test_a_wandering_clock_is_found() -> None:
    time = moments(5, 30)
    late = 4e-3 * np.sin(2 * np.pi * (time / 90.0 - 0.2)) + 1e-3
    period, phase, amplitude = wanderings(stepped(time, late, 3e-4), 15.0, 1500.0)[0]
    assert period == pytest.approx(90.0, rel=0.05)
    assert amplitude == pytest.approx(4e-3, rel=0.1)
    assert phase == pytest.approx(0.2, abs=0.1)


def test_jumps_within_a_recording_and_between_two_are_found() -> None:
    time = np.arange(300.0)
    recording = np.repeat([0, 1, 2], 100)
    residual = (
        np.random.default_rng(2).normal(size=300) + 5.0 * (time > 149.5) * (recording == 1) + 9.0 * (recording == 2)
    )
    inside, _, between = jumps(time, residual, recording)
    assert inside == pytest.approx(149.5, abs=1.0)
    assert between == pytest.approx(199.5)


def test_a_spell_is_found_with_its_end() -> None:
    time, recording = np.arange(0.0, 60.0, 0.2), np.repeat([0, 1], 150)
    residual = np.random.default_rng(1).normal(size=300)
    residual[100:130] += 4.0
    (moment, length), *_ = spells(time, residual, recording)
    assert moment == pytest.approx(19.9)
    assert length == pytest.approx(6.0)


def test_jumps_after_the_same_time_in_most_recordings_are_found() -> None:
    """One recording drifts instead, by more than the others jump."""
    rng, time, residual, recording = np.random.default_rng(3), [], [], []
    for k, begin in enumerate((5.0, 40.0, 75.0, 110.0)):
        own = np.arange(0.0, 20.0, 0.1)
        time.append(begin + own)
        residual.append(rng.normal(size=len(own)) + (own - 10.0 if k == 2 else 4.0 * (own > 6.4)))
        recording.append(np.full(len(own), k))
    found = since_the_start(*map(np.concatenate, (time, residual, recording)))
    assert found[0] == pytest.approx(6.4, abs=0.15)
