"""When a recording begins: with its command, where that has rows shortly before the first sample."""

from __future__ import annotations

import numpy as np
import pytest

from gap.data.session import BEFORE, Session


@pytest.mark.parametrize(
    ("asked", "begins"),
    [(2.973, 2.973), (2.99, 2.98), (0.0, 2.98), (3.4, 2.98)],
    ids=["just before", "with a later sample", "long before", "after"],
)
def test_a_recording_begins_with_its_command(recording, asked: float, begins: float) -> None:
    """Looks at a command that begin with each recording were 0 to 5 ms off in each, as its first sample is."""
    time = 2.98 + 0.01 * np.arange(200)
    command = np.array([asked, 6.0]), np.array([0.0, -3e4])
    made = recording({"pressure": np.zeros(200)}, time, {"pressure": command})
    session = Session([made])
    assert session.begin(0) - session.shifts[0] == pytest.approx(begins - BEFORE, abs=1e-12)
