"""Noise of a rig's channels: stated, or read from how rough they are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from acquire.recording.model import Recording
from gap.data.innovation import unforeseen
from gap.data.noise import high_band_sigma
from gap.rig.model import ForwardModel, ModelError
from sim_devices.chain import FloatArray

STILL = 20
"""Equal samples in a row that a channel with noise does not have."""
LEAST = 1e-7
"""Of a channel's range: no noise is less."""


def stated_noise(model: ForwardModel, recordings: Sequence[Recording]) -> dict[str, float]:
    """Noise of a sample by channel, SI, where the model (``noise``) or the recordings state it."""
    stated = {c: max(r.streams[c].noise for r in recordings if c in r.streams) for c in model.channels}
    own: Mapping[str, float] = getattr(model, "noise", {})
    for channel, value in own.items():
        if channel not in model.channels or not value > 0:
            raise ModelError(f"model {model.name}: noise of {channel!r}: {value!r} is no noise of one of its channels")
    return {c: v for c, v in stated.items() if v > 0} | {c: float(v) for c, v in own.items()}


def roughness(channel: str, values: Sequence[FloatArray], data: Sequence[Mapping[str, FloatArray]]) -> float:
    """Noise of a sample of a channel: its own roughness, or, where a broad excitation makes it rough, what its past
    and the other signals do not foretell."""
    rough = float(np.median([high_band_sigma(v[moves(v)]) for v in values]))
    others = [[v for n, v in run.items() if n not in (channel, f"setpoint_{channel}")] for run in data]
    surprise = [unforeseen(v, other, moves(v)) for v, other in zip(values, others, strict=True)]
    least = LEAST * float(np.ptp(np.concatenate(values)))
    return min(rough, max(float(np.median(surprise)), least))


def moves(value: FloatArray) -> NDArray[np.bool_]:
    """Which samples of a channel (n,) do not stand exactly still for long, as at rest, where no noise shows; all where
    hardly any is left."""
    edges = np.flatnonzero(np.r_[True, np.diff(value) != 0, True])
    lengths = np.diff(edges)
    moving = np.repeat(lengths < STILL, lengths)
    return moving if np.count_nonzero(moving) >= STILL else np.ones(len(value), dtype=bool)
