"""Noise that averaging keeps is read from rests and late holds, and no signal is taken for it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from gap.data.noise import long_run_share
from gap.data.session import Session
from gap.data.slow_noise import colour, no_jerks, slow_variance

TIME = np.arange(0.0, 20.0, 0.01)
KINKS = np.array([0.0, 2.0, 16.0, 20.0])


def forgetting(rng: np.random.Generator, share: float, tau: float) -> np.ndarray:
    """White noise of 1 with an AR(1) of rms ``share``."""
    rho = np.exp(-0.01 / tau)
    slow = lfilter([np.sqrt(1 - rho**2)], [1, -rho], rng.normal(size=len(TIME) + 2000))[2000:]
    return rng.normal(size=len(TIME)) + share * slow


@pytest.mark.parametrize(("share", "tau"), [(0.2, 0.5), (0.2, 1.0), (0.3, 1.0), (0.4, 0.3)])
def test_a_slow_share_of_the_noise_is_found(share: float, tau: float) -> None:
    found = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        runs = [(TIME, forgetting(rng, share, tau)) for _ in range(8)]
        found.append(np.sqrt(slow_variance(runs, KINKS, 1.0)))
    assert 0.4 * share < np.median(found) < 1.6 * share


def test_noise_that_doubles_from_block_to_block_is_noise() -> None:
    """At 500 Hz a share that forgets within 0.3 s grows by 1.7 from 0.2 s to 0.4 s: it was taken for a curve."""
    rate, share, tau = 500.0, 0.4, 0.3
    time = np.arange(0.0, 20.0, 1 / rate)
    rho = np.exp(-1 / rate / tau)
    found = []
    for seed in range(50010, 50016):
        rng = np.random.default_rng(seed)
        slow = lfilter([np.sqrt(1 - rho**2)], [1, -rho], rng.normal(size=(8, len(time) + 2000)))[:, 2000:]
        runs = [(time, rng.normal(size=len(time)) + share * s) for s in slow]
        found.append(np.sqrt(slow_variance(runs, KINKS, 1.0)))
    assert 0.65 * share < np.median(found) < 1.35 * share


def test_one_run_that_is_all_curve_is_not_taken_for_noise() -> None:
    """A sine without a kink among four runs: 0.4 of white noise of 1 were held for slow."""
    free = np.array([0.0, 20.0])
    found = []
    for seed in range(50030, 50034):
        rng = np.random.default_rng(seed)
        runs = [(TIME, rng.normal(size=len(TIME))) for _ in range(3)]
        sine = 200.0 * np.sin(2 * np.pi * 0.5 * TIME) + rng.normal(size=len(TIME))
        found.append(np.sqrt(slow_variance([*runs, (TIME, sine)], free, 1.0)))
    assert np.median(found) < 0.2


def test_of_white_noise_little_is_slow() -> None:
    found = [
        np.sqrt(
            slow_variance([(TIME, np.random.default_rng([s, k]).normal(size=len(TIME))) for k in range(8)], KINKS, 1.0)
        )
        for s in range(20)
    ]
    assert np.median(found) < 0.1


@pytest.mark.parametrize("signal", [
    200.0 * np.sin(2 * np.pi * 0.1 * TIME),
    np.where(TIME > 2, 100.0 * (1 - np.exp(-(TIME - 2) / 0.4)) + 30 * np.log1p(np.maximum(TIME - 2, 0) / 0.1), 0.0),
    np.interp(TIME, [0, 2, 9, 16], [0, 0, 300, 0]),
])  # fmt: skip
def test_what_is_smooth_is_no_noise(signal: np.ndarray) -> None:
    rng = np.random.default_rng(2)
    kinks = np.array([0.0, 2.0, 9.0, 16.0, 20.0])
    runs = [(TIME, signal + rng.normal(size=len(TIME))) for _ in range(6)]
    assert np.sqrt(slow_variance(runs, kinks, 1.0)) < 0.35


def test_bins_of_a_sensor_with_slow_noise_count_as_they_scatter(recording) -> None:
    """Taken as white, a sound session of such a sensor has a gap of 1.3 and more: unknown."""
    rng = np.random.default_rng(1)
    held = {"pressure": ([0, 2, 2, 16, 16], [0, 0, 1, 1, 0])}
    made = [recording({"pressure": forgetting(rng, 0.25, 1.0)}, TIME + 30 * k, held) for k in range(8)]
    session = Session(made)
    kinks = np.concatenate([KINKS + 30 * k for k in range(8)])
    noise = session.sigma("pressure", range(8), kinks)
    white, hard = noise.white, noise.kept
    bins = [session.binned("pressure", k, kinks) for k in range(8)]
    wide = np.concatenate([b.value[b.count > 15] / np.sqrt(white**2 / b.count[b.count > 15] + hard**2) for b in bins])
    assert 0.8 < np.sqrt(np.mean(wide**2)) < 1.2
    naive = np.concatenate([b.value[b.count > 15] / (white / np.sqrt(b.count[b.count > 15])) for b in bins])
    assert np.sqrt(np.mean(naive**2)) > 1.3


def test_a_faint_correlation_over_many_samples_counts() -> None:
    """Noise that is cut off at a correlation of .05 sample by sample makes sums of 16 twice as uncertain."""
    rng = np.random.default_rng(0)
    slow = [0.25 * np.repeat(rng.normal(size=10), 32) for _ in range(9)]
    assert long_run_share([rng.normal(size=320) + v for v in slow]) > 1.8
    assert long_run_share([rng.normal(size=320) for _ in range(9)]) < 1.15


def test_an_axis_that_sticks_and_slips_is_no_noisier_than_the_others() -> None:
    seen = [(1.0, 0.35), (1.0, 0.4), (1.0, 1.4)]
    assert no_jerks(seen)[2] == pytest.approx(0.8)
    assert no_jerks(seen)[:2] == [0.35, 0.4]
    assert no_jerks(seen[2:]) == [1.4]  # by itself nothing tells


def test_what_shakes_a_channel_in_motion_alone_is_no_noise() -> None:
    """A command that was looked at every 200 ms in ramps had made 350 Pa of slow noise of a gauge's 30."""
    rng = np.random.default_rng(5)
    noise = forgetting(rng, 0.3, 0.5)
    stairs = 20.0 * np.floor(np.clip(TIME - 2.0, 0.0, 7.0) / 0.2)
    assert slow_variance([(TIME, noise + stairs)], np.array([0.0, 2.0, 9.0, 20.0]), 1.0) < 0.3
    everywhere = 20.0 * np.floor(TIME / 0.2)  # no rest is there to tell
    assert slow_variance([(TIME, noise + everywhere)], KINKS, 1.0) > 1.0


def means(noise: np.ndarray, size: int) -> np.ndarray:
    return noise[: len(noise) // size * size].reshape(-1, size).mean(axis=1)


@pytest.mark.parametrize(("share", "rho"), [(0.0, 0.0), (0.45, 0.8), (0.8, 0.6)])
def test_noise_that_forgets_within_some_samples_averages_more_slowly(share: float, rho: float) -> None:
    """Of an axis at 400 Hz, bins of twelve samples were taken for 1.6 times less noisy than they are: a sound session
    was told a latency by 10 sigma."""
    rng, rate = np.random.default_rng(7), 400.0
    time = np.arange(0.0, 20.0, 1.0 / rate)
    runs = []
    for _ in range(4):
        slow = lfilter([np.sqrt(1 - rho**2)], [1, -rho], rng.normal(size=len(time) + 500))[500:]
        runs.append((time, rng.normal(size=len(time)) + share * slow))
    quick = colour(runs, KINKS, 1.0)
    for size in (5, 12, 20, 80):
        variance = float(np.var(np.concatenate([means(v, size) for _, v in runs]))) * size
        assert 0.65 * variance < float(quick.of_mean(np.array(float(size)))) < 1.3 * max(variance, 1.0)
