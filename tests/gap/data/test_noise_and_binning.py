"""Noise floors, grids, correlation, and the bins that thin a recording."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gap.data.binning import GROWTH, bin_edges, bin_means, breaks
from gap.data.noise import coarse_counts, correlation_time, denoised, grid_step, high_band_sigma, rounding_floor
from gap.data.session import Session

TIME = np.arange(0.0, 20.0, 0.01)
SLOW = 3e4 * (1 - np.exp(-TIME / 3.0))


def test_noise_is_read_under_a_slow_signal() -> None:
    noise = 70.0 * np.random.default_rng(1).normal(size=len(TIME))
    assert high_band_sigma(SLOW + noise) == pytest.approx(70.0, rel=0.08)


def test_steps_of_the_signal_do_not_count_as_noise() -> None:
    noise = 70.0 * np.random.default_rng(1).normal(size=len(TIME))
    steps = 3e4 * (np.floor(TIME / 2.0) % 2)
    assert high_band_sigma(steps + noise) == pytest.approx(70.0, rel=0.1)


def test_noise_is_never_below_that_of_the_grid() -> None:
    assert high_band_sigma(np.round(SLOW / 500) * 500) >= 500 / np.sqrt(12)


@pytest.mark.parametrize("noise", [0.5, 1.0, 3.0])
def test_noise_is_read_on_a_coarse_grid(noise: float) -> None:
    samples = np.round(SLOW / 1e3 + noise * np.random.default_rng(3).normal(size=len(TIME)))
    assert high_band_sigma(samples) == pytest.approx(np.hypot(noise, 1 / np.sqrt(12)), rel=0.12)


def test_levels_on_no_even_grid_still_make_noise() -> None:
    coarse = np.sqrt(np.round((SLOW / 1e3) ** 2 / 60))
    assert high_band_sigma(coarse) > 1e-3 * np.ptp(coarse)


@pytest.mark.parametrize("noise", [0.0, 0.2, 0.35])
def test_what_averaging_leaves_of_a_grid_is_bounded(noise: float) -> None:
    rng = np.random.default_rng(0)
    offsets = np.linspace(0, 1, 50)
    errors = [np.mean(np.round(x + noise * rng.normal(size=20000))) - x for x in offsets]
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(
        rounding_floor(float(np.hypot(noise, 1 / np.sqrt(12))), 1.0), rel=0.35, abs=5e-3
    )


def test_nothing_but_nan_or_a_constant_has_a_positive_sigma() -> None:
    assert high_band_sigma(np.full(100, np.nan)) > 0
    assert high_band_sigma(np.full(100, 5.0)) > 0


def test_a_grid_is_found_and_none_invented() -> None:
    assert grid_step(np.round(SLOW / 100) * 100) == pytest.approx(100)
    assert grid_step(SLOW + np.random.default_rng(0).normal(size=len(TIME))) == 0.0
    assert grid_step(np.array([1.0, 1.0, 2.0])) == 0.0


@pytest.mark.parametrize("noise", [0.0, 0.01, 0.05])
def test_coarse_counts_are_read_with_the_noise_on_top(noise: float) -> None:
    rng = np.random.default_rng(5)
    slow = 20 * np.sin(0.7 * TIME) + 0.2
    found = coarse_counts(np.round(slow) + noise * rng.normal(size=len(TIME)))
    assert found is not None
    assert found.step == pytest.approx(1.0, rel=0.02)
    assert found.sigma == pytest.approx(noise or 0.1, rel=0.15)
    assert found.levels == pytest.approx(np.arange(-20, 21), abs=0.3)


def test_ordinary_converters_and_staircases_are_not_coarse() -> None:
    rng = np.random.default_rng(6)
    slow = 40 * np.sin(0.7 * TIME)
    assert coarse_counts(np.round(slow + 0.6 * rng.normal(size=len(TIME)))) is None  # dithered
    assert coarse_counts(np.round(50 * slow) / 50) is None  # 4000 steps to the range
    assert coarse_counts(slow + 0.1 * rng.normal(size=len(TIME))) is None  # no steps
    assert coarse_counts(np.floor(TIME / 4) + 1e-3 * rng.normal(size=len(TIME))) is None  # five levels
    assert coarse_counts(np.full(1000, 3.0)) is None
    assert coarse_counts(np.arange(50.0)) is None


def test_correlation_time_of_white_and_lagged_noise() -> None:
    rng = np.random.default_rng(4)
    white = rng.normal(size=20000)
    assert correlation_time(white) == pytest.approx(1.0, abs=0.15)
    phi, lagged = 0.8, np.empty(20000)
    lagged[0] = 0.0
    for k in range(1, 20000):
        lagged[k] = phi * lagged[k - 1] + white[k]
    # 1 + 2 Σ φᵏ; the window that ends at 0.05 loses a little.
    assert correlation_time(lagged) == pytest.approx((1 + phi) / (1 - phi), rel=0.2)


def test_denoising_removes_noise_and_keeps_a_step() -> None:
    rng = np.random.default_rng(2)
    step = np.where(TIME > 10.0, 1000.0, 0.0)
    clean = denoised(TIME, step + 20 * rng.normal(size=len(TIME)))
    quiet = (TIME < 9) | (TIME > 11)
    assert np.std((clean - step)[quiet & (TIME > 1)]) < 8
    assert abs(clean[TIME > 10.1][0] - 1000) < 100


@settings(max_examples=30, deadline=None)
@given(st.lists(st.floats(0.0, 30.0), max_size=8), st.sampled_from([0.01, 0.04]))
def test_bins_cover_every_sample_once(kinks: list[float], dt: float) -> None:
    time = np.arange(0.0, 30.0, dt)
    edges = bin_edges(time[0], time[-1], np.array(kinks), dt)
    assert np.all(np.diff(edges) > 0)
    bins = bin_means(time, np.ones(len(time)), edges)
    assert bins.count.sum() == len(time)
    assert np.allclose(bins.value, 1.0)


def test_bins_are_narrow_after_a_kink_and_wide_later() -> None:
    edges = bin_edges(0.0, 20.0, np.array([5.0]), 0.01)
    width = np.diff(edges)
    after = edges[:-1] - 5.0
    assert width[(after >= 0) & (after < 0.05)].max() < 0.03
    assert width[(after > 10) & (after < 14)].min() > 0.2
    ordinary = (after > 0.5) & (after < 2)
    assert np.all(width[ordinary] <= GROWTH * after[ordinary] + 0.011)


def test_a_record_that_jumps_is_told_from_one_that_answers_a_step() -> None:
    time = np.arange(0.0, 20.0, 0.01)
    noise = np.random.default_rng(4).normal(size=time.size)
    answer = np.where(time > 3.0, 300.0 * -np.expm1(-(time - 3.0) / 0.05), 0.0)
    assert len(breaks(time, answer + noise, 1.0)) == 0
    found = breaks(time, answer + noise - 100.0 * (time > 7.1234), 1.0)
    assert found == pytest.approx([7.125], abs=0.006)
    still = breaks(time, np.zeros(time.size), 0.0)
    assert len(still) == 0


def test_bins_leave_out_what_is_not_a_number() -> None:
    time = np.arange(0.0, 1.0, 0.1)
    value = np.where(time == time[3], np.nan, time)
    bins = bin_means(time, value, np.array([0.0, 0.5, 1.0]))
    assert bins.count.tolist() == [4, 5]
    assert bins.value == pytest.approx([0.175, 0.7])
    assert bins.time == pytest.approx([0.175, 0.7])  # of the samples that count


def test_the_last_samples_before_a_kink_are_averaged_with_no_others() -> None:
    """Stamps that are 12 ms early show a step before its time; the mean of a hold must not."""
    kink, dt = 12.0, 0.01
    early = np.where(kink < TIME + 0.012, 0.0, 3e4)
    bins = bin_means(TIME, early, bin_edges(0.0, TIME[-1], np.array([kink]), dt))
    before = (bins.time < kink) & (bins.count > 1)
    assert bins.value[before] == pytest.approx(3e4)
    assert np.any((bins.time < kink) & (bins.value < 3e4))


@pytest.mark.parametrize(("stated", "white"), [(2e-6, 3.51e-6), (4e-6, 4e-6)])
def test_noise_that_is_stated_finer_than_its_rounding_is_the_sensors(recording, stated: float, white: float) -> None:
    """Of 2 µm on a grid of 10 µm, means of many samples were thought to be off by all of a grid's worst error."""
    value = np.round((1e-4 * TIME + 2e-6 * np.random.default_rng(0).normal(size=len(TIME))) / 1e-5) * 1e-5
    made = recording({"apex_height": value}, TIME, {})
    made = replace(made, streams={"apex_height": replace(made.streams["apex_height"], noise=stated)})
    sigma = Session([made]).sigma("apex_height", [0], np.zeros(0))
    assert sigma.white == pytest.approx(white, rel=0.01)
    assert sigma.grid < 1.2e-6
