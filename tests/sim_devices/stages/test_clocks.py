"""Clocks that warm up: how far they are off, and when what they show was true."""

from __future__ import annotations

import numpy as np
import pytest

from sim_devices.stages.operators import Warming

MARKS = (0.0, 200.0)


@pytest.mark.parametrize(("cold", "warm"), [(1.5e-4, 0.0), (0.0, 1.5e-4), (2e-4, -1e-4)])
def test_it_is_off_by_the_integral_of_its_rate_since_it_was_aligned(cold: float, warm: float) -> None:
    clock = Warming("warming", "timing", ("u",), ("y",), cold, warm, 120.0, MARKS)
    time = np.linspace(200.0, 400.0, 20001)
    rate = warm + (cold - warm) * np.exp(-time / 120.0)
    off = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(time))])
    np.testing.assert_allclose(time - clock.seen(time), off, atol=1e-9)
    assert clock.seen(np.array([200.0]))[0] == pytest.approx(200.0)  # anew with the second recording


def test_what_happens_shows_when_the_clock_comes_to_it() -> None:
    clock = Warming("warming", "timing", ("u",), ("y",), 3e-4, -1e-4, 60.0, MARKS)
    moments = np.array([1.0, 150.0, 201.0, 380.0])
    np.testing.assert_allclose(clock.seen(clock.shows(moments)), moments, atol=1e-9)
    assert clock.moves
    assert not Warming("warming", "timing", ("u",), ("y",)).moves
