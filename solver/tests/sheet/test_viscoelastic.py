"""Relaxation and creep of the reduced relaxation function against closed forms and differences."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from skinrig_solver.sheet.viscoelastic import Prony


def test_ramp_and_hold_relaxes_in_closed_form() -> None:
    g, tau, rise = 0.4, 0.8, 2.0
    time = np.concatenate([np.linspace(0.0, rise, 23), np.linspace(2.1, 9.0, 31)])
    elastic = np.minimum(time / rise, 1.0)[:, None] * np.array([3.0, -1.0])
    memory = tau / rise * (np.exp(-np.maximum(time - rise, 0.0) / tau) - np.exp(-time / tau))
    expected = (1.0 - g) * elastic + g * memory[:, None] * np.array([3.0, -1.0])
    assert_allclose(Prony((g,), (tau,)).relax(time, elastic), expected, rtol=1e-12)


def test_terms_add_and_zero_amplitudes_do_nothing() -> None:
    time = np.linspace(0.0, 5.0, 60)
    elastic = np.sin(time)[:, None]
    both = Prony((0.2, 0.3), (0.5, 4.0)).relax(time, elastic)
    single = [Prony((g,), (tau,)).relax(time, elastic) - elastic for g, tau in ((0.2, 0.5), (0.3, 4.0))]
    assert_allclose(both, elastic + single[0] + single[1], atol=1e-14)
    assert_allclose(Prony((0.0,), (1.0,)).relax(time, elastic), elastic)


def test_derivatives_match_differences() -> None:
    time = np.sort(np.random.default_rng(1).uniform(0.0, 8.0, 80))
    elastic = np.stack([np.sin(time), time**2], axis=1)
    at = np.array([0.3, 0.7, 0.2, 5.0])
    slopes = Prony((at[0], at[2]), (at[1], at[3])).relax_derivatives(time, elastic)
    _, creep = Prony((at[0], at[2]), (at[1], at[3])).creep_factor(5.0)
    for k in range(4):
        up, down = at.copy(), at.copy()
        up[k] += 1e-6
        down[k] -= 1e-6
        high, low = (Prony((x[0], x[2]), (x[1], x[3])) for x in (up, down))
        assert_allclose((high.relax(time, elastic) - low.relax(time, elastic)) / 2e-6, slopes[k], atol=2e-8)
        assert (high.creep_factor(5.0)[0] - low.creep_factor(5.0)[0]) / 2e-6 == pytest.approx(creep[k], rel=1e-6)


def test_creep_under_a_ramp_in_closed_form() -> None:
    g, tau, ramp = 0.4, 0.8, 5.0
    rate = (1.0 - g) / tau  # of retardation; T_e / T from the Laplace transform
    expected = (ramp / (1.0 - g) + (1.0 - 1.0 / (1.0 - g)) * -np.expm1(-rate * ramp) / rate) / ramp
    assert Prony((g,), (tau,)).creep_factor(ramp)[0] == pytest.approx(expected, rel=1e-5)
    assert Prony((g,), (tau,)).creep_factor(0.0)[0] == 1.0
    assert Prony((0.0,), (tau,)).creep_factor(ramp)[0] == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize(("g", "tau"), [((0.6, 0.5), (1.0, 2.0)), ((-0.1,), (1.0,)), ((0.1,), (0.0,)), ((0.1,), ())])
def test_impossible_relaxation_is_refused(g: tuple[float, ...], tau: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match="relaxation"):
        Prony(g, tau)
