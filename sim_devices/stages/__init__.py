"""The nominal stages of each instrument: its behaviour without a fault."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from sim_devices.chain import Chain, Runner
from sim_devices.stages.robot import LoopRunner, nominal_robot
from sim_devices.stages.suction import nominal_suction

INSTRUMENTS = ("cutometer", "aspiration", "microrobot")
RATES = {"cutometer": 100.0, "aspiration": 25.0, "microrobot": 1000.0}
"""Sampling rates, Hz."""

_NOISE: dict[str, dict[str, tuple[float, float]]] = {
    # operator: standard deviation and resolution of its outputs (Pa, m or N): assumed
    "cutometer": {"gauge_noise": (30.0, 10.0), "optics_noise": (2e-6, 10e-6)},
    "aspiration": {"gauge_noise": (40.0, 10.0), "optics_noise": (5e-6, 0.0)},
    "microrobot": {"position_noise": (8e-6, 0.0), "transducer_noise": (1.5e-3, 0.0)},
}


def nominal(instrument: str, **options: Any) -> Chain:
    """The chain of an ideal instrument; for the options see ``nominal_suction`` and ``nominal_robot``.

    Raises ValueError for an unknown instrument or tissue.
    """
    if instrument in ("cutometer", "aspiration"):
        return nominal_suction(instrument, **options)
    if instrument == "microrobot":
        return nominal_robot(**options)
    raise ValueError(f"no instrument {instrument!r}; there are {', '.join(INSTRUMENTS)}")


def noisy(chain: Chain, seed: int, *, scatter: float = 0.02, mounting: int = 0) -> Chain:
    """The chain of a simulated instrument: noise and resolution of its sensors, and the skin's scatter from run to run.

    ``scatter`` is the relative standard deviation of the tissue's compliance between seeds. Another ``mounting`` of the
    same instrument has other noise.
    """
    factor = float(np.exp(scatter * np.random.default_rng([seed, 99]).standard_normal()))
    if chain.instrument == "microrobot":
        skin = chain["tissue"].tissue  # type: ignore[attr-defined]
        k1, k2, k3 = (k / factor for k in skin.stiffness)
        chain = chain.tuned("tissue", tissue=replace(skin, stiffness=(k1, k2, k3)))
    else:
        compliance, *rest = chain["elastic"].parameters  # type: ignore[attr-defined]
        chain = chain.tuned("elastic", parameters=(compliance * factor, *rest))
    first = 2 * remounted(seed, mounting)
    for k, (name, (sigma, resolution)) in enumerate(_NOISE[chain.instrument].items()):
        chain = chain.tuned(name, sigma=sigma, resolution=resolution, seed=first + k)
    return chain


def remounted(seed: int, mounting: int) -> int:
    """The seed of an instrument's noise at its ``mounting``, 0 the first: noise never comes twice."""
    return int(np.random.default_rng([seed, mounting]).integers(2**31)) if mounting else seed


def runner(chain: Chain) -> Runner | LoopRunner:
    """A runner that advances ``chain`` chunk by chunk as a running instrument, the robot's loop through the tissue
    closed."""
    return LoopRunner(chain) if chain.instrument == "microrobot" else Runner(chain)


__all__ = ["INSTRUMENTS", "RATES", "noisy", "nominal", "remounted", "runner"]
