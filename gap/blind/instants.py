"""Timing: when the samples of a recording were truly taken, and which of them reached the file.

Knobs (all absent in the nominal instrument; times in seconds):
``skew``, ``skew_wander`` relative clock error, constant or wandering over the session; ``jitter``, ``beat`` scatter of
the instants, random or sawtooth; ``late``, ``late_burst`` fraction of samples that are one old, or the start rate of
bursts; ``drop``, ``drop_gap`` fraction of samples lost, last value repeated, or time axis closed up; ``lag_height``,
``lag_growing`` height behind pressure, constant or growing through a recording; ``lost_run``, ``lost_frames`` a burst
of lost samples (of all channels, or of the height's) after which all of one recording is that much too early by its
stamps. ``stamped`` is no fault: the convention, in periods, of the instant that a stamp means.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .signals import Array

Knobs = Mapping[str, float]


@dataclass(frozen=True)
class Taken:
    """True instants [s] of the main and of the height (or force) channel, and the row each delivered row repeats."""

    main: Array
    second: Array
    row: NDArray[np.int64]


def taken(stamps: Array, period: float, k: int, fx: Knobs, rng: np.random.Generator) -> Taken:
    """True sampling instants for nominal ``stamps`` (n,) of recording ``k``, sampled every ``period`` seconds."""
    n = stamps.size
    true = stamps + fx.get("stamped", 0.0) * period - (fx.get("skew", 0.0) + fx.get("skew_tolerance", 0.0)) * stamps
    if wandering := fx.get("skew_wander", 0.0):
        turn = fx["skew_period"]
        true = (
            true - wandering * turn / (2 * np.pi) * (1 - np.cos(2 * np.pi * stamps / turn)) - 0.3 * wandering * stamps
        )
    scatter, saw, lost_u, late_u = rng.normal(size=n), np.arange(n), rng.random(n), rng.random(n)
    true = true + fx.get("jitter", 0.0) * scatter
    if beat := fx.get("beat", 0.0):
        true = true + beat * ((saw * fx["beat_ratio"]) % 1.0 - 0.5)
    row = np.arange(n)
    if late := fx.get("late", 0.0):
        row = row - (late_u < late)
    if burst := fx.get("late_burst", 0.0):
        length, depth = int(fx["burst_length"]), int(fx["burst_depth"])
        busy = np.convolve(late_u < burst, np.ones(length))[:n] > 0
        row = row - depth * busy
    if drop := fx.get("drop", 0.0):
        kept = np.where(lost_u < drop, 0, np.arange(n))
        row = np.minimum(row, np.maximum.accumulate(kept))
    if gap := fx.get("drop_gap", 0.0):
        true = true + np.cumsum(lost_u < gap) * period * fx["gap_length"]
    if (lost := fx.get("lost_run", 0.0)) and k == int(fx["lost_in"]):
        at = stamps[0] + fx["lost_at"] * (stamps[-1] - stamps[0])
        true = true + lost * (stamps > at)
    second = true - fx.get("lag_height", 0.0)
    if (lost := fx.get("lost_frames", 0.0)) and k == int(fx["lost_in"]):
        second = second + lost * (stamps > stamps[0] + fx["lost_at"] * (stamps[-1] - stamps[0]))
    if growing := fx.get("lag_growing", 0.0):
        second = second - growing * (stamps - stamps[0]) / 10.0
    return Taken(true, second, np.clip(row, 0, None))
