"""Compiled laws with memory, from one time series to another: the building blocks of stages, effects and user rigs.

Every kernel has the signature ``kernel(s, t, u, p, y)``: state ``s`` (``STATE``,), zeros for rest and changed in place;
times ``t`` (n,) s, strictly increasing, of any spacing; input ``u`` (n,), piecewise linear between samples; parameters
``p``; output ``y`` (n,). Calls join without a seam. Linear memory is integrated exactly (first-order hold), so that the
step hardly matters; rate-independent laws are exact for inputs that are monotone within a step. Before the first sample
the input was zero.

>>> import numpy as np
>>> t = np.array([0.0, 1e-9, 1.0])
>>> evaluate(low_pass, t, np.array([0.0, 1.0, 1.0]), 0.5).round(4).tolist()
[0.0, 0.0, 0.8647]
"""

from __future__ import annotations

from sim_devices.stages.kernels.base import (
    SAME,
    STATE,
    STEPS,
    TERMS,
    FloatArray,
    Kernel,
    anew,
    evaluate,
    hash_uniform,
    hold_weights,
    place,
)
from sim_devices.stages.kernels.history import (
    by_loadings,
    emptying_store,
    exposed,
    exposure_gain,
    limited_store,
    mullins,
    sagging_store,
    sealing,
    worked,
    worked_off,
    yield_flow,
)
from sim_devices.stages.kernels.hysteresis import (
    bouc_wen,
    friction,
    in_a_row,
    of_joints,
    play,
    play_within,
    prandtl,
    resting,
    slipping,
    soft_play,
)
from sim_devices.stages.kernels.lags import (
    adaptive_low_pass,
    eased,
    hurried,
    lead,
    low_pass,
    oscillation,
    planned,
    prony,
    rate_limit,
    second_order,
    uneven_low_pass,
)
from sim_devices.stages.kernels.loops import CLEARS, FREE, free_loop, overlapping_loop, sleeping_loop, valve_loop
from sim_devices.stages.kernels.sampling import STRIDE, faulty_samples, jittered, late_by_any, random_walk, slope_so_far

__all__ = [
    "CLEARS",
    "FREE",
    "SAME",
    "STATE",
    "STEPS",
    "STRIDE",
    "TERMS",
    "FloatArray",
    "Kernel",
    "adaptive_low_pass",
    "anew",
    "bouc_wen",
    "by_loadings",
    "eased",
    "emptying_store",
    "evaluate",
    "exposed",
    "exposure_gain",
    "faulty_samples",
    "free_loop",
    "friction",
    "hash_uniform",
    "hold_weights",
    "hurried",
    "in_a_row",
    "jittered",
    "late_by_any",
    "lead",
    "limited_store",
    "low_pass",
    "mullins",
    "of_joints",
    "oscillation",
    "overlapping_loop",
    "place",
    "planned",
    "play",
    "play_within",
    "prandtl",
    "prony",
    "random_walk",
    "rate_limit",
    "resting",
    "sagging_store",
    "sealing",
    "second_order",
    "sleeping_loop",
    "slipping",
    "slope_so_far",
    "soft_play",
    "uneven_low_pass",
    "valve_loop",
    "worked",
    "worked_off",
    "yield_flow",
]
