"""Blocks of data of our own instruments: some channels of a session, binned, against a part of the forward chain.

A block's arrays are channel-major: C channels at the same n time stamps make C n rows.
"""

from __future__ import annotations

import abc
import copy
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from gap.data.binning import GROWTH, WIDEST, node_times
from gap.data.innovations import RowNoise
from gap.data.labels import label_rows
from gap.data.tolerances import tolerances
from gap.inference.evidence import Fit
from gap.inference.hypothesis import Active, Candidate, Evaluation, Lateness, Rows, Start
from gap.null.chains import Kept, Memo, needed
from gap.null.chance import ByChance
from gap.null.groups import Group, GroupedSession, Table
from sim_devices.chain import Chain, Effect, FloatArray
from sim_devices.stages.operators import Retimed
from sim_devices.stages.sampling import COMMANDS, RETIMED, command_at, time_grid
from sim_devices.stages.specimens import meets

SIMPLE_SHIFT = 1e-3
"""s: how late a channel may be that samples, neither holds nor integrates."""
AFTER_KINK = 1e-3 * np.concatenate([np.arange(1, 13), 13.0 * 1.08 ** np.arange(57)])
"""s after a kink of the command: nodes so dense that straight lines between them are within .02 σ of the signal."""


class _Part(NamedTuple):
    """One recording's bins: mean time and spread of the samples (n,) s, value and number of samples (channels, n)."""

    run: int
    time: FloatArray
    value: FloatArray
    samples: NDArray[np.int64]
    spread: FloatArray


class Block(ByChance, abc.ABC):
    """Rows in bins, whitening, effects by candidate; subclasses define prediction and nuisance."""

    name: str
    session: GroupedSession
    channels: tuple[str, ...]
    growth, widest = GROWTH, WIDEST  # of the bins
    averaged: bool  # whether samples are means over a sampling period
    _ends: FloatArray  # nodes (m, n) s of bins
    _grids: Kept
    _delayed: Kept
    trust = 0.9
    floor: float = 0.0  # SI: noise that averaging does not lower, because the nominal chain is not known better
    open_law = False  # whether the residual may be skin of another law
    input_block = ""  # the block whose fit its simulation has as input
    suspected: frozenset[str] = frozenset()  # keys of effects that the start asked for: they are to be fitted in full
    law_parameters = 0  # of the nuisance's first ones, in which predictions bend
    sound: FloatArray | None = None  # the nuisance of a sound instrument, without tissue in the way

    prior_mean: FloatArray
    prior_sd: FloatArray
    prior_scales: Sequence[FloatArray]

    def __init__(self, session: GroupedSession, library: Mapping[str, Effect], without: Sequence[str] = ()) -> None:
        self.session, self.library = session, library
        self.tolerances = tolerances(session.instrument)
        self.groups: list[tuple[Group, slice]] = []
        parts = self._grouped(without)
        self.stamps = np.concatenate([part.time for part in parts])
        self._spread = np.concatenate([part.spread for part in parts])
        self.run = np.repeat([part.run for part in parts], [len(part.time) for part in parts])
        self.runs = sorted(set(self.run.tolist()))
        values = np.hstack([part.value for part in parts])
        counts = np.hstack([part.samples for part in parts])
        noise = session.sigmas(self.channels, self.runs, session.kinks)
        self.noise = np.array([sigma.white for sigma in noise])
        self.measured, self.counts = values.ravel(), counts.ravel()
        new = np.stack([sigma.of_mean(n) for sigma, n in zip(noise, counts, strict=True)]) + self.floor**2
        self.row_noise = RowNoise(self.stamps, self.run, new, [sigma.slow for sigma in noise])
        self.dt = float(
            np.median([np.median(np.diff(session.recordings[k].streams[self.channels[0]].time)) for k in self.runs])
        )
        self.rows = self._labelled()
        vars(self).update(self.sampled(session.averaged))

    def _grouped(self, without: Sequence[str]) -> list[_Part]:
        """The bins of all recordings that have the channels, group by group but for those ``without``; `groups` gets
        the rows of each."""
        parts, at, own_channels = list[_Part](), 0, set(self.channels)
        for group in self._simulated_together(without):
            own = [self._part(k) for k in group.members if own_channels <= self.session.recordings[k].streams.keys()]
            size = sum(len(part.time) for part in own)
            if size:
                self.groups.append((group, slice(at, at + size)))
            parts += own
            at += size
        if not at:
            raise ValueError(f"no recording has all channels {', '.join(self.channels)}")
        return parts

    def _simulated_together(self, without: Sequence[str]) -> Sequence[Group]:
        """The groups whose recordings are simulated together, but for those ``without``."""
        return [g for g in self.session.groups if g.name not in without]

    def _part(self, k: int) -> _Part:
        """The channels of recording ``k`` in bins."""
        session, ends = self.session, self.breaks(k)
        bins = [session.binned(c, k, session.kinks, self.growth, self.widest, ends) for c in self.channels]
        n = min(len(b.time) for b in bins)  # equal unless a channel lost samples at its end
        value, count = np.stack([b.value[:n] for b in bins]), np.stack([b.count[:n] for b in bins])
        return _Part(k, bins[0].time[:n], value, count, bins[0].spread[:n])

    def knowing(self, further: Mapping[str, Effect]) -> Self:
        """The same block with further effects, by their candidates' keys."""
        out = copy.copy(self)
        out.library = {**self.library, **further}
        return out

    def sampled(self, averaged: bool) -> dict[str, Any]:
        """Attributes of a block whose samples are means over a sampling period, or not."""
        ends = node_times(self.stamps, self._spread, self.dt if averaged else 0.0)
        return {"averaged": averaged, "_ends": ends, "_grids": Kept(), "_delayed": Kept(2 * len(self.groups))}

    @property
    def shift_sd(self) -> float:
        """How late a sound channel may be, s, which integrates, holds or stamps as it likes."""
        return self.tolerances["sampling"]["shift"].value * self.dt

    @property
    def resets(self) -> Sequence[float]:
        """Times (s) after the beginning of suction at which recordings jump."""
        return ()

    def breaks(self, k: int) -> Sequence[float]:
        """Times, s, at which recording ``k`` jumps and no bin may go on."""
        return ()

    def _labelled(self) -> Rows:
        parts = []
        for channel in self.channels:
            for k in dict.fromkeys(self.run.tolist()):
                parts.append((self.session.recordings[k], channel, self.stamps[self.run == k] - self.session.shifts[k]))
        rows = label_rows(parts)
        c = len(self.channels)
        return Rows(np.tile(self.stamps, c), np.tile(self.run, c), rows.labels)

    def blur_steep_parts(self, slope: FloatArray) -> None:
        """Add uncertain stamps' share of the noise where the signal, of ``slope`` (channels · n,) per s, is steep."""
        self.slope = slope
        self.row_noise.blur(slope * self.tolerances["sampling"]["stamp"].value)

    @property
    def sigma(self) -> FloatArray:
        """Noise (channels · n,) of the rows, SI."""
        return self.row_noise.sigma

    @property
    def member(self) -> FloatArray:
        """Which recording each stamp belongs to, (n, recordings) of 0 and 1."""
        return np.asarray(self.run[:, None] == np.asarray(self.runs)[None, :], dtype=float)

    def with_effects(self, chain: Chain, active: Active, group: Group) -> Chain:
        """The chain of a group with the active effects, those that its specimen meets."""
        for candidate, values in active.items():
            if not self.by_chance(candidate.key) and meets(self.library[candidate.key], group.name):
                chain = self.library[candidate.key].apply(chain, values)
        return chain

    def belies(self, fitted: Fit) -> bool:
        return False

    def simulated(
        self,
        chain: Chain,
        group: Group,
        at: slice,
        shift: float | FloatArray,
        given: Mapping[str, Table] | None = None,
        coarse: bool = False,
    ) -> FloatArray:
        """The block's channels as ``chain`` makes them at the group's time stamps + ``shift`` s, (channels, n).

        A bin's mean is taken from some nodes (`node_times`); ``coarse``, for differences of two simulations, from one
        in the middle. The grid is one for a group, whatever the shift: one that moved with it would make the fit's
        landscape rough. Dead times in the chain need one of their own.
        """
        given = given or {}
        operators = needed(chain, self.channels, given)
        ends = (self.stamps[None, at] if coarse else self._ends[:, at]) + shift
        memo, commands = self._grids.get(
            (at.start, coarse), lambda: self._on_nodes(group, self._nodes(group, at, coarse))
        )
        if delays := tuple(op for op in operators if isinstance(op, Retimed) and op.moves):
            nodes = [memo.time, np.sort(ends, axis=None)]
            key = (at.start, coarse, delays, ends.tobytes())
            memo, commands = self._delayed.get(key, lambda: self._on_nodes(group, nodes, delays))
        made = memo.run(operators, commands | {name: memo.on_grid(*table) for name, table in given.items()})
        return np.stack([np.interp(ends, memo.time, made[c]).mean(axis=0) for c in self.channels])

    def tables(self, group: Group) -> dict[str, Table]:
        """The commands of a group."""
        return group.tables(self.session.held)

    def kinks(self, group: Group) -> FloatArray:
        """When the rate of a group's commands jumps, (k,) s by the clock of its `tables`."""
        return np.unique(np.concatenate([c.kinks for c in group.commands.values()]))

    def _nodes(self, group: Group, at: slice, coarse: bool) -> list[FloatArray]:
        """Where a group is simulated: the ends of its bins and times after kinks; ``coarse``, the middles of its bins,
        and no more after kinks than any simulation has."""
        if coarse:
            return [self.stamps[at]]
        after = np.unique((self.kinks(group)[:, None] + AFTER_KINK).ravel())
        begin, end = self.stamps[at][[0, -1]]
        return [np.unique(self._ends[:, at]), after[(after > begin) & (after < end)]]

    def _on_nodes(
        self, group: Group, nodes: Sequence[FloatArray], delays: Sequence[Retimed] = ()
    ) -> tuple[Memo, dict[str, FloatArray]]:
        """A runner of operators on ``nodes`` and a group's kinks, and the commands there."""
        tables = self.tables(group)
        rows = np.unique(np.concatenate([t for t, _ in tables.values()]))
        nodes = [*nodes, rows[(rows > nodes[0][0]) & (rows < nodes[0][-1])]]
        grid = time_grid(self.kinks(group), nodes, delays=[op for op in delays if op.name in RETIMED])
        return Memo(grid), {COMMANDS[q]: command_at(table, grid) for q, table in tables.items()}

    def start(self) -> FloatArray:
        return self.prior_mean.copy()

    @property
    def likelihood_powers(self) -> Sequence[float]:
        """How far the evidence is trusted under each of the prior's widths."""
        return (self.trust,) * len(self.prior_scales)

    @property
    def sd_without_discrepancy(self) -> FloatArray:
        """Prior widths (p,) of the simulation by itself."""
        return self.prior_sd

    def under_simple_law(self, candidate: Candidate, unit: FloatArray) -> Fit | None:
        return None

    def warm_start(self, hypothesis: Sequence[Candidate], unit: FloatArray) -> Start | None:
        return None

    def quantities(self, nuisance: FloatArray) -> Mapping[str, tuple[float, str]]:
        return {}

    def lateness(self, fitted: Fit) -> Lateness | None:
        return None

    @abc.abstractmethod
    def evaluate(self, nuisance: FloatArray, active: Active, want_jacobian: bool = True) -> Evaluation:
        """Whitened residual and nuisance Jacobian."""
