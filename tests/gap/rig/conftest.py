"""Recordings of a spring."""

from __future__ import annotations

import numpy as np
import pytest

from tests.gap.rig.springs import TIME


@pytest.fixture
def stretched(recording):
    def make(change=lambda force, x, v: force, seed: int = 0):
        x = 0.1 * np.sin(2 * TIME) * np.exp(-0.1 * TIME)
        force = change(20.0 * x, x, np.gradient(x, TIME))
        noise = 5e-3 * np.random.default_rng(seed).normal(size=len(TIME))
        return recording({"force": force + noise, "extension": x}, TIME, instrument="spring", name=f"s{seed}")

    return make
