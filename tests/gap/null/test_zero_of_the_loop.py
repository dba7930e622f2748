"""A loop that sees its gauge's zero while suction is asked for, and a weighed one of a valve with inertia."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from acquire.recording.model import Recording
from gap.effects.load import library
from gap.inference.least_squares import fit
from gap.null.groups import GroupedSession
from gap.null.suction_line import overshoot
from gap.null.suction_pressure import PressureBlock
from gap.null.suction_regulator import INERTIA, VENTED
from sim_devices.stages import nominal
from tests.gap.null.regulators import CORNERS, STEP, SUCTION, TIME, session_of

ASKED = np.interp(TIME, CORNERS, SUCTION)


def loop(zero: float, weight: float = 1.0, rate: float = 0.0, inertia: float = 0.0) -> np.ndarray:
    """What a gauge of such a ``zero`` (Pa) reads, (n,) Pa of suction, of a loop of 13.3/s and a valve of 17 ms that
    sees the zero while suction is asked for, is cleared at the air's pressure, and vents to that."""
    p = valve = speed = integral = 0.0
    out, gain, late = np.empty(len(ASKED)), 13.3, 0.017
    for k, u in enumerate(ASKED):
        out[k] = p + zero
        for _ in range(4):
            h, reads = 0.25 * STEP, p + zero * min(1.0, u / 500.0)
            wanted = gain * (weight * u - reads) + integral
            if inertia:
                speed += h * (wanted - valve - late * speed) / (inertia * late**2)
                valve += h * speed
            else:
                valve += h * (wanted - valve) / late
            integral += h * gain * rate * (u - reads)
            p = max(p + h * valve, 0.0)
        integral *= 0.0 if u <= 0.0 and p < 100.0 else 1.0
    return out


def block_of(recording: Callable[..., Recording], read: np.ndarray) -> PressureBlock:
    return PressureBlock(GroupedSession([session_of(recording, read)], ("pressure",)), library("cutometer"))


def test_a_zero_that_ends_with_the_command_is_sound(recording: Callable[..., Recording]) -> None:
    """A sound session of an outside author was told a gauge's offset: while a line falls, its loop sees none any
    more."""
    block = block_of(recording, loop(250.0))
    found = fit(block)
    assert block.commanded
    assert found.nuisance[VENTED] == pytest.approx(-250.0, abs=25.0)
    assert found.chi2 < 1.1 * len(found.residual)
    group = block.groups[0][0]
    # Under suction the loop holds the reading where it is asked for: only a second gauge would tell.
    np.testing.assert_allclose(block.true(group, TIME, -loop(250.0))[::50], -loop(0.0)[::50], atol=60.0)


def test_a_weighed_loop_may_have_a_valve_with_inertia(recording: Callable[..., Recording]) -> None:
    """The same session was told an overshoot (9.5 sigma), as only loops whose valve's way is limited had inertia."""
    block = block_of(recording, loop(0.0, weight=0.62, rate=5.2, inertia=0.5))
    found = fit(block)
    told = block.quantities(found.nuisance)
    assert told["regulator_setpoint_weight"][0] == pytest.approx(0.62, abs=0.05)
    assert found.nuisance[INERTIA] == pytest.approx(0.5, abs=0.2)
    assert found.chi2 < 1.1 * len(found.residual)


def test_an_overshoot_goes_beyond_its_step() -> None:
    """A delay was told an overshoot (11 sigma): a resonance behind a regulator that is slow is late, no more."""
    sound = nominal("cutometer", command_step=0.0)
    assert overshoot(sound, 20e3) == pytest.approx(0.0, abs=1e-3)
    assert overshoot(sound.tuned("regulator", zeta=0.5), 20e3) == pytest.approx(0.163, abs=0.005)
    resonant = library("cutometer")["overshoot[form=1]"]
    known = {"overshoot": 0.1, "slowness": 0.6}
    assert overshoot(resonant.apply(sound.tuned("regulator", tau=0.06, zeta=1.4), known), 20e3) < 0.01
