"""Effects that happen by chance: no prediction moves, the noise is wider.

Instants that scatter make it so where a signal is steep; a reading that walks at random is noise that remembers all
that was before.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product

import numpy as np
from numpy.typing import NDArray

from gap.data.innovations import RowNoise, Wider
from gap.data.scatter import timing_log_bayes
from gap.inference.evidence import Fit
from gap.inference.hypothesis import Active, Rows
from gap.inference.linear import Projector
from gap.null.chains import Kept
from gap.null.groups import Group, GroupedSession
from sim_devices.chain import Effect, FloatArray, Walk
from sim_devices.stages.specimens import meets

SETTLED = 3.0
"""s after the last motion from which on nothing but chance is expected to change."""
FASTER = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
"""Times as fast as it walks all along that a reading may walk in motion alone."""


class ByChance:
    """What a block knows of chance: ``slope`` (C·n,) of the signal per s, where that is known, and ``counts`` (C·n,)
    of samples in a row."""

    session: GroupedSession
    library: Mapping[str, Effect]
    channels: tuple[str, ...]
    stamps: FloatArray
    rows: Rows
    groups: list[tuple[Group, slice]]
    measured: FloatArray
    counts: FloatArray | NDArray[np.int64]
    row_noise: RowNoise
    slope: FloatArray | None = None
    _in_motion_alone: Kept

    def by_chance(self, key: str) -> bool:
        """Whether an effect counts as noise, on steep parts or all along, not by the change of one draw."""
        return bool(self._walks(key, {})) or (self.slope is not None and bool(self._scatter(key, {})))

    def _scatter(self, key: str, values: Mapping[str, float]) -> Mapping[str, float]:
        """By channel, the rms (s) by which an effect scatters its instants; nothing of one that is not by chance."""
        effect = self.library[key]
        return effect.scatter(self.session.instrument, _all_of(effect, values)) if effect.scatter else {}

    def _walks(self, key: str, values: Mapping[str, float]) -> Mapping[str, Walk]:
        """By channel, how an effect lets its reading walk; nothing of another one."""
        effect = self.library[key]
        return effect.wander(_all_of(effect, values)) if effect.wander else {}

    def scattered(self, active: Active) -> FloatArray | None:
        """The variance (n,) that scattered instants add, averaged over a bin's samples; None without such effects."""
        variance: FloatArray | None = None
        for candidate, values in active.items():
            rms = self._scatter(candidate.key, values)
            if self.slope is None or not rms:
                continue
            variance = np.square(self.slope * self._by_row(rms)) / self.counts + (0.0 if variance is None else variance)
        return variance

    def wider(self, active: Active) -> Wider:
        """What the active effects add to the noise. Of walks by an amount and by a share only the former count."""
        every = {c.key: walks for c, values in active.items() if (walks := self._walks(c.key, values))}
        if not every:
            return Wider(self.scattered(active))
        relative = all(walk.relative for walks in every.values() for walk in walks.values())
        shape = len(self.channels), len(self.stamps)
        squares = np.zeros(shape)
        for key, walks in every.items():
            rms = self._by_row({c: w.rms for c, w in walks.items() if w.relative == relative})
            squares += np.square(rms).reshape(shape) * self._met(key)
        return Wider(self.scattered(active), np.sqrt(squares), self.measured.reshape(shape) if relative else None)

    def _met(self, key: str) -> FloatArray:
        """At which time stamps (n,) of 0 and 1 there is what an effect acts on."""
        out = np.zeros(len(self.stamps))
        for group, at in self.groups:
            out[at] = meets(self.library[key], group.name)
        return out

    def noise_scale(self, active: Active) -> FloatArray | None:
        """How many times wider the noise is by the active effects of chance."""
        wider = self.wider(active)
        return None if all(part is None for part in wider) else self.row_noise.sd(wider) / self.row_noise.sd()

    def _by_row(self, of_channels: Mapping[str, float]) -> FloatArray:
        return np.repeat([of_channels.get(c, 0.0) for c in self.channels], len(self.stamps))

    def chance_log_bayes(self, fitted: Fit) -> float:
        """Asked of a reading that walks: whether it does so in motion alone. And of scattered instants, by the samples
        that are by themselves in their bins; of two effects of chance together nothing is."""
        wider = self.wider(fitted.active)
        if wider.walks is not None:
            asked = tuple(c.key for c in fitted.hypothesis), fitted.nuisance.tobytes(), fitted.unit.tobytes()
            found: float = self._in_motion_alone.get(asked, lambda: self._walks_in_motion(fitted, wider))
            return found
        chance = [(c, rms) for c, values in fitted.active.items() if (rms := self._scatter(c.key, values))]
        times = self.noise_scale(fitted.active)
        if len(chance) != 1 or times is None or self.slope is None:
            return 0.0
        candidate, rms = chance[0]
        at = (self.counts == 1) & (self._by_row(rms) > 0)
        residual, reach = (fitted.residual * times)[at], (self.slope / self.row_noise.sd())[at]
        return timing_log_bayes(residual, reach, max(rms.values()), self.library[candidate.key].sparse)

    def _walks_in_motion(self, fitted: Fit, wider: Wider) -> float:
        """Nats by which a reading that walks in motion, and is right again or stays at rest, describes a fit's data
        better: then it is no chance, but an answer to the motion that is not understood."""
        moving = self._lately_moved()
        if wider.walks is None or np.all(moving):
            return 0.0
        rows = self.row_noise.unwhitened(np.column_stack([fitted.at_mean, fitted.jacobian]), wider)

        def log_likelihood(noise: Wider) -> float:
            """Of the data beside a nuisance that is refitted along straight lines."""
            white = self.row_noise.whitened(rows, noise)
            refit = Projector(white[:, 1:], fitted.prior_sd)
            return -0.5 * refit.chi2(white[:, 0]) - float(np.sum(np.log(self.row_noise.sd(noise))))

        anew = np.where(moving[: len(self.stamps)], 1.0, 0.0)
        in_motion = wider.walks * moving.reshape(wider.walks.shape)
        others = [wider._replace(walks=times * in_motion, kept=kept) for times, kept in product(FASTER, (None, anew))]
        return max(max(map(log_likelihood, others)) - log_likelihood(wider), 0.0)

    def _lately_moved(self) -> NDArray[np.bool_]:
        """Which rows (C·n,) lie in motion or within `SETTLED` s after one."""
        codes, names = self.rows.labels["phase"]
        moves = np.isin(codes, [k for k, name in enumerate(names) if name not in ("rest", "hold")])
        last, channel, out = -np.inf, -1, np.zeros(len(codes), dtype=bool)
        of_channel = self.rows.labels["channel"][0]
        for i, (moved, time) in enumerate(zip(moves.tolist(), self.rows.time.tolist(), strict=True)):
            if of_channel[i] != channel:
                last, channel = -np.inf, of_channel[i]
            last = time if moved else last
            out[i] = time - last < SETTLED
        return out

    def whitened(self, difference: FloatArray, active: Active) -> FloatArray:
        """``difference`` (n,) or (n, p) in σ, wider where an effect of chance makes it so."""
        return self.row_noise.whitened(difference, self.wider(active))

    def unwhitened(self, residual: FloatArray, active: Active) -> FloatArray:
        """The difference (n,), SI, of measurement and prediction behind a ``residual`` (n,)."""
        return self.row_noise.unwhitened(residual, self.wider(active))


def _all_of(effect: Effect, values: Mapping[str, float]) -> dict[str, float]:
    """All parameters of an effect, those that are not among the ``values`` at their defaults."""
    return {p.name: p.default for p in effect.parameters} | dict(values)
