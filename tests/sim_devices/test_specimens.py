"""Simulated reference specimens do what is known of them."""

from __future__ import annotations

import numpy as np
import pytest

from protocols.specimens import GRAVITY, SPECIMENS, stated
from sim_devices.effects import effects
from sim_devices.stages import nominal
from sim_devices.stages.robot import closed_loop
from sim_devices.stages.specimens import SLID_IN, SLIDE, mounted

SUCTION = ("cutometer", "aspiration")


def height(instrument: str, specimen: str, pressure: np.ndarray, time: np.ndarray, **known: object) -> np.ndarray:
    chain = mounted(nominal(instrument), specimen, stated(specimen, known))
    return chain.run(time, {"command_pressure": pressure})["apex_height"]


@pytest.mark.parametrize("instrument", SUCTION)
def test_a_block_stays_a_step_has_its_height(instrument: str) -> None:
    time = np.arange(0.0, 6.0, 0.01)
    suction = np.where(time > 1.0, -30e3, 0.0)
    for solid in ("rigid block", "manometer"):
        assert np.max(np.abs(height(instrument, solid, suction, time))) < 1e-8
    on_step = height(instrument, "gauge step", 0 * time, time, height="1.000 mm")
    assert on_step[time < SLID_IN] == pytest.approx(0.0)
    assert on_step[time > SLID_IN + SLIDE] == pytest.approx(1e-3)


@pytest.mark.parametrize("instrument", SUCTION)
@pytest.mark.parametrize("memory", [0.0, 0.02])
def test_a_membrane_loses_no_more_than_it_states(instrument: str, memory: float) -> None:
    for period in (0.5, 2.0, 10.0):
        time = np.arange(0.0, 4 * period, period / 1000)
        command = -15e3 * (1 - np.cos(2 * np.pi * time / period))
        chain = mounted(nominal(instrument), "reference membrane", stated("reference membrane", {"memory": memory}))
        made = chain.run(time, {"command_pressure": command, "line_pressure": command})
        last = time > 3 * period
        suction, bulge = -made["line_pressure"][last], made["bulge"][last]
        lost = abs(float(np.trapezoid(suction, bulge)))
        up = np.argmax(suction)
        work = float(np.trapezoid(suction[: up + 1], bulge[: up + 1]))
        assert lost <= max(memory, 2e-4) * work
        assert bulge.max() > 5e-5


def forces(specimen: str, target: tuple[float, float, float], **known: object) -> tuple[np.ndarray, np.ndarray]:
    """Force and place of the probe once it has settled at ``target`` (m)."""
    chain = mounted(nominal("microrobot"), specimen, stated(specimen, known))
    time = np.arange(0.0, 1.5, 0.002)
    command = {f"command_{k}": v * (time > 0.1) for k, v in zip("xyz", target, strict=True)}
    made = closed_loop(chain, time, command)
    return (np.array([made[f"{name}_{k}"][-1] for k in "xyz"]) for name in ("force", "tip"))  # type: ignore[return-value]


def test_the_robot_s_specimens() -> None:
    target = (4e-4, -3e-4, 5e-4)
    force, place = forces("open air", target)
    assert force == pytest.approx((0, 0, 0), abs=1e-6)
    force, place = forces("reference spring", target, k="400 N/m")
    assert force == pytest.approx(-400 * place, rel=1e-3)
    assert place == pytest.approx(target, rel=1e-2)
    force, _ = forces("dead weight", (0, 0, 0), mass="20 g", direction="0, 0.6, -0.8")
    assert force == pytest.approx(0.02 * GRAVITY * np.array([0, 0.6, -0.8]), rel=1e-3)
    post, _ = forces("rigid post", (2e-5, 0, 0))
    assert abs(post[0]) > 1.0  # the tip cannot follow


def test_what_cannot_be_simulated_is_told() -> None:
    for specimen, instrument, words in (
        ("jelly", "cutometer", "no simulated specimen 'jelly'"),
        ("open air", "cutometer", "not for a cutometer"),
        ("gauge step", "cutometer", "height: must be stated"),
    ):
        with pytest.raises(ValueError, match=words):
            mounted(nominal(instrument), specimen, {})
    assert set(SPECIMENS) > {"open air"}


def test_a_second_gauge_at_the_probe_sees_what_the_rim_loses() -> None:
    """An outside author's leak on skin was read by a manometer at the probe, which counted as one at the line."""
    time = np.linspace(0.0, 4.0, 401)
    asked = {"command_pressure": np.where(time > 0.5, -30e3, 0.0)}
    leaking = effects("cutometer")["rim_leak"].apply(nominal("cutometer"), {"share": 0.05, "exponent": 0.0})
    made = leaking.run(time, asked)
    assert made["pressure_reference"][-1] == pytest.approx(0.95 * made["line_pressure"][-1])
    assert made["skin_pressure"][-1] == made["pressure_reference"][-1]
    assert made["pressure"][-1] == pytest.approx(made["line_pressure"][-1])
