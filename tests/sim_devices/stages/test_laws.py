"""Laws that are a function of the signal at each moment."""

from __future__ import annotations

import numpy as np
import pytest

from sim_devices.stages import laws


def test_a_relief_valve_lets_through_nothing_below_its_knee_and_its_share_at_the_reference() -> None:
    u = -np.linspace(0.0, 40e3, 81)
    missing = laws.lifted(u, u, 0.05, 15e3, 1.4, 30e3) - u
    assert np.all(missing[u >= -15e3] == 0.0)
    assert missing[60] == pytest.approx(0.05 * 30e3)
    beyond = -u[u < -15e3] - 15e3
    np.testing.assert_allclose(missing[u < -15e3], 1500.0 * (beyond / 15e3) ** 1.4)
    np.testing.assert_allclose(laws.lifted(u, u, 0.05, 15e3, 1.0, 30e3), laws.bent(u, u, -0.1, 15e3), atol=1e-9)


def test_a_loop_over_a_gauge_that_warms_up_makes_its_reading_right() -> None:
    time, u = np.linspace(0.0, 400.0, 50), np.linspace(1e4, 4e4, 50)
    true = laws.without_gain_drift(time, u, 0.03, 150.0, 1.0)
    assert true[-1] == pytest.approx(u[-1] / (1.0 + 0.03 * (1.0 - np.exp(-400.0 / 150.0))))
    np.testing.assert_allclose(laws.gain_drift(time, true, 0.03, 150.0, 1.0), u, rtol=1e-12)
