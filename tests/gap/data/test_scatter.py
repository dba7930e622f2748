"""Which law chance has, from residuals where a signal is steep."""

from __future__ import annotations

import numpy as np
import pytest

from gap.data.scatter import timing_log_bayes

RNG = np.random.default_rng(5)
REACH = RNG.normal(0.0, 3000.0, 120)
LATE = RNG.random(120) < 0.1


@pytest.mark.parametrize("instants", [RNG.normal(0, 3e-3, 120), RNG.uniform(-5e-3, 5e-3, 120)])
def test_instants_that_scatter_all_alike_are_unlike_late_ones(instants: np.ndarray) -> None:
    residual = RNG.normal(size=120) + REACH * instants
    assert timing_log_bayes(residual, REACH, float(np.std(instants)), sparse=False) == 0.0
    assert timing_log_bayes(residual, REACH, float(np.std(instants)), sparse=True) > 20.0


@pytest.mark.parametrize("late", [np.full(120, 0.01), RNG.exponential(0.02, 120)])
@pytest.mark.parametrize("taken", [0.0, 1.0])
def test_some_old_samples_are_unlike_jitter_whatever_of_the_mean_is_taken_on(late: np.ndarray, taken: float) -> None:
    instants = -late * LATE
    residual = RNG.normal(size=120) + REACH * (instants - taken * instants.mean())
    assert timing_log_bayes(residual, REACH, float(np.std(instants)), sparse=True) == 0.0
    assert timing_log_bayes(residual, REACH, float(np.std(instants)), sparse=False) > 20.0


def test_samples_that_come_early_are_not_late_ones() -> None:
    residual = RNG.normal(size=120) + REACH * 0.01 * LATE
    late = RNG.normal(size=120) - REACH * 0.01 * LATE
    rms = float(np.std(0.01 * LATE))
    assert timing_log_bayes(late, REACH, rms, sparse=False) > 2.0 * timing_log_bayes(residual, REACH, rms, sparse=False)


def test_what_does_not_show_has_no_law() -> None:
    residual = RNG.normal(size=120)
    assert (
        timing_log_bayes(residual, REACH, 1e-6, sparse=True)
        == timing_log_bayes(residual, REACH, 1e-6, sparse=False)
        == 0.0
    )
