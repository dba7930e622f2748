"""Kinds of commands, as a human would call them."""

from __future__ import annotations

import numpy as np
import pytest

from gap.data.splits import splits
from gap.data.waveform import waveform

TIME = np.arange(0.0, 60.0, 0.02)
CORNERS = 2.5 * np.arange(25)


def sines(*parts: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    return TIME, sum(1e-3 * a * np.sin(2 * np.pi * f * TIME + 9 * f) for a, f in parts)


TRIANGLE = CORNERS, 1e-3 * np.array([0, 1, 0, -1] * 6 + [0])
MULTISINE = sines((1.0, 0.1), (0.8, 0.23), (0.5, 0.37))


@pytest.mark.parametrize(
    ("commands", "kind"),
    [
        ({"probe_x": TRIANGLE}, "ramp, cyclic"),
        ({"probe_x": TRIANGLE, "probe_y": (CORNERS, 0.5 * TRIANGLE[1])}, "ramp, cyclic"),  # askew
        ({"probe_x": MULTISINE}, "multisine"),
        ({"probe_x": sines((1.0, 0.05))}, "sine"),
        ({"probe_x": sines((1.0, 0.1)), "probe_y": (TIME, 1e-3 * np.cos(0.2 * np.pi * TIME + 0.9))}, "path"),
        ({"pressure": ([0, 1, 1, 5, 5, 9, 9, 20], [0, 0, -1e4, -1e4, -2e4, -2e4, 0, 0])}, "staircase"),
        ({"pressure": ([0, 1, 1, 9, 9, 20], [0, 0, -1e4, -1e4, 0, 0])}, "step"),
        ({"pressure": ([0, 20], [0, 0])}, "-"),
    ],
)
def test_the_kind_of_a_command(recording, commands, kind: str) -> None:
    assert waveform(recording({"force_x": 0 * TIME}, TIME, commands, "microrobot")) == kind


def test_a_sum_of_sines_is_withheld_from_triangles(recording) -> None:
    """Both go to and fro along one axis and were called the same: no robot session had another waveform."""
    commands = (TRIANGLE, TRIANGLE, MULTISINE)
    runs = [recording({"force_x": 0 * TIME}, TIME, {"probe_x": c}, "microrobot") for c in commands]
    assert splits(runs)["waveform"] == {2}
