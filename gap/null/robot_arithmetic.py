"""The robot's computed channels, recomputed: axis positions -> probe, transducers -> force."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gap.data.innovations import RowNoise
from gap.inference.hypothesis import Active, Evaluation
from gap.null.blocks import Block
from gap.null.chains import needed, run
from gap.null.groups import Group, GroupedSession, Table
from gap.null.robot_specimens import specimen_chain
from sim_devices.chain import Effect, FloatArray
from sim_devices.stages.tissues import sheet_tissue

SOONEST = 0.01
"""s after the first sample at which a zero is taken."""


class ArithmeticBlock(Block):
    """Recomputed channels: axis positions -> probe, transducers -> force. No freedom but a zero in each recording, of
    the size of the ``floor``: a computed channel has its inputs' noise, and their zeros."""

    growth, widest = 0.4, 0.8  # nothing is quick in a formula, and noise there is none

    def __init__(
        self,
        session: GroupedSession,
        library: Mapping[str, Effect],
        name: str,
        source: Sequence[str],
        target: Sequence[str],
        floor: float,
    ) -> None:
        self.name, self.channels, self._source, self.floor = name, tuple(target), tuple(source), floor
        super().__init__(session, library)
        # A recomputed channel carries the noise of its inputs: both are the recording's own.
        self.row_noise = RowNoise(self.stamps, self.run, np.full((len(target), len(self.stamps)), floor**2))
        self.slope = np.zeros(len(self.measured))  # nor does it matter when they were taken
        self._runs = np.kron(np.eye(3), self.member)
        self.prior_sd = np.full(self._runs.shape[1], floor)
        self.prior_mean = np.zeros(len(self.prior_sd))
        self.prior_scales = (self.prior_sd,)
        self._given = [self._binned_source(g, at) for g, at in self.groups]

    @property
    def resets(self) -> Sequence[float]:
        """Times, s, after the first sample at which a channel that is off by a constant read just that."""
        off = self.evaluate(self.prior_mean, {}, want_jacobian=False).residual.reshape(3, -1) * self.floor
        read = self.measured.reshape(3, -1)
        found = []
        for error, value in zip(off, read, strict=True):
            wrong = float(np.median(error))
            true = value - error + wrong  # nought where, less its reading there, a channel would be off by as much
            at = np.flatnonzero(true[1:] * true[:-1] < 0)
            share = true[at] / (true[at] - true[at + 1])
            after = self.stamps[at] + share * np.diff(self.stamps)[at] - self.stamps[0]
            if abs(wrong) > self.floor:
                found += after[after > SOONEST][:1].tolist()
        return found

    def _binned_source(self, group: Group, at: slice) -> dict[str, Table]:
        out = {}
        for name in self._source:
            parts = []
            for k in dict.fromkeys(self.run[at].tolist()):
                bins = self.session.binned(name, k, self.session.kinks, self.growth, self.widest)
                parts.append(bins.value[: int(np.sum(self.run[at] == k))])
            values = np.concatenate(parts)
            out[name] = (self.stamps[at], values)
        return out

    def evaluate(self, nuisance: FloatArray, active: Active, want_jacobian: bool = True) -> Evaluation:
        out = np.empty((3, len(self.stamps)))
        for (g, at), given in zip(self.groups, self._given, strict=True):
            chain = self.with_effects(specimen_chain(g, sheet_tissue("forearm"), self.session.marks), active, g)
            signals = {n: v for n, (_, v) in given.items()}
            made = run(needed(chain, self.channels, signals), self.stamps[at], signals)
            out[:, at] = np.stack([made[c] for c in self.channels])
        residual = (self.measured - out.ravel() - self._runs @ nuisance) / self.sigma
        return Evaluation(residual, self._runs / self.sigma[:, None] if want_jacobian else np.zeros((0, 0)))
