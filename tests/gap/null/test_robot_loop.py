"""The loops that the robot's axes may soundly have: those that recordings state."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from acquire.recording.model import AXIS_LOOP
from gap.null.robot_loop import CONTROLLERS, TunedLoop, controllers, stated
from sim_devices.stages import nominal


def test_a_recording_may_state_its_controller() -> None:
    assert controllers({"opening": {"value": 2e-3, "unit": "m"}}) is CONTROLLERS
    values = {"loop_proportional": 3e3, "loop_integral": 5.5e4, "loop_derivative": 18.0, "axis_mass": 0.05}
    said = {name: {"value": value, "unit": AXIS_LOOP[name]} for name, value in values.items()}
    two = controllers(said)
    assert [(c.proportional, c.derivative, c.mass, c.on_error) for c in two] == [
        (3e3, 18.0, 0.05, False),
        (3e3, 18.0, 0.05, True),
    ]
    loop = two[0].installed(nominal("microrobot"), np.ones(3))["axes"]
    assert isinstance(loop, TunedLoop)
    assert (loop.mass, loop.gains) == (0.05, (3e3, 5.5e4, 18.0))


def test_a_loop_without_an_integral_may_be_stated() -> None:
    values = {"loop_proportional": 3e3, "loop_integral": 0, "loop_derivative": 18.0, "axis_mass": 0.05}
    pd, _ = controllers({name: {"value": value, "unit": AXIS_LOOP[name]} for name, value in values.items()})
    assert pd.integral / pd.proportional < 1e-5  # 1/s


def test_recordings_of_a_session_have_one_controller(recording) -> None:
    said = {name: {"value": 1.0, "unit": unit} for name, unit in AXIS_LOOP.items()}
    made = [recording({"probe_x": np.zeros(9)}, np.arange(9.0), name=f"r{k}") for k in range(3)]
    silent, one, other = (
        replace(r, info=replace(r.info, calibration=its))
        for r, its in zip(made, ({}, said, said | {"axis_mass": {"value": 2.0, "unit": "kg"}}), strict=True)
    )
    assert stated([silent]) == {}
    assert stated([silent, one, one]) == said
    with pytest.raises(ValueError, match="recordings r1 and r2 of one session state different controllers"):
        stated([silent, one, other])


@pytest.mark.parametrize(
    ("said", "message"),
    [
        (
            {"axis_mass": {"value": 0.05, "unit": "kg"}},
            "needs loop_proportional, loop_integral, loop_derivative besides",
        ),
        ({n: {"value": 1.0, "unit": "N/m"} for n in AXIS_LOOP}, "loop_integral is 1.0 'N/m', not a positive number"),
        ({n: {"value": 0, "unit": u} for n, u in AXIS_LOOP.items()}, "loop_proportional is 0"),
        ({n: {"value": -1.0, "unit": u} for n, u in AXIS_LOOP.items()}, "loop_proportional is -1.0"),
        ({n: {"value": "3", "unit": u} for n, u in AXIS_LOOP.items()}, "loop_proportional is '3'"),
    ],
)
def test_half_a_controller_is_refused(said: dict[str, dict[str, object]], message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        controllers(said)
