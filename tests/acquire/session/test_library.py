"""Every protocol of the library runs to its end on simulated instruments, and what was commanded is what was done."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from acquire.engine import State
from acquire.recording import Series, open_recording
from acquire.session import Session
from protocols import compile_protocol, library, load

GRID = 0.002  # s
TAU = 0.040  # s: the simulated regulator is of second order, critically damped
PRESSURE_NOISE = 300.0  # Pa: gauge noise of 40 Pa rms and the command's resolution of 100 Pa
TIP_ERROR = 60e-6  # m: position noise and the servo's lag at 1 mm/s; the claimed resolution is 50 um


@pytest.mark.parametrize("name", list(library()))
def test_a_protocol_of_the_library(skinrig_session: Callable[..., Session], name: str) -> None:
    path = library()[name]
    protocol = load(path)
    session = skinrig_session(speed=2000, seed=1, frame_size=(64, 48))
    outcome = session.run(path)
    assert (outcome.status, outcome.reason, outcome.lost) == (State.COMPLETED, "", 0)
    assert outcome.recording is not None
    recording = open_recording(outcome.recording)
    setpoints = compile_protocol(protocol, session.limits(protocol.instrument))
    for quantity, commanded in recording.setpoints.items():
        measured = recording.streams[quantity]
        assert commanded.unit == measured.unit
        _compare(commanded, measured, quantity)
        whole = commanded.time[-1] - commanded.time[0]
        assert setpoints.duration <= whole + 1e-6
        compiled = setpoints.table()[1][quantity]
        assert commanded.value.min() == pytest.approx(compiled.min())
        assert commanded.value.max() == pytest.approx(compiled.max())


def _compare(commanded: Series, measured: Series, quantity: str) -> None:
    if quantity != "pressure":
        due = np.interp(measured.time, commanded.time, commanded.value)
        assert np.abs(measured.value - due).max() < TIP_ERROR
        return
    grid = np.arange(measured.time[0] - 1.0, measured.time[-1], GRID)
    last = np.searchsorted(commanded.time, grid, side="right") - 1  # of two points at a step, the later one
    ahead = np.minimum(last + 1, len(commanded.time) - 1)
    length = np.maximum(commanded.time[ahead] - commanded.time[last], GRID)
    part = np.clip((grid - commanded.time[last]) / length, 0, 1)
    asked = commanded.value[last] + part * (commanded.value[ahead] - commanded.value[last])
    numerator, denominator, _ = cont2discrete(([1.0], [TAU**2, 2 * TAU, 1.0]), GRID, "foh")
    due = np.interp(measured.time, grid, lfilter(numerator[0], denominator, np.where(last < 0, 0.0, asked)))
    # A step is off the grid by at most one of its intervals.
    slack = np.ptp(commanded.value) * GRID / TAU / np.e
    assert np.abs(measured.value - due).max() < PRESSURE_NOISE + slack
