"""Rows of noise that a sensor remembers in part."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gap.data.innovations import NOTHING, Rhythm, RowNoise, Wider

SLOW, TAU = 0.3, 1.5


def stamps(rng: np.random.Generator, n: int = 300) -> tuple[np.ndarray, np.ndarray]:
    """Uneven times, s, of three recordings, and which each belongs to."""
    time = np.cumsum(rng.exponential(0.15, n))
    recording = np.repeat([0, 2, 5], n // 3)
    return time + 10.0 * recording, recording


def covariance(time: np.ndarray, recording: np.ndarray, slow: float, tau: float) -> np.ndarray:
    """Of an Ornstein-Uhlenbeck process that begins anew with each recording."""
    same = recording[:, None] == recording[None, :]
    return same * slow**2 * np.exp(-np.abs(time[:, None] - time[None, :]) / tau)


def drawn(rng: np.random.Generator, channels: int = 3, slow: float = SLOW) -> tuple[np.ndarray, ...]:
    """Times, recordings, new variance (channels, n) and one draw (channels, n) of white and slow noise."""
    time, recording = stamps(rng)
    new = rng.uniform(0.02, 1.0, (channels, len(time)))
    root = np.linalg.cholesky(covariance(time, recording, slow, TAU) + 1e-12 * np.eye(len(time)))
    return time, recording, new, np.sqrt(new) * rng.normal(size=new.shape) + rng.normal(size=new.shape) @ root.T


def remembering(rng: np.random.Generator) -> tuple[RowNoise, tuple[np.ndarray, ...]]:
    time, recording, new, rest = drawn(rng)
    noise = RowNoise(time, recording, new)
    noise.remember(rest.ravel(), [1.0, 1.0, 1.0])
    return noise, (time, recording, new, rest)


def test_innovations_are_the_whitening_by_the_covariance() -> None:
    """L⁻¹ x, with L the Cholesky factor of the whole covariance of a channel."""
    rng = np.random.default_rng(0)
    noise, (time, recording, new, rest) = remembering(rng)
    assert noise.memory is not None
    slow, tau = noise.memory
    for k in range(3):
        full = np.diag(new[k]) + covariance(time, recording, float(slow[k]), float(tau[k]))
        expected = np.linalg.solve(np.linalg.cholesky(full), rest[k])
        found = noise.whitened(rest.ravel()).reshape(rest.shape)[k]
        assert found == pytest.approx(expected, abs=1e-8)
        assert np.sum(np.log(noise.sd().reshape(rest.shape)[k])) == pytest.approx(0.5 * np.linalg.slogdet(full)[1])


def test_a_random_walk_is_whitened_by_its_covariance() -> None:
    """Cov(W(s), W(t)) = q min(s, t) within a recording, beside slow noise or none, at another rate in some rows."""
    rng = np.random.default_rng(2)
    noise, (time, recording, new, rest) = remembering(rng)
    plain = RowNoise(time, recording, new)
    rate = np.where(rng.uniform(size=new.shape) < 0.5, 0.4, 0.0)
    for rows in (noise, plain):
        slow, taus = rows.memory if rows.memory is not None else (np.zeros(3), np.ones(3))
        for k in range(3):
            first = np.r_[True, np.diff(recording) != 0]
            steps = np.where(first, 0.0, np.diff(time, prepend=time[0]) * rate[k] ** 2)
            variance = np.cumsum(steps)
            variance -= np.repeat(variance[first], np.diff(np.r_[np.flatnonzero(first), len(time)]))
            same = recording[:, None] == recording[None, :]
            full = np.diag(new[k]) + same * np.minimum(variance[:, None], variance[None, :])
            full += covariance(time, recording, float(slow[k]), float(taus[k]))
            expected = np.linalg.solve(np.linalg.cholesky(full), rest[k])
            found = rows.whitened(rest.ravel(), Wider(walks=rate)).reshape(rest.shape)[k]
            assert found == pytest.approx(expected, abs=1e-8)
            sd = rows.sd(Wider(walks=rate)).reshape(rest.shape)[k]
            assert np.sum(np.log(sd)) == pytest.approx(0.5 * np.linalg.slogdet(full)[1])


def test_a_rhythm_that_wanders_is_whitened_by_its_covariance() -> None:
    """r² exp(-|s - t| / T) cos 2 pi f (s - t) within a recording, each row its mean over its own time."""
    rng = np.random.default_rng(3)
    noise, (time, recording, new, rest) = remembering(rng)
    assert noise.memory is not None
    beats = Wider(rhythm=Rhythm(1.1, 2.5, np.array([0.3, 0.7, 0.0])))
    same = recording[:, None] == recording[None, :]
    apart = np.where(same, time[:, None] - time[None, :], 0.0)
    steps = np.where(np.diff(recording) == 0, np.diff(time), np.inf)
    mean = np.sinc(1.1 * np.minimum(np.r_[np.inf, steps], np.r_[steps, np.inf]))
    for k, (rms, slow, tau) in enumerate(zip((0.3, 0.7, 0.0), *noise.memory, strict=True)):
        beat = rms**2 * np.exp(-np.abs(apart) / 2.5) * np.cos(2 * np.pi * 1.1 * apart) * np.outer(mean, mean)
        full = np.diag(new[k]) + covariance(time, recording, float(slow), float(tau)) + same * beat
        expected = np.linalg.solve(np.linalg.cholesky(full), rest[k])
        white = noise.whitened(rest.ravel(), beats)
        assert white.reshape(rest.shape)[k] == pytest.approx(expected, abs=1e-8)
        assert noise.unwhitened(white, beats) == pytest.approx(rest.ravel())


def test_slow_noise_is_found_and_its_innovations_are_white() -> None:
    noise, (_, _, new, rest) = remembering(np.random.default_rng(1))
    white = noise.whitened(rest.ravel()).reshape(rest.shape)
    assert np.mean(white**2) == pytest.approx(1.0, abs=0.1)
    assert np.mean(white[:, 1:] * white[:, :-1]) == pytest.approx(0.0, abs=0.07)
    rows = rest / np.sqrt(new)
    assert np.mean(rows**2) > 1.3
    assert noise.memory is not None
    assert noise.memory[0] == pytest.approx(3 * [SLOW], abs=0.15)


def test_white_noise_has_no_slow_part() -> None:
    rng = np.random.default_rng(2)
    time, recording, new, _ = drawn(rng)
    noise = RowNoise(time, recording, new, [0.1, 0.1, 0.1])
    before = noise.sigma
    rest = np.sqrt(new) * rng.normal(size=new.shape)
    noise.remember(rest.ravel(), [1.0, 1.0, 1.0])
    assert np.array_equal(noise.sigma, before)
    assert noise.whitened(rest.ravel()) == pytest.approx(rest.ravel() / before)


def test_a_channel_that_misfits_does_not_tell_for_the_others() -> None:
    rng = np.random.default_rng(3)
    time, recording, new, _ = drawn(rng)
    rest = np.sqrt(new) * rng.normal(size=new.shape)
    rest[1] += 0.4 * np.sign(np.sin(time))
    noise = RowNoise(time, recording, new)
    noise.remember(rest.ravel(), [1.0, 1.0, 1.0])
    assert noise.sigma == pytest.approx(np.sqrt(new).ravel())


def test_an_event_is_no_slow_noise() -> None:
    """Nine seconds of a leak in one of five recordings were taken for it, and were not seen any more."""
    rng = np.random.default_rng(7)
    time = np.concatenate([60.0 * k + np.arange(0.0, 40.0, 0.2) for k in range(5)])
    recording = np.repeat(np.arange(5), 200)
    root = np.linalg.cholesky(covariance(time, recording, 0.15, 0.4) + 1e-12 * np.eye(len(time)))
    rest = 0.3 * rng.normal(size=len(time)) + root @ rng.normal(size=len(time))
    quiet, noise = (RowNoise(time, recording, np.full((1, len(time)), 0.09)) for _ in range(2))
    quiet.remember(rest, [1.0])
    noise.remember(rest + 1.0 * ((time > 130.0) & (time < 139.0)), [1.0])
    assert quiet.memory is not None
    assert noise.memory is not None
    assert noise.memory[0] == pytest.approx(quiet.memory[0], abs=0.05)
    assert noise.memory[0] == pytest.approx([0.15], abs=0.06)


def test_a_misfit_beyond_what_sensors_have_is_no_noise() -> None:
    rng = np.random.default_rng(4)
    time, recording, new, rest = drawn(rng)
    noise = RowNoise(time, recording, new)
    noise.remember((rest + 2.0 * np.sign(np.sin(time))).ravel(), [1.0, 1.0, 1.0])
    assert noise.memory is None
    assert noise.sigma == pytest.approx(np.sqrt(new).ravel())


@settings(deadline=None)
@given(st.integers(0, 1000), st.booleans(), st.booleans())
def test_a_residual_leads_back_to_its_difference(seed: int, slow: bool, wider: bool) -> None:
    rng = np.random.default_rng(seed)
    time, recording, new, rest = drawn(rng, slow=0.6 if slow else 0.0)
    noise = RowNoise(time, recording, new, [0.2, 0.1, 0.3])
    noise.remember(rest.ravel(), [1.0, 1.0, 1.0])
    added = Wider(rng.uniform(0, 1, new.size), rng.uniform(0, 1, new.shape)) if wider else NOTHING
    difference = rng.normal(size=new.size)
    assert noise.unwhitened(noise.whitened(difference, added), added) == pytest.approx(difference)
    columns = rng.normal(size=(new.size, 4))
    together = noise.whitened(columns, added)
    assert together[:, 2] == pytest.approx(noise.whitened(columns[:, 2].copy(), added))


def test_some_rows_tell_the_slow_noise_of_all() -> None:
    """A membrane's misfit is none of the sensor's noise, which a solid block shows; the skin's sensor is the same."""
    rng = np.random.default_rng(1)
    time, recording, new, rest = drawn(rng, channels=1)
    rest[:, recording != 0] += 3.0 * np.sin(time[recording != 0])
    noise, others = RowNoise(time, recording, new), RowNoise(time[:50], recording[:50], new[:, :50], [0.1])
    noise.remember(rest.ravel(), [1.0])
    assert noise.memory is None
    noise.remember(rest.ravel(), [1.0], among=recording == 0)
    assert noise.memory is not None
    assert noise.memory[0] == pytest.approx([SLOW], abs=0.2)
    others.alike(noise)
    assert others.memory == noise.memory
    others.alike(RowNoise(time, recording, new))  # that knows nothing of it
    assert others.memory == noise.memory


def test_rows_are_blurred_and_widened() -> None:
    noise = RowNoise(np.arange(3.0), np.zeros(3, np.int64), np.full((1, 3), 9.0), [4.0])
    assert noise.sigma == pytest.approx([5.0, 5.0, 5.0])
    noise.widen(np.array([1]), 10.0)
    assert noise.sigma == pytest.approx([5.0, 50.0, 5.0])
    noise.blur(np.array([12.0, 0.0, 0.0]))
    assert noise.sigma == pytest.approx([13.0, 50.0, 5.0])
    assert noise.sd(Wider(np.array([0.0, 0.0, 11.0]))) == pytest.approx([13.0, 50.0, 6.0])
