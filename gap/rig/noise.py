"""Noise of a rig's channels: stated, or read from how rough they are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from acquire.recording.model import Recording
from gap.data.innovation import unforeseen
from gap.data.noise import Counts, coarse_counts, high_band_sigma
from gap.rig.model import ForwardModel, ModelError
from sim_devices.chain import FloatArray

STILL = 20
"""Equal samples in a row that a channel with noise does not have."""
LEAST = 1e-7
"""Of a channel's range: no noise is less."""


@dataclass
class ChannelNoise:
    """Noise of the predicted channels of a rig: standard deviation ``sigma`` of a sample, SI, by channel.

    ``stated`` is the noise that model or recordings state, ``counts`` the coarse channels, whose noise is read from
    their counts; of other channels it is read from how rough they are.
    """

    sigma: dict[str, float]
    stated: Mapping[str, float]
    counts: Mapping[str, Counts]

    @classmethod
    def of(
        cls, model: ForwardModel, recordings: Sequence[Recording], runs: Sequence[Mapping[str, FloatArray]]
    ) -> ChannelNoise:
        """The noise in ``runs``, which have the signals (n,) of each of ``recordings``. Raises ModelError."""
        # Of the channel as recorded: noise that `observe` filters out counts, too.
        recorded = {c: [data[c] for data in runs] for c in model.channels}
        counts = {c: found for c, v in recorded.items() if (found := coarse_counts(np.concatenate(v)))}
        stated = stated_noise(model, recordings)
        sigma = {c: roughness(c, values, runs) for c, values in recorded.items()}
        return cls(sigma | {c: found.sigma for c, found in counts.items()} | stated, stated, counts)

    def lower(self, residual: Mapping[str, Sequence[FloatArray]]) -> None:
        """Lower the noise of channels to the roughness of a model's residuals, where their noise was read from their
        own: where a channel is excited broadly, its own roughness is the signal's."""
        for channel in set(residual) - set(self.stated) - set(self.counts):
            rough = float(np.median([high_band_sigma(v) for v in residual[channel] if len(v)]))
            self.sigma[channel] = min(self.sigma[channel], rough)


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
