"""Forms of effects follow the equations that their parameters say."""

from __future__ import annotations

import numpy as np
import pytest

from sim_devices.effects import effects
from sim_devices.effects.build import PRESSURE
from tests.sim_devices.effects.test_effects import reference, session


def test_a_height_that_follows_flow_forgets_it_within_its_time() -> None:
    """As of a chamber's air, which cools as it expands: the reading is off by a share of q - L_τ[q]."""
    time, inputs, chain = session("cutometer")
    cools = {"form": 1, "amount": 1e-5, "tau": 0.4}
    height = effects("cutometer")["crosstalk"].apply(chain, cools).run(time, inputs)["apex_height"]
    off = height - reference("cutometer")["apex_height"]
    at = np.interp([1.5, 2.3, 3.1], time, off)  # behind a step at 1 s, which the regulator has done
    assert at[0] > 5e-7
    assert at[1:] / at[:-1] == pytest.approx(np.exp(-0.8 / 0.4), rel=0.02)


def test_a_gauge_whose_error_grows_with_suction() -> None:
    time, inputs, chain = session("cutometer")
    bent = {"form": 4, "error": -0.02, "power": 2.0}
    read = effects("cutometer")["gauge_gain"].apply(chain, bent).run(time, inputs)
    true = reference("cutometer")["pressure"]
    np.testing.assert_allclose(read["pressure"], true * (1.0 - 0.02 * (true / PRESSURE) ** 2), rtol=1e-9)
    np.testing.assert_array_equal(read["apex_height"], reference("cutometer")["apex_height"])


def test_a_gauge_that_closes_the_loop_reads_as_it_should_whatever_its_bend() -> None:
    """The loop holds the reading where it is asked for, and the skin feels another pressure."""
    time, inputs, chain = session("cutometer")
    bent = {"form": 5, "error": 0.05, "power": 0.3}
    made = effects("cutometer")["gauge_gain"].apply(chain, bent).run(time, inputs)
    sound = reference("cutometer")
    np.testing.assert_allclose(made["pressure"], sound["pressure"], rtol=1e-9, atol=1e-6)
    deep = np.argmin(made["line_pressure"])
    times = 1.0 + 0.05 * (-made["line_pressure"][deep] / PRESSURE) ** 0.3
    assert made["pressure"][deep] / made["line_pressure"][deep] == pytest.approx(times, rel=1e-9)
    assert np.max(made["apex_height"]) < 0.99 * np.max(sound["apex_height"])


def test_a_second_harmonic_makes_a_beat_rise_faster_than_it_falls() -> None:
    time, inputs, chain = session("cutometer")
    pulse = effects("cutometer")["pulse_breathing"]
    rhythm = {"amplitude": 2e-5, "frequency": 0.5, "phase": 0.0}
    plain, beating = (
        pulse.apply(chain, rhythm | {"second_sine": share, "second_cosine": 0.0}).run(time, inputs)["apex_height"]
        for share in (0.0, 0.4)
    )
    at = time > 1.5
    off = (beating - plain)[at] - np.mean((beating - plain)[at])
    turn = 2 * np.pi * time[at]
    assert off @ np.sin(turn) / np.linalg.norm(off) / np.linalg.norm(np.sin(turn)) > 0.9
    assert np.max(np.abs(off)) == pytest.approx(0.4 * 2e-5, rel=0.2)


NOISE = {f"axis_position_{k}": 8e-6 for k in (1, 2, 3)} | {f"transducer_force_{k}": 1.5e-3 for k in "abc"}
"""m and N: noise (rms) of the robot's sensors."""


@pytest.mark.parametrize(
    "name",
    ["slew_limit", "viscous_drag", "coulomb_friction", "backlash", "latency", "glue_compliance",
     "sensor_hysteresis", "sensor_low_pass", "pulse_breathing"],
)  # fmt: skip
def test_the_weakest_strength_of_an_instruments_effect_hardly_shows(name: str) -> None:
    """A planner's limit of 667 mm/s (187 sigma) was no hypothesis: the prior began at 50 mm/s, some 1000 sigma."""
    time, inputs, chain = session("microrobot")
    effect = effects("microrobot")[name]
    forms = next((int(p.high) for p in effect.parameters if p.name == "form"), 0)
    for form in range(forms + 1):
        weakest = {p.name: p.low for p in effect.parameters if p.scale == "log" and p.null is not None}
        weakest |= {p.name: p.high for p in effect.parameters if p.name == "acceleration"}
        out = effect.apply(chain, weakest | ({"form": form} if forms else {})).run(time, inputs)
        off = [(out[c] - reference("microrobot")[c]) / noise for c, noise in NOISE.items()]
        assert np.linalg.norm(np.concatenate(off)) < 10.0, form
