"""Hidden effects that lie within twice a tolerance which docs/tolerances.md states: by it they are no finding.

Their delta is as large as the instrument is quiet, while nobody may claim them: a gauge's zero of 1.7 mbar is 120
standard deviations of the record, and one and a half of what a sound gauge has.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

SUCTION: Mapping[str, float] = MappingProxyType({
    "latency": 1e-3, "poll": 0.012, "skew": 4e-5, "lag_height": 2e-3,  # s, s/s
    "lag": 0.020, "lag_cascade": 0.020, "lag_fall": 0.020, "lead": 0.020,  # s; the last of another make
    "band": 100.0, "sleep": 100.0, "loop_offset": 200.0, "gauge_offset": 200.0, "gauge_shift": 200.0,  # Pa
    "gauge_gain": 0.010, "gauge_gain_high": 0.010, "gain": 0.020, "drop_gap": 4e-5,  # relative
    "pulse": 1e-6,  # m
})  # fmt: skip
"""Twice the tolerance of a knob of `effects_suction`, by which it is at most."""
ROBOT: Mapping[str, float] = MappingProxyType({
    "latency": 2e-3, "skew": 4e-5, "leg_gain": 0.010, "leg_gains": 0.010, "drag": 20.0, "drop_gap": 4e-5,
    "axis_coarse": 50e-6, "leg_coarse": 6e-3,  # m, N: the sensors' resolutions
})  # fmt: skip
"""The same of `effects_robot`."""
SLOWEST, SLOWEST_AXIS = 300e2 / 0.15, 1.0
"""Pa/s and m/s: a rate that is limited no lower is no finding."""


def within_tolerance(knobs: Mapping[str, float], robotic: bool) -> bool:
    """Whether an effect of ``knobs``, of the robot where it is ``robotic``, is within twice a stated tolerance."""
    if "slew" in knobs or "slew_soft" in knobs:  # under suction the second tells how a rate is approached
        rate = knobs.get("slew", knobs.get("slew_soft", 0.0))
        return rate >= (SLOWEST_AXIS if robotic else SLOWEST)
    limits = ROBOT if robotic else SUCTION
    stated = [name for name in knobs if name in limits]
    return bool(stated) and all(abs(knobs[name]) <= limits[name] for name in stated)
