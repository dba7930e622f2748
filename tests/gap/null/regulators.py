"""Regulators of structures that the library does not hold, and the session that asks them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from acquire.recording.model import Recording
from gap.effects.load import library
from gap.null.groups import GroupedSession
from gap.null.suction_pressure import PressureBlock

STEP, NOISE = 1e-3, 30.0
TIME = np.arange(0.0, 40.0, STEP)
CORNERS = np.array([0, 2, 6, 10, 12, 12.001, 17, 17.001, 22, 22.001, 26, 26.001, 30, 30.001, 34, 34.001, 40])
SUCTION = 1e3 * np.array([0, 0, 30, 0, 0, 30, 30, 10, 10, 0, 0, 15, 15, 30, 30, 0, 0.0])


def with_windup(asked: np.ndarray) -> np.ndarray:
    """Suction (n,) Pa of a PI controller with back-calculation, a valve of 15 ms and a limited flow, of a chamber that
    air bleeds into."""
    gain, late, bleed, most, back = 16.0, 0.015, 0.2, 3.0e5, 0.1
    p, flow, integral, out = 0.0, 0.0, 0.0, np.empty(len(asked))
    for k, u in enumerate(asked):
        out[k] = p
        for _ in range(4):
            h, wanted = 0.25 * STEP, gain * (u - p) + integral
            given = min(max(wanted, -most), most)
            integral += h * (gain / bleed * (u - p) + (given - wanted) / back)
            flow += h * (given - flow) / late
            p = max(p + h * (flow - p / bleed), 0.0)
    return out


def choked(asked: np.ndarray) -> np.ndarray:
    """Suction (n,) Pa by a three-way valve between a store and the air, whose flow is that of ISO 6358 and which opens
    more readily to the air."""
    air, store, late, critical = 101.3e3, 40e3, 0.01, 0.3
    p, opened, out = 0.0, 0.0, np.empty(len(asked))

    def share(ratio: float) -> float:
        return 1.0 if ratio <= critical else np.sqrt(max(1.0 - ((ratio - critical) / (1.0 - critical)) ** 2, 0.0))

    for k, u in enumerate(asked):
        out[k] = p
        for _ in range(8):
            error, h = u - p, 0.125 * STEP
            wanted = min(max((error if error > 0 else 2.0 * error) / 16e3, -1.0), 1.0)
            opened += h * (wanted - opened) / late
            gives = (air - p) * share(store / (air - p)) if opened > 0 else air * share((air - p) / air)
            p = max(p + h * 4.0 * opened * gives, 0.0)
    return out


def session_of(recording: Callable[..., Recording], suction: np.ndarray, seed: int = 1) -> Recording:
    """A recording, 50 Hz, of a ``suction`` (n,) Pa at `TIME`; ``seed`` draws its noise."""
    measured = -suction[::20] + NOISE * np.random.default_rng(seed).normal(size=len(TIME[::20]))
    return recording({"pressure": measured}, TIME[::20], {"pressure": (CORNERS, -SUCTION)})


def block_of(recording: Callable[..., Recording], suction: np.ndarray, seed: int = 1) -> PressureBlock:
    session = GroupedSession([session_of(recording, suction, seed)], ("pressure",))
    return PressureBlock(session, library("cutometer"), unknown=True)
