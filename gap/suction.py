"""The suction instruments as two blocks of data: command -> recorded pressure, and recorded pressure -> apex height.

The first isolates the actuator: no tissue in it. The second is fed with the *smoothed* recorded pressure (raw gauge
noise would imitate friction and preload) and meets the tissue: the reduced law with its parameters free, and beside
it a discrepancy that other tissue laws could leave (`gap.tissue_null`), so that only what no tissue could do is
called a device effect.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from acquire.recording.model import Recording
from gap.blocks import SHIFT_SD, Block, Group, GroupedSession, Table, candidates_for, compressed
from gap.chains import needed
from gap.hypothesis import Active, Candidate, Evaluation, FloatArray, Problem
from gap.noise import denoised
from gap.rhythms import Lateness
from gap.session import CLOCK_SD
from gap.solve import Fit, fit, under
from gap.tissue_null import USUAL_MEMORY, Suction, elastic_freedom, suction_discrepancy
from sim_devices.chain import Chain, Effect
from sim_devices.stages import nominal
from sim_devices.stages.kernels import evaluate, low_pass
from sim_devices.stages.sampling import REFINEMENT, simulate
from sim_devices.stages.suction import REGULATOR_TAU, with_tissue
from sim_devices.stages.tissues import SuctionTissue, suction_tissue

TOGETHER, RESPONSE = 5e-3, 0.8
"""s: kinks nearer to each other are one; how long after one its response is looked at."""
LATE = 5.0
"""σ by which some kink must be late for lateness to be looked into."""
MOVES = 1e-3 * np.array([0.5, 1, 2, 3, 5, 8, 12, 18, 26, 36, 50, 70, 95, 130, 180, 250, 350])
"""s by which the response to a kink is moved to see where it fits."""
NO_TISSUE = SuctionTissue(0.0, creep=(), times=(), residual=0.0, softening=0.0)


def _chain(session: GroupedSession, group: Group, tissue: SuctionTissue, **options: Any) -> Chain:
    """The nominal chain for a group: ``tissue`` if it is skin, else what its specimen is."""
    law = tissue if group.skin else _specimen(group.specimen)
    return with_tissue(_nominal(session.instrument, session.marks, **options), law)


@lru_cache(maxsize=64)
def _nominal(instrument: str, marks: tuple[float, ...], **options: Any) -> Chain:
    return nominal(instrument, marks=marks, **options)


def _specimen(name: str) -> SuctionTissue:
    try:
        return suction_tissue(name)
    except ValueError:
        return suction_tissue("silicone")


def _commanded_line(chain: Chain, group: Group, time: FloatArray, early: Callable[[FloatArray], FloatArray]) -> Table:
    """True pressure that ``chain`` makes of a group's command: times finer than ``time`` (n,) s, within its span, and
    Pa; the record's stamps are ``early`` s (a function of them) before the command's clock."""
    kinks = group.commands["pressure"].time
    nodes = np.concatenate([(kinks[:, None] + REFINEMENT).ravel(), kinks])
    fine = np.unique(np.concatenate([time, nodes - early(nodes)]))
    fine = fine[(fine >= time[0]) & (fine <= time[-1])]
    partial = replace(chain, operators=needed(chain, ("line_pressure",)))
    return fine, simulate(partial, group.tables(), {"line_pressure": fine + early(fine)})["line_pressure"]


class PressureBlock(Block):
    """Command -> recorded pressure.

    Nuisance: the regulator's time constant and damping, the sampling convention (a shift within one sample), and
    three quick lags that other regulators than the nominal second-order one would add.
    """

    name, channels = "pressure", ("pressure",)
    floor = 10.0  # Pa: a tenth of the command's resolution
    LAGS = (0.015, 0.04, 0.1)
    GAUGE_GAIN, GAUGE_ZERO = 1e-3, 15.0  # tolerances of a sound gauge: relative, Pa (assumed)

    def __init__(self, session: GroupedSession, library: Mapping[str, Effect]) -> None:
        # An open probe holds no pressure: its record says nothing of the regulator.
        super().__init__(session, library, without=("open air",))
        self.prior_sd = self._prior(0.02, 0.03, 0.001)
        self.prior_mean = np.zeros(len(self.prior_sd))
        self.local = np.zeros(len(self.prior_sd), bool)
        # As a sound instrument of the nominal kind, or a regulator of another time and damping.
        self.alternatives = (self.prior_sd, self._prior(0.15, 0.3, 0.001))
        self._linear = np.column_stack([self._lag_columns(), self.measured, np.ones(len(self.stamps))])
        self.blur_steep_parts(self._slope())

    def _prior(self, tau: float, zeta: float, lag: float) -> FloatArray:
        lags = [lag] * len(self.LAGS)
        return np.array([tau, zeta, SHIFT_SD * self.dt, CLOCK_SD, *lags, self.GAUGE_GAIN, self.GAUGE_ZERO])

    def line(self, group: Group, time: FloatArray) -> Table:
        """What the regulator, as fitted to the recorded pressure, made of the command: times finer than ``time`` (n,)
        s, and Pa."""
        c = self._fitted
        chain = _chain(self.session, group, NO_TISSUE, command_step=0.0)
        chain = chain.tuned("regulator", tau=REGULATOR_TAU * float(np.exp(c[0])), zeta=float(np.exp(c[1])))
        fine, value = _commanded_line(chain, group, time, self.early)
        further = zip(c[4 : 4 + len(self.LAGS)], self.LAGS, strict=True)
        return fine, value + sum(k * (evaluate(low_pass, fine, value, tau) - value) for k, tau in further)

    def early(self, time: FloatArray) -> FloatArray:
        """How far the record's stamps ``time`` (n,) are before the command's clock, s."""
        c = self._fitted
        return np.asarray(c[2] + c[3] * (time - self.stamps[0]))

    def true(self, recorded: FloatArray) -> FloatArray:
        """Recorded pressures (n,) Pa without the gauge's error, as far as a sound one's goes."""
        gain, zero = self._fitted[-2:]
        return recorded * (1.0 - gain) - zero

    @cached_property
    def _fitted(self) -> FloatArray:
        return fit(self).nuisance

    def _slope(self) -> FloatArray:
        later, earlier = self.prior_mean.copy(), self.prior_mean.copy()
        later[2], earlier[2] = 1e-3, -1e-3
        return (self._predict(later, {}) - self._predict(earlier, {})) / 2e-3

    def _lag_columns(self) -> FloatArray:
        """What a further lag behind the nominal regulator would change (n, lags), Pa."""
        out = np.zeros((len(self.stamps), len(self.LAGS)))
        for g, at in self.groups:
            kinks = g.commands["pressure"].time
            fine = np.unique(np.concatenate([self.stamps[at], (kinks[:, None] + REFINEMENT).ravel()]))
            chain = _chain(self.session, g, NO_TISSUE, command_step=0.0)
            partial = replace(chain, operators=needed(chain, ("pressure",)))
            direct = simulate(partial, g.tables(), {"pressure": fine})["pressure"]
            for j, tau in enumerate(self.LAGS):
                out[at, j] = np.interp(self.stamps[at], fine, evaluate(low_pass, fine, direct, tau) - direct)
        return out

    def _predict(self, nuisance: FloatArray, active: Active) -> FloatArray:
        """Recorded pressure (n,) Pa."""
        tau, zeta = REGULATOR_TAU * np.exp(nuisance[0]), float(np.exp(nuisance[1]))
        out = np.empty(len(self.stamps))
        for g, at in self.groups:
            # Bins average over the staircase of the command's resolution: simulate its mean.
            chain = _chain(self.session, g, NO_TISSUE, command_step=0.0).tuned("regulator", tau=tau, zeta=zeta)
            shift = nuisance[2] + nuisance[3] * (self.stamps[at] - self.stamps[0])
            out[at] = self.simulated(self.with_effects(chain, active), g, at, shift)[0]
        return out + self._linear @ nuisance[4:]

    def anchored(
        self, hypothesis: Sequence[Candidate], unit: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray] | None:
        # Not from the null's shift, which has taken on what it could of a delay.
        return self.prior_mean, self.prior_mean, unit

    def lateness(self, fitted: Fit) -> Lateness | None:
        """Each kink's response, until the next, moved to and fro as a whole."""
        kinks = self.session.kinks[np.diff(self.session.kinks, prepend=-np.inf) > TOGETHER]
        number = np.searchsorted(kinks, self.stamps, side="right") - 1
        number[(number < 0) | (self.stamps - kinks[number] > RESPONSE)] = len(kinks)
        slope = fitted.jacobian[:, 2]

        def over(values: FloatArray) -> FloatArray:
            return np.bincount(number, values, len(kinks) + 1)[:-1].astype(float)

        known = over(slope**2)
        if not np.any(over(slope * fitted.residual) ** 2 > LATE**2 * known):
            return None
        moved = np.concatenate([-MOVES[::-1], [0.0], MOVES])
        rows = []
        # The nominal regulator and clock: the fitted ones have taken on what they could.
        nuisance = np.concatenate([np.zeros(len(fitted.nuisance) - 2), fitted.nuisance[-2:]])
        for move in moved:
            nuisance[2] = -move
            rows.append(self.evaluate(nuisance, fitted.active, want_jacobian=False).residual)
        chi2 = np.array([over(r**2) for r in rows])
        best = np.clip(np.argmin(chi2, axis=0), 1, len(moved) - 2)
        late, sd = np.zeros(len(kinks)), np.full(len(kinks), np.inf)
        for k in np.flatnonzero(known > 0):
            at, j = number == k, best[k]
            change = (rows[j + 1][at] - rows[j - 1][at]) / (moved[j + 1] - moved[j - 1])
            square = float(change @ change)
            if square > 0:
                step = -float(change @ rows[j][at]) / square
                late[k] = moved[j] + np.clip(step, moved[j - 1] - moved[j], moved[j + 1] - moved[j])
                sd[k] = np.sqrt(1.0 / square) * max(1.0, np.sqrt(chi2[j, k] / at.sum()))
        good = np.isfinite(sd)
        return Lateness(kinks[good], late[good], sd[good])

    def evaluate(self, nuisance: FloatArray, active: Active, want_jacobian: bool = True) -> Evaluation:
        predicted = self._predict(nuisance, active)
        residual = self.whitened(self.measured - predicted, active)
        if not want_jacobian:
            return Evaluation(residual, np.zeros((0, 0)))
        jacobian = np.empty((len(residual), len(nuisance)))
        for k, step in enumerate((1e-3, 1e-3, 0.05 * self.dt, 1e-6)):
            moved = nuisance.copy()
            moved[k] += step
            jacobian[:, k] = (self._predict(moved, active) - predicted) / step
        jacobian[:, 4:] = self._linear
        return Evaluation(residual, self.whitened(jacobian, active))


class HeightBlock(Block):
    """Recorded pressure -> apex height.

    Nuisance: the reduced tissue's parameters; per recording a gain (the skin's scatter from run to run), a zero and
    another before suction begins; the sampling convention; the elastic curve; the discrepancy of tissue laws.
    """

    name, channels = "height", ("apex_height",)
    trust = 0.12  # other tissue laws than ours leave some δ = 10 that some device effect can repair
    TISSUE: tuple[str, ...] = (
        "compliance", "knee", "exponent", "creep1", "creep2", "creep3", "creep4",
        "time1", "time2", "time3", "time4", "residual", "softening",
    )  # fmt: skip
    TISSUE_SD: tuple[float, ...] = (1.5, 1.0, 0.4, *[0.15] * 4, *[0.7] * 4, 0.1, 0.04)
    ANCHORED_SD: tuple[float, ...] = (0.5, 0.15, 0.08, *[0.08] * 4, *[0.3] * 4, 0.06, 0.03)
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
        self._runs = self.member
        onsets = {k: self._onset(g, k) for g, _ in self.groups for k in g.members}
        self._onsets = np.array([onsets[k] for k in self.runs])
        self._start: FloatArray | None = None
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
        self.alternatives = tuple(
            np.concatenate([self.prior_sd[:end], self.prior_sd[end:] * s]) for s in self.DISCREPANCY_SCALES
        )

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
            fine, base = _commanded_line(
                _chain(self.session, group, NO_TISSUE, command_step=0.0), group, time, np.zeros_like
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
        return replace(
            base,
            compliance=base.compliance * self._size * max(1.0 + c["compliance"], 1e-3),
            knee=base.knee * float(np.exp(c["knee"])),
            exponent=float(np.clip(base.exponent + c["exponent"], 0.02, 3.0)),
            creep=tuple(g + c[f"creep{i + 1}"] for i, g in enumerate(base.creep)),
            times=tuple(tau * float(np.exp(c[f"time{i + 1}"])) for i, tau in enumerate(base.times)),
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
            found = min((self._alone((), np.zeros(0), c) for c in self._guesses()), key=lambda f: f.objective)
            tissue = self.tissue(found.nuisance)
            memory = [v for pair in zip(tissue.creep, tissue.times, strict=True) for v in pair]
            curves = self._by_group(elastic_freedom, memory)[0]
            at = slice(self._curve_part.start - self._offset, self._curve_part.stop - self._offset)
            self._added[:, at] = curves * self._span
            self._start = self._alone((), np.zeros(0), found.nuisance, 30).nuisance
            self.prior_mean[:n] = self._start[:n]
            for sd in (self.prior_sd, *self.alternatives):
                sd[:n] = self.ANCHORED_SD
            self.prior_sd = fit(self, nuisance=self._start).best_prior(self.alternatives)
        return self._start.copy()

    def _guesses(self) -> list[FloatArray]:
        """Nuisance vectors (p,) to begin from."""
        times = np.array([name.startswith("time") for name in self.TISSUE])
        return [np.concatenate([at * times, np.zeros(len(self.prior_mean) - len(times))]) for at in (0.0, -0.8, 0.8)]

    @property
    def _offset(self) -> int:
        """Where the nuisance of what is simply added begins: behind the tissue, the shift and the gains."""
        return len(self.TISSUE) + 1 + self._runs.shape[1]

    @property
    def plain_sd(self) -> FloatArray:
        sd = self.alternatives[0].copy()
        sd[self._curve_part.stop :] = 1e-6
        return sd

    def _alone(
        self, hypothesis: Sequence[Candidate], unit: FloatArray, nuisance: FloatArray, iterations: int = 15
    ) -> Fit:
        """The simulation by itself fitted from ``nuisance`` (p,), ``unit`` (k,), the person's tissue not yet known."""
        sd = self.plain_sd
        sd[: len(self.TISSUE)] = self.TISSUE_SD
        alone = under(self, np.zeros(len(sd)), sd)
        return fit(alone, hypothesis, unit, nuisance, iterations)

    def anchored(
        self, hypothesis: Sequence[Candidate], unit: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray] | None:
        # Not from the null's tissue, which has taken on what it could of the effect.
        n = len(self.TISSUE)
        self.start()
        found = self._alone(hypothesis, unit, self._guesses()[0])
        mean = self.prior_mean.copy()
        mean[:n] = found.nuisance[:n]
        return mean, found.nuisance, found.unit

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
        return _chain(self.session, group, self.tissue(nuisance))

    def _chain_height(self, nuisance: FloatArray, active: Active) -> FloatArray:
        """Apex height of the chain (n,) m, before run scatter and discrepancy."""
        shift = nuisance[len(self.TISSUE)]
        out = np.empty(len(self.stamps))
        for (g, at), (t, p) in zip(self.groups, self._line, strict=True):
            chain = self.with_effects(self._law_chain(g, nuisance), active)
            if any(c.stage != "tissue" for c in active):
                p = p + self._gauge_error(chain, g, t)
            out[at] = self.simulated(chain, g, at, shift, {"line_pressure": (t, p)})[0]
        return out

    def _gauge_error(self, chain: Chain, group: Group, time: FloatArray) -> FloatArray | float:
        """What to add to the recorded pressure for the true one, (n,) Pa: nothing for an actuator's effect, the
        gauge's error for its own."""
        wanted = ("line_pressure", "pressure")
        sound = _nominal(self.session.instrument, self.session.marks)
        if needed(chain, wanted[1:], wanted[:1]) == needed(sound, wanted[1:], wanted[:1]):
            return 0.0
        partial = replace(chain, operators=needed(chain, wanted))
        made = simulate(partial, group.tables(), dict.fromkeys(wanted, time))
        return made["line_pressure"] - made["pressure"]

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
            moved = nuisance.copy()
            step = 1e-3 if k < n - 1 else 0.05 * self.dt
            moved[k] += step
            chain_part[:, k] = (self._chain_height(moved, active) - height) / step
        jacobian = np.hstack([chain_part * gain[:, None], self._runs * height[:, None], self._added])
        return Evaluation(residual, self.whitened(jacobian, active))


def suction_problems(
    recordings: Sequence[Recording],
    effects: Mapping[str, Effect],
    height: Callable[[GroupedSession, Mapping[str, Effect], PressureBlock | None], HeightBlock] = HeightBlock,
) -> tuple[Sequence[Problem], tuple[Candidate, ...]]:
    """The blocks that a session's channels allow, and the effects that show in them.

    ``height`` makes the block of the apex height: with the reduced tissue, or another one.

    Raises ValueError when what was commanded, or what was measured, is missing.
    """
    missing = [r.info.id for r in recordings if "pressure" not in r.setpoints]
    if missing:
        raise ValueError(f"recording {missing[0]} has no set-points of pressure: what was commanded is not known")
    session = GroupedSession(recordings, ("pressure",))
    blocks: list[Block] = []
    pressure = None
    if any("pressure" in r.streams for r in recordings):
        pressure = PressureBlock(session, effects)
        blocks.append(pressure)
    if any("apex_height" in r.streams for r in recordings):
        blocks.append(height(session, effects, pressure))
    if not blocks:
        raise ValueError(f"recording {recordings[0].info.id} has neither channel pressure nor apex_height")
    return blocks, candidates_for(effects, blocks)
