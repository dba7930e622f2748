"""Transducers whose noise forgets within tenths of a second, and a camera's height of skin alone.

Their rows had counted as independent, and what neighbours had in common divided all evidence by 2 to 5.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from acquire.recording.model import Recording, Series
from gap.data.noise import mean_correlation
from gap.design import simulated as own
from gap.effects.load import library
from gap.inference.least_squares import fit
from gap.null.robot import robot_problems
from gap.null.suction import suction_problems
from sim_devices.chain import FloatArray
from sim_devices.stages.robot import TRANSDUCERS

TAU = 0.4


def slow(time: FloatArray, size: float, rng: np.random.Generator) -> FloatArray:
    """A first-order process (n,) of standard deviation ``size`` that forgets within `TAU`."""
    out = [rng.normal()]
    for keep in np.exp(-np.diff(time) / TAU):
        out.append(keep * out[-1] + np.sqrt(1.0 - keep**2) * rng.normal())
    return size * np.array(out)


def coloured(r: Recording, channels: tuple[str, ...], size: float, rng: np.random.Generator) -> Recording:
    def noisier(s: Series) -> Series:
        return replace(s, value=s.value + slow(s.time, size, rng))

    return replace(r, streams=r.streams | {name: noisier(r.streams[name]) for name in channels})


@pytest.mark.parametrize("air", [True, False])
def test_transducers_remember_as_open_air_or_the_skin_s_rest_shows(air: bool) -> None:
    rng = np.random.default_rng(5)
    legs = [own.direction_cycles(a, b, 1e-3, 8.0, 2) for a, b in ((0.0, 0.0), (1.6, 0.0), (0.0, 1.57))]
    if air:
        legs.insert(0, replace(own.direction_cycles(0.0, 0.0, 1e-3, 10.0, 2), specimen="open air"))
    made = own.robot_session(np.random.default_rng(3), legs=legs)
    taken = [coloured(r, TRANSDUCERS, 0.4e-3, rng) for r in made]
    blocks = {b.name: b for b in robot_problems(taken, library("microrobot"))[0]}
    force = blocks["force"]
    found = fit(force, nuisance=force.start())
    assert force.row_noise.memory is not None
    assert force.row_noise.memory[0] == pytest.approx(3 * [0.4e-3], rel=0.5)
    assert mean_correlation(found.residual, force.rows.recording) < 1.6
    if air:
        assert force.row_noise.memory == blocks["reference"].row_noise.memory


def test_the_height_on_skin_alone_has_slow_noise_of_its_own() -> None:
    rng = np.random.default_rng(6)
    made = own.suction_session("aspiration", np.random.default_rng(12))
    height = suction_problems([coloured(r, ("apex_height",), 2e-6, rng) for r in made], library("aspiration"))[0][-1]
    found = fit(height, nuisance=height.start())
    assert height.row_noise.memory is not None
    assert height.row_noise.memory[0] == pytest.approx([2e-6], rel=0.5)
    assert mean_correlation(found.residual, height.rows.recording) < 1.6
