"""Effects that happen by chance: no prediction moves, the noise is wider.

Instants that scatter make it so where a signal is steep; a reading that walks at random is noise that remembers all
that was before, and a rhythm whose rate wanders is noise about one rate.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray

from gap.data.innovations import MOST, Rhythm, RowNoise, Wider
from gap.data.scatter import timing_log_bayes
from gap.inference.evidence import Fit
from gap.inference.hypothesis import Active, Rows
from gap.inference.linear import Projector
from gap.null.groups import Group, GroupedSession
from sim_devices.chain import Effect, FloatArray
from sim_devices.stages.specimens import meets

SETTLED = 3.0
"""s after the last motion from which on nothing but chance is expected to change."""
SHOWS = 0.15
"""Share of the greatest response from which on one counts."""
FASTER = (0.5, 2.0, 8.0)
"""Times as fast as it walks all along that a reading may walk in motion alone, or in proportion to the response;"""
SLOWER = (0.25, 0.5, 1.0)
"""and, where noise is remembered, all along."""
SHARES, TIMES = (0.15, 0.3, MOST), (0.2, 0.8, 3.2)
"""Slow noise that a sound sensor may have, as `gap.data.innovations` has it: shares of the white one, and s."""
ANY = (0.3, 0.6, 1.2, 2.4)
"""The same of the rest that a law leaves which is not the skin's."""
TURNS = 10.0
"""Turns for which a rhythm whose rate wanders keeps its phase: simulated rates that swing by 5 and 12 % (rms) fit best
with 6 to 24, and their amplitudes are right within a third."""
BESIDE = (0.6, 1.6)
"""Times its rate, where noise that is no rhythm has as much power."""


class ByChance:
    """The part of a block that knows of chance.

    ``slope`` (C·n,) is that of the signal per s, where it is known, ``counts`` (C·n,) the samples in a row, ``noise``
    (C,) that of a sample."""

    session: GroupedSession
    groups: Sequence[tuple[Group, slice]]
    library: Mapping[str, Effect]
    channels: tuple[str, ...]
    stamps: FloatArray
    rows: Rows
    measured: FloatArray
    counts: FloatArray | NDArray[np.int64]
    noise: FloatArray
    row_noise: RowNoise
    slope: FloatArray | None = None

    def by_chance(self, key: str) -> bool:
        """Whether an effect counts as noise, on steep parts or all along, not by the change of one draw."""
        walks = self._walks(key, {}) or self._rhythm(key, {})
        return bool(walks) or (self.slope is not None and bool(self._scatter(key, {})))

    def _scatter(self, key: str, values: Mapping[str, float]) -> Mapping[str, float]:
        """By channel, the rms (s) by which an effect scatters its instants; nothing of one that is not by chance."""
        effect = self.library[key]
        return effect.scatter(self.session.instrument, _all_of(effect, values)) if effect.scatter else {}

    def _walks(self, key: str, values: Mapping[str, float]) -> Mapping[str, float]:
        """By channel, the rms after a second by which an effect lets its reading walk; nothing of another one."""
        effect = self.library[key]
        return effect.wander(_all_of(effect, values)) if effect.wander else {}

    def _rhythm(self, key: str, values: Mapping[str, float]) -> Mapping[str, float]:
        """By channel, the rms of a rhythm whose rate wanders; nothing of another effect."""
        effect = self.library[key]
        return effect.rhythm(_all_of(effect, values)) if effect.rhythm else {}

    def scattered(self, active: Active) -> FloatArray | None:
        """The variance (n,) that scattered instants add, averaged over a bin's samples; None without such effects."""
        variance: FloatArray | None = None
        for candidate, values in active.items():
            rms = self._scatter(candidate.key, values)
            if self.slope is None or not rms:
                continue
            variance = np.square(self.slope * self._by_row(rms)) / self.counts + (0.0 if variance is None else variance)
        return variance

    def walking(self, active: Active) -> FloatArray | None:
        """How far the channels walk in a second, rms (C, n), row by row; None without such effects."""
        rms = [walks for candidate, values in active.items() if (walks := self._walks(candidate.key, values))]
        if not rms:
            return None
        together = np.linalg.norm([self._by_row(walks) for walks in rms], axis=0)
        return np.asarray(together).reshape(len(self.channels), -1)

    def beating(self, active: Active) -> Rhythm | None:
        """The rhythm of the channels whose rate wanders, if one acts on these specimens; else None."""
        for candidate, values in active.items():
            rms = [self._rhythm(candidate.key, values).get(channel, 0.0) for channel in self.channels]
            if any(rms) and any(meets(self.library[candidate.key], group.name) for group, _ in self.groups):
                rate = _all_of(self.library[candidate.key], values)["frequency"]
                return Rhythm(rate, TURNS / rate, np.array(rms))
        return None

    def wider(self, active: Active) -> Wider:
        """The noise that the active effects add."""
        return Wider(self.scattered(active), self.walking(active), rhythm=self.beating(active))

    @cached_property
    def _share_there(self) -> FloatArray:
        """The share of a channel's greatest response that is there, (C, n); 0 where it is mere noise, which a share of
        itself would explain."""
        there = self.measured.reshape(len(self.channels), -1)
        share = there / np.maximum(np.max(np.abs(there), axis=1, keepdims=True), np.finfo(float).tiny)
        return np.where(np.abs(share) > SHOWS, share, 0.0)

    def noise_scale(self, active: Active) -> FloatArray | None:
        """How many times wider the noise is by the active effects of chance."""
        wider = self.wider(active)
        return None if all(part is None for part in wider) else self.row_noise.sd(wider) / self.row_noise.sd()

    def remember(self, fitted: Fit, among: NDArray[np.bool_] | None = None) -> bool:
        """Take a slow part of the noise into account if a fit's rest shows one, ``among`` some of the time stamps (n,)
        where others would not tell (`RowNoise.remember`); whether there is one."""
        self.row_noise.remember(self.unwhitened(fitted.residual, fitted.active), self.noise.tolist(), among)
        return self.row_noise.memory is not None

    def _by_row(self, of_channels: Mapping[str, float]) -> FloatArray:
        return np.repeat([of_channels.get(c, 0.0) for c in self.channels], len(self.stamps))

    def chance_log_bayes(self, fitted: Fit) -> float:
        """Asked of the samples that are by themselves in their bins; of two effects of chance together nothing is."""
        chance = [(c, rms) for c, values in fitted.active.items() if (rms := self._scatter(c.key, values))]
        times = self.noise_scale(fitted.active)
        if len(chance) != 1 or times is None or self.slope is None:
            return 0.0
        candidate, rms = chance[0]
        at = (self.counts == 1) & (self._by_row(rms) > 0)
        residual, reach = (fitted.residual * times)[at], (self.slope / self.row_noise.sd())[at]
        return timing_log_bayes(residual, reach, max(rms.values()), self.library[candidate.key].sparse)

    def walk_log_bayes(self, fitted: Fit) -> float:
        wider = self.wider(fitted.active)
        if wider.rhythm is not None:
            return self._rhythm_log_bayes(fitted, wider, wider.rhythm)
        return np.inf if wider.walks is None else self._walk_log_bayes(fitted, wider, wider.walks)

    def _rhythm_log_bayes(self, fitted: Fit, beats: Wider, rhythm: Rhythm) -> float:
        """Nats for a rhythm against the best of its alternatives: noise of any colour, and a rhythm of another rate,
        as the rest of a law that is not the skin's has at each; and one that goes with the response."""
        alone = beats._replace(rhythm=None)
        colours = [self.row_noise, *(self.row_noise.remembering(*c, self.noise.tolist()) for c in product(ANY, TIMES))]
        beside = [beats._replace(rhythm=rhythm._replace(frequency=k * rhythm.frequency)) for k in BESIDE]
        asked = self._likelihood(fitted, beats)
        others = [asked(noise, alone) for noise in colours] + [asked(self.row_noise, other) for other in beside]
        return asked(self.row_noise, beats) - max(others)

    def _likelihood(self, fitted: Fit, wider: Wider) -> Callable[[RowNoise, Wider], float]:
        """The log likelihood by a noise and by effects of chance, of the data of a fit that had those of ``wider``,
        beside a nuisance that is refitted along straight lines."""
        rows = self.row_noise.unwhitened(np.column_stack([fitted.at_mean, fitted.jacobian]), wider)

        def log_likelihood(noise: RowNoise, by_chance: Wider) -> float:
            white = noise.whitened(rows, by_chance)
            refit = Projector(white[:, 1:], fitted.prior_sd)
            return -0.5 * refit.chi2(white[:, 0]) - float(np.sum(np.log(noise.sd(by_chance))))

        return log_likelihood

    def _walk_log_bayes(self, fitted: Fit, walk: Wider, rates: FloatArray) -> float:
        """Nats for the walk against the best of its alternatives: noise that a sound sensor remembers; a reading that
        walks in motion alone and is right again or stays at rest, an answer to the motion that is not understood; and
        one that walks in proportion to the response, as skin's tone does."""
        alone, log_likelihood = walk._replace(walks=None), self._likelihood(fitted, walk)
        memories = [self.row_noise]
        if self.row_noise.memory is None:
            memories += [self.row_noise.remembering(*one, self.noise.tolist()) for one in product(SHARES, TIMES)]
        remembered = max(memories, key=lambda noise: log_likelihood(noise, alone))
        moving = self._lately_moved()
        anew = np.where(moving[: len(self.stamps)], 1.0, 0.0)
        in_motion = rates * moving.reshape(rates.shape)
        others = [alone, *(walk._replace(walks=times * rates, loads=self._share_there) for times in FASTER)]
        if not np.all(moving):
            every = product(FASTER, (None, anew))
            others += [walk._replace(walks=times * in_motion, kept=kept) for times, kept in every]
        walks = [walk._replace(walks=times * rates) for times in SLOWER]
        own, other = (max(log_likelihood(remembered, noise) for noise in some) for some in (walks, others))
        return own - other

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
        """The difference (n,), SI, of measurement and prediction behind a ``residual`` (n,). A walk is an effect's, not
        the noise's: it is predicted from the rows before."""
        wider = self.wider(active)
        return residual * self.row_noise.sd(wider) if wider.remembers else self.row_noise.unwhitened(residual, wider)


def _all_of(effect: Effect, values: Mapping[str, float]) -> dict[str, float]:
    """All parameters of an effect, those that are not among the ``values`` at their defaults."""
    return {p.name: p.default for p in effect.parameters} | dict(values)
