"""The nominal stages of each instrument: what it does when nothing is wrong."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from sim_devices.chain import Chain
from sim_devices.stages.operators import Names, Noise, Wired, after
from sim_devices.stages.suction import nominal_suction

INSTRUMENTS = ("cutometer", "aspiration", "microrobot")
RATES = {"cutometer": 100.0, "aspiration": 25.0, "microrobot": 1000.0}
"""Sampling rates, Hz."""

_SUCTION_NOISE = {  # standard deviation and resolution of pressure (Pa) and apex height (m): assumed
    "cutometer": ((30.0, 2e-6), (10.0, 10e-6)),
    "aspiration": ((40.0, 5e-6), (10.0, 0.0)),
}


def nominal(instrument: str, **options: Any) -> Chain:
    """The chain of an ideal instrument; for the options see ``nominal_suction`` and ``nominal_robot``.

    Raises ValueError for an unknown instrument or tissue.
    """
    if instrument in ("cutometer", "aspiration"):
        return nominal_suction(instrument, **options)
    raise ValueError(f"no instrument {instrument!r}; there are {', '.join(INSTRUMENTS)}")


def noisy(chain: Chain, seed: int, *, scatter: float = 0.02) -> Chain:
    """The chain of a simulated instrument: noise and resolution of its sensors, and the skin's scatter from run to run.

    ``scatter`` is the relative standard deviation of the tissue's compliance between seeds.
    """
    factor = float(np.exp(scatter * np.random.default_rng([seed, 99]).standard_normal()))
    sigma, resolution = _SUCTION_NOISE[chain.instrument]
    elastic: Any = chain["elastic"]
    chain = chain.tuned("elastic", parameters=(elastic.parameters[0] * factor, *elastic.parameters[1:]))

    def sensor_noise(anchor: str, k: int) -> Callable[[Names, Names], Wired]:
        return lambda s, t: Noise(f"{anchor}_noise", "sensor", s, t, (sigma[k],), (resolution[k],), 2 * seed + k)

    return after(after(chain, "gauge", sensor_noise("gauge", 0)), "optics", sensor_noise("optics", 1))


__all__ = ["INSTRUMENTS", "RATES", "noisy", "nominal"]
