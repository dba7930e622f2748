"""From raw robot values to channels."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.device import Refused
from drivers.microrobot import INSTRUMENT, forces, kinematics
from drivers.microrobot.processing import NAMES, Processing


def raw(axis: np.ndarray, force: np.ndarray, null: float = 0.01) -> np.ndarray:
    return np.column_stack([axis, forces.transducer_volts(force, forces.Calibration(null=null))])


def test_channels_are_those_of_the_descriptor() -> None:
    assert tuple(c.name for c in INSTRUMENT.channels) == NAMES


def test_raw_values_become_positions_and_tared_forces() -> None:
    rng = np.random.default_rng(1)
    axis, force = rng.uniform(-1e-3, 1e-3, (50, 3)), rng.uniform(0, 2, (50, 3))
    processing = Processing()
    processing.tare(raw(np.zeros((10, 3)), np.full((10, 3), 1.5)))
    out = processing(raw(axis, force + 1.5))
    tip = kinematics.forward(axis)
    pull = forces.reaction(force)
    for k, name in enumerate("xyz"):
        assert np.allclose(out[f"probe_{name}"], tip[:, k])
        assert np.allclose(out[f"force_{name}"], pull[:, k], atol=1e-12)
        assert np.allclose(out[f"transducer_force_{'abc'[k]}"], force[:, k], atol=1e-12)
        assert np.allclose(out[f"axis_position_{k + 1}"], axis[:, k])


def test_a_lab_may_have_its_own_matrix() -> None:
    out = Processing(list(range(9)))(raw(np.zeros((1, 3)), np.array([[1.0, 2.0, 3.0]]), null=0.0))
    assert [out[f"force_{k}"][0] for k in "xyz"] == pytest.approx([8.0, 26.0, 44.0])
    with pytest.raises(ValueError, match="nine finite numbers"):
        Processing([1.0, 2.0])


def test_no_tare_from_what_is_no_number() -> None:
    with pytest.raises(Refused, match="finite"):
        Processing().tare(np.full((5, 6), np.nan))
