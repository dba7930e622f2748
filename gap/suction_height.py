"""Recorded pressure -> apex height of a suction instrument.

The block is fed with the *smoothed* recorded pressure (raw gauge noise would imitate friction and preload) and meets
the tissue. Which law a person's skin has, nobody knows: simple ones are tried first, with an elastic curve of three
parameters and two creep times or a power law of time; then four creep times under any elastic curve; then, beside
these, a discrepancy that other laws could leave (`gap.tissue_null`), so that only what no tissue could do is called a
device effect. What is less simple must earn its freedom (`Problem.alternatives`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np

from gap.blocks import SHIFT_SD, Block, Group, GroupedSession, Table, compressed
from gap.chains import Kept, needed
from gap.hypothesis import Active, Candidate, Evaluation, FloatArray, Start
from gap.noise import denoised
from gap.solve import Fit, fit, under
from gap.suction_pressure import NO_TISSUE, PressureBlock, chain_of, commanded_line, sound_chain
from gap.tissue_null import USUAL_MEMORY, Suction, elastic_freedom, suction_discrepancy
from gap.workers import each
from sim_devices.chain import Chain, Effect
from sim_devices.effects.tissue import power_law_creep
from sim_devices.stages.sampling import simulate
from sim_devices.stages.suction import elastic_height
from sim_devices.stages.tissues import SuctionTissue, suction_tissue

SIMPLE_SHIFT = 1e-3
"""s: how late a channel may be that samples, neither holds nor integrates."""
POWER = 0.25
"""Amount and exponent of power-law creep from which fits begin."""
ENOUGH = 1.05
"""χ² per sample of a simple law at which the usual one is not tried."""
FROZEN = 1e-9
"""Prior width at which a parameter of the tissue does not move, and its derivative is not asked for."""
Try = tuple[int, FloatArray, int]
"""A fit of the simulation by itself: which of the `alternatives`, the nuisance (p,) to begin from, iterations."""


@lru_cache(maxsize=64)
def _reach(suction: float, knee: float, exponent: float) -> float:
    """Elastic height at a ``suction`` (Pa) for a compliance of 1 m/Pa, m."""
    return float(elastic_height(np.zeros(1), np.array([-suction]), 1.0, knee, exponent)[0])


def _probability(alone: tuple[Fit, int]) -> float:
    """log evidence of a law fitted alone."""
    return alone[0].log_evidence(1.0, (alone[0].prior_sd,))


class HeightBlock(Block):
    """Recorded pressure -> apex height.

    Nuisance: the reduced tissue's parameters; per recording a gain (the skin's scatter from run to run), a zero and
    another before suction begins; the sampling convention; the elastic curve; the discrepancy of tissue laws.
    """

    name, channels = "height", ("apex_height",)
    jobs = 1  # processes that share the fits of `start`
    trust = 0.12  # other tissue laws than ours leave some δ = 10 that some device effect can repair
    trust_simple = 0.16  # of a simple law, where the data prefer it
    TISSUE: tuple[str, ...] = (
        "compliance", "knee", "exponent", "creep1", "creep2", "creep3", "creep4",
        "time1", "time2", "time3", "time4", "residual", "softening", "power", "fraction",
    )  # fmt: skip
    TISSUE_SD: tuple[float, ...] = (1.5, 1.0, 0.4, *[0.15] * 4, *[0.7] * 4, 0.1, 0.04, 0.3, 0.7)
    CREEP: ClassVar[Mapping[str, str]] = {
        "creep1": "time1",
        "creep2": "time2",
        "creep3": "time3",
        "creep4": "time4",
        "power": "fraction",
    }  # amounts and what is nothing without them
    SIMPLE_LAWS: tuple[tuple[str, ...], ...] = (("creep2", "creep3"), ("power",))  # the creep that each of them has,
    USUAL_LAW: tuple[str, ...] = ("creep1", "creep2", "creep3", "creep4")  # and that of a person's skin at large
    SIMPLE_CURVE = 1e-3  # of the elastic curve's freedom, under a simple law
    ANCHORED_SD: tuple[float, ...] = (0.5, 0.15, 0.08, *[0.15] * 4, *[0.3] * 4, 0.06, 0.03, 0.3, 0.3)
    GAIN_SD = 0.05
    ZERO_SD = 0.01  # of the largest height: skin still recovers while the instrument takes its zero
    CURVE_SD = 0.1  # of the largest height, per elastic curve
    DISCREPANCY_SD = 0.02  # of the height, per basis function of weight 1
    DISCREPANCY_SCALES = (0.001, 0.03, 0.1, 0.3, 1.0, 3.0)  # the first: a law that is known but for its parameters
    DISCREPANCY_SIZE = 100

    def __init__(
        self, session: GroupedSession, library: Mapping[str, Effect], pressure: PressureBlock | None = None
    ) -> None:
        super().__init__(session, library)
        self._tissue = suction_tissue("forearm")
        self._pressure = pressure
        self._line = [self._smoothed(g) for g, _ in self.groups]
        strongest = (-float(p.min()) for (g, _), (_, p) in zip(self.groups, self._line, strict=True) if g.skin)
        self._strongest = max(strongest, default=0.0) or 1e3  # Pa; without skin any will do
        self._runs = self.member
        onsets = {k: self._onset(g, k) for g, _ in self.groups for k in g.members}
        self._onsets = np.array([onsets[k] for k in self.runs])
        self._fed_before = Kept(8)
        self._start: FloatArray | None = None
        self._tries: list[Try] = []
        self._size = 1.0
        self._span = size = max(float(np.ptp(self.measured)), 10 * float(np.median(self.sigma)))
        # Whether a reading is zeroed when it begins, at the first suction or at both, instruments do not agree.
        zeros = np.hstack([self._runs, self._runs * (self.stamps[:, None] < self._onsets)])
        curves = self._by_group(elastic_freedom, USUAL_MEMORY)[0]
        columns, weights = compressed(*self._by_group(suction_discrepancy), self.DISCREPANCY_SIZE)
        self._added = np.hstack([zeros, curves * size, columns * size])
        n, r, z = len(self.TISSUE) + 1, self._runs.shape[1], zeros.shape[1]
        self._curve_part = slice(n + r + z, n + r + z + curves.shape[1])
        zero = float(np.hypot(self.noise[0], self.ZERO_SD * size))
        own = [SHIFT_SD * self.dt, *[self.GAIN_SD] * r, *[zero] * z, *[self.CURVE_SD] * curves.shape[1]]
        self.prior_sd = np.concatenate([self.TISSUE_SD, own, self.DISCREPANCY_SD * weights])
        self.prior_mean = np.zeros(len(self.prior_sd))
        self.local = np.zeros(len(self.prior_sd), bool)
        self.local[n : n + r + z] = True
        later = self.prior_mean.copy()
        later[: len(self.TISSUE)] = self._first_guess()[:-1]
        earlier = later.copy()
        later[n - 1], earlier[n - 1] = 1e-3, -1e-3
        self.blur_steep_parts((self._chain_height(later, {}) - self._chain_height(earlier, {})) / 2e-3)
        end = self._curve_part.stop  # where the discrepancy begins; without skin it is empty
        self._amounts = np.array([self.TISSUE.index(name) for name in self.CREEP], dtype=int)
        self.prior_mean[self._amounts] = self._no_creep()
        widths = [np.concatenate([self.prior_sd[:end], self.prior_sd[end:] * s]) for s in self.DISCREPANCY_SCALES]
        simple = [self._simple(widths[0], law) for law in self.SIMPLE_LAWS]
        self.alternatives = (*simple, *(self._creeping(sd, self.USUAL_LAW) for sd in widths))

    def _no_creep(self) -> list[float]:
        """The nuisance at which each amount of creep is none."""
        return [0.0 if name == "power" else -self._tissue.creep[int(name[-1]) - 1] for name in self.CREEP]

    def _creeping(self, sd: FloatArray, law: Sequence[str]) -> FloatArray:
        """Prior widths ``sd`` (p,) with the creep of ``law`` only."""
        out = sd.copy()
        for amount, of in self.CREEP.items():
            if amount not in law:
                out[[self.TISSUE.index(amount), self.TISSUE.index(of)]] = FROZEN
        return out

    def _simple(self, sd: FloatArray, law: Sequence[str]) -> FloatArray:
        """Those of a simple law: an elastic curve of three parameters, a channel that neither holds nor integrates."""
        out = self._creeping(sd, law)
        out[len(self.TISSUE)] = SIMPLE_SHIFT
        out[self._curve_part] *= self.SIMPLE_CURVE
        return out

    def _onset(self, group: Group, k: int) -> float:
        """When suction is first commanded in recording ``k``, s; its begin where it never is."""
        time, value = group.commands["pressure"].time, group.commands["pressure"].value
        begin, end = self.session.span(k)
        acting = np.flatnonzero((value != 0) & (time >= begin) & (time <= end))
        return float(time[max(acting[0] - 1, 0)]) if len(acting) else begin

    def tables(self, group: Group) -> dict[str, Table]:
        """The commands by the record's clock: a zero that is taken milliseconds off is off by as many micrometres."""
        if self._pressure is None:
            return group.tables()
        return {q: (t - self._pressure.early(t), value) for q, (t, value) in group.tables().items()}

    def _smoothed(self, group: Group) -> Table:
        """Recorded pressure of a group as a table, without its gauge noise; the command where none was recorded."""
        times, values = [], []
        for k in group.members:
            series = self.session.recordings[k].streams.get("pressure")
            if series is not None:
                value = np.asarray(series.value, dtype=float)
                good = np.isfinite(value)
                times.append(self.session.time(k, series)[good])
                values.append(value[good])
        if not times:
            return group.tables()["pressure"]
        time, value = np.concatenate(times), np.concatenate(values)
        if self._pressure is None:
            fine, base = commanded_line(
                chain_of(self.session, group, NO_TISSUE, command_step=0.0), group, time, np.zeros_like
            )
        else:
            (fine, base), value = self._pressure.line(group, time), self._pressure.true(value)
        remainder = denoised(time, value - np.interp(time, fine, base))
        return fine, base + np.interp(fine, time, remainder)

    def _by_group(
        self, basis: Callable[..., tuple[FloatArray, FloatArray]], *more: Any
    ) -> tuple[FloatArray, FloatArray]:
        """A basis (n, q) over all groups, nought where there is no skin, and its weights (q,)."""
        parts, weights = [], np.zeros(0)
        guess = self._chain_height(self._first_guess(), {})
        marks = np.array([self.session.span(k)[0] for k in self.runs])
        for (g, at), (t, p) in zip(self.groups, self._line, strict=True):
            columns, weights = basis(Suction(t, p, guess[at], self.stamps[at], marks, self._onsets), *more)
            parts.append(columns * float(g.skin))
        return np.vstack(parts), weights

    def tissue(self, nuisance: FloatArray) -> SuctionTissue:
        """The reduced tissue at a nuisance vector."""
        c = dict(zip(self.TISSUE, nuisance, strict=False))
        base = self._tissue
        knee = base.knee * float(np.exp(c["knee"]))
        exponent = float(np.clip(base.exponent + c["exponent"], 0.02, 3.0))
        fraction = float(np.clip(POWER * np.exp(c["fraction"]), 0.03, 0.9))
        memory = [
            (g + c[f"creep{i + 1}"], tau * float(np.exp(c[f"time{i + 1}"])))
            for i, (g, tau) in enumerate(zip(base.creep, base.times, strict=True))
            if abs(g + c[f"creep{i + 1}"]) > FROZEN
        ]
        memory += power_law_creep(c["power"], fraction) if c["power"] else []
        # The compliance is that at the strongest suction: knee and exponent then bend the curve and do not scale it.
        scale = _reach(self._strongest, base.knee, base.exponent) / _reach(self._strongest, knee, exponent)
        return replace(
            base,
            compliance=base.compliance * scale * self._size * max(1.0 + c["compliance"], 1e-3),
            knee=knee,
            exponent=exponent,
            creep=tuple(g for g, _ in memory),
            times=tuple(tau for _, tau in memory),
            residual=base.residual + c["residual"],
            softening=base.softening + c["softening"],
        )

    def start(self) -> FloatArray:
        """The simulation by itself, fitted alone; the tissue's parameters are then the prior's mean.

        Beside a free discrepancy, which can do all that they do and linearly, they would run away. The fit begins from
        slower and quicker skin too: creep times have local optima.
        """
        if self._start is None:
            n = len(self.TISSUE)
            first, *others = self._guesses()
            full = len(self.SIMPLE_LAWS)
            tries = [*((k, first, 40) for k in range(full)), *((0, c, 40) for c in others)]
            alone = self._alone((), np.zeros(0), [*tries, *((full, c, 15) for c in (first, *others))], self.jobs)
            found, law = max(alone, key=_probability)
            simple, k = max((a for a in alone if a[1] < full), key=_probability)
            # A simple law cannot take on much of an effect, the usual one can: with an effect it begins anew.
            self._tries = [(k, simple.nuisance, 25), *([(full, first, 15)] if law == full else [])]
            tissue = self.tissue(found.nuisance)
            memory = [v for pair in zip(tissue.creep, tissue.times, strict=True) for v in pair]
            curves = self._by_group(elastic_freedom, memory)[0]
            at = slice(self._curve_part.start - self._offset, self._curve_part.stop - self._offset)
            self._added[:, at] = curves * self._span
            self._start = self._alone((), np.zeros(0), [(law, found.nuisance, 30)])[0][0].nuisance
            self._hold(self.prior_mean, self._start)
            for sd in (self.prior_sd, *self.alternatives):
                sd[:n] = np.minimum(sd[:n], self.ANCHORED_SD)
            self.prior_sd = fit(self, nuisance=self._start).best_prior(self.alternatives)
        return self._start.copy()

    def _hold(self, mean: FloatArray, nuisance: FloatArray) -> None:
        """The tissue at ``nuisance`` becomes the prior's ``mean``, but for how much it creeps."""
        mean[: len(self.TISSUE)] = nuisance[: len(self.TISSUE)]
        mean[self._amounts] = self._no_creep()

    def _guesses(self) -> list[FloatArray]:
        """Nuisance vectors (p,) to begin from."""
        times = np.array([name.startswith("time") for name in self.TISSUE])
        out = []
        for at in (0.0, -0.8, 0.8):
            guess = np.zeros(len(self.prior_mean))
            guess[: len(times)] = at * times
            if "power" in self.TISSUE:
                guess[self.TISSUE.index("power")] = POWER
            out.append(guess)
        return out

    @property
    def _offset(self) -> int:
        """Where the nuisance of what is simply added begins: behind the tissue, the shift and the gains."""
        return len(self.TISSUE) + 1 + self._runs.shape[1]

    @property
    def trusts(self) -> Sequence[float]:
        return (*[self.trust_simple] * len(self.SIMPLE_LAWS), *[self.trust] * len(self.DISCREPANCY_SCALES))

    @property
    def plain_sd(self) -> FloatArray:
        sd = self.alternatives[len(self.SIMPLE_LAWS)].copy()
        sd[self._curve_part.stop :] = 1e-6
        return sd

    def _alone(
        self, hypothesis: Sequence[Candidate], unit: FloatArray, tries: Sequence[Try], jobs: int = 1
    ) -> list[tuple[Fit, int]]:
        """The simulation by itself, the person's tissue not yet known, with effects from ``unit`` (k,) on: a fit for
        each of the ``tries``, and which of the `alternatives` it is. The usual law is left out where a simple one is
        at the noise."""
        usual = self.plain_sd
        usual[: len(self.TISSUE)] = self.TISSUE_SD
        laws = [*(self._simple(usual, law) for law in self.SIMPLE_LAWS), self._creeping(usual, self.USUAL_LAW)]
        mean = np.zeros(len(usual))
        mean[self._amounts] = self._no_creep()

        def fitted(one: Try) -> tuple[Fit, int]:
            k, guess, iterations = one
            begin = guess.copy()
            begin[self._amounts] = np.where(laws[k][self._amounts] <= FROZEN, self._no_creep(), begin[self._amounts])
            return fit(under(self, mean, laws[k]), hypothesis, unit, begin, iterations), k

        full = len(self.SIMPLE_LAWS)
        found = each(fitted, [one for one in tries if one[0] < full], jobs)
        for one in tries:
            if one[0] == full and not any(f.objective < ENOUGH * len(self.measured) for f, _ in found):
                found.append(fitted(one))
        return found

    def anchored(self, hypothesis: Sequence[Candidate], unit: FloatArray) -> Start | None:
        self.start()
        guess = self._guesses()[0]
        tries = self._tries or [
            *((k, guess, 25) for k in range(len(self.SIMPLE_LAWS))),
            (len(self.SIMPLE_LAWS), guess, 15),
        ]
        found, law = max(self._alone(hypothesis, unit, tries), key=_probability)
        mean = self.prior_mean.copy()
        self._hold(mean, found.nuisance)
        return Start(mean, self.alternatives[law], found.nuisance, found.unit)

    def _first_guess(self) -> FloatArray:
        """Tissue and shift (t,) at a size of the compliance that gives the largest height measured."""
        c = np.zeros(len(self.TISSUE) + 1)
        self._size = 1.0
        skin = np.concatenate([np.full(at.stop - at.start, g.skin) for g, at in self.groups])
        top = float(np.max(np.abs(self._chain_height(c, {})[skin]), initial=0.0))
        if top > 0:
            self._size = max(float(np.max(self.measured[skin])), 1e-7) / top
        return c

    def _law_chain(self, group: Group, nuisance: FloatArray) -> Chain:
        """The nominal chain of a group with the tissue at a nuisance vector."""
        return chain_of(self.session, group, self.tissue(nuisance))

    def _chain_height(self, nuisance: FloatArray, active: Active) -> FloatArray:
        """Apex height of the chain (n,) m, before run scatter and discrepancy."""
        shift = nuisance[len(self.TISSUE)]
        out = np.empty(len(self.stamps))
        for (g, at), line in zip(self.groups, self._line, strict=True):
            chain = self.with_effects(self._law_chain(g, nuisance), active)
            out[at] = self.simulated(chain, g, at, shift, {"line_pressure": self._fed(chain, g, active, line)})[0]
        return out

    def _fed(self, chain: Chain, group: Group, active: Active, line: Table) -> Table:
        """The true pressure, where ``line`` is the recorded one: as it is for an actuator's effect, less the gauge's
        error for its own."""
        wanted = ("line_pressure", "pressure")
        sound = sound_chain(self.session.instrument, self.session.marks)
        if all(c.stage == "tissue" for c in active):
            return line
        if needed(chain, wanted[1:], wanted[:1]) == needed(sound, wanted[1:], wanted[:1]):
            return line
        partial = replace(chain, operators=needed(chain, wanted))
        time, pressure = line

        def corrected() -> Table:
            made = simulate(partial, group.tables(), dict.fromkeys(wanted, time))
            return time, pressure + (made["line_pressure"] - made["pressure"])

        return self._fed_before.get((group.specimen, id(time), partial), corrected)

    def evaluate(self, nuisance: FloatArray, active: Active, want_jacobian: bool = True) -> Evaluation:
        n, r = len(self.TISSUE) + 1, self._runs.shape[1]
        gain = 1 + self._runs @ nuisance[n : n + r]
        height = self._chain_height(nuisance, active)
        predicted = height * gain + self._added @ nuisance[n + r :]
        residual = self.whitened(self.measured - predicted, active)
        if not want_jacobian:
            return Evaluation(residual, np.zeros((0, 0)))
        chain_part = np.empty((len(residual), n))
        for k in range(n):
            if self.prior_sd[k] <= FROZEN:
                chain_part[:, k] = 0.0
                continue
            moved = nuisance.copy()
            step = 1e-3 if k < n - 1 else 0.05 * self.dt
            moved[k] += step
            chain_part[:, k] = (self._chain_height(moved, active) - height) / step
        jacobian = np.hstack([chain_part * gain[:, None], self._runs * height[:, None], self._added])
        return Evaluation(residual, self.whitened(jacobian, active))
