"""Command -> recorded pressure of a suction instrument: the actuator by itself, no tissue in it."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, lru_cache
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from gap.data.command import in_whole_steps
from gap.data.innovations import RowNoise
from gap.data.polled import Ripple, ripple_of
from gap.data.tolerances import Tolerance
from gap.inference.evidence import Fit
from gap.inference.hypothesis import FROZEN, Active, Candidate, Evaluation, Lateness, Start
from gap.inference.least_squares import fit, under
from gap.null.blocks import Block, Group, GroupedSession, Table
from gap.null.chains import needed
from gap.null.suction_regulator import (
    CLOCK,
    EMPTIES,
    GAIN,
    SHIFT,
    STAYS,
    UNKNOWN,
    VALVE,
    VENTED,
    Vent,
    prior_widths,
    quantities,
    regulated,
    steps,
)
from gap.null.suction_structures import NOISY, WORTH, Structure, other_structure
from sim_devices.chain import Chain, Effect, FloatArray
from sim_devices.stages import nominal
from sim_devices.stages.sampling import REFINEMENT, simulate
from sim_devices.stages.suction import COMMAND_STEP, tissue_operators
from sim_devices.stages.tissues import SuctionTissue, suction_tissue

TOGETHER, RESPONSE = 5e-3, 0.8
"""s: kinks nearer to each other are one; how long after one its response is looked at."""
LATE = 5.0
"""σ by which some kink must be late for lateness to be looked into."""
MOVES = 1e-3 * np.array([0.5, 1, 2, 3, 5, 8, 12, 18, 26, 36, 50, 70, 95, 130, 180, 250, 350])
"""s by which the response to a kink is moved to see where it fits."""
IGNORED = 1e3
"""Times the noise of rows that are left out."""
SETTLED = 8
"""Samples before suction from which on it can be told where a pressure rests."""
AWAY, BACK = 8.0, 4.0
"""σ by which a recording must begin off where it rests to count as begun in motion, and from which on it rests."""
QUIET = 1e-6
"""Share of the most telling kink's information on lateness below which a kink says nothing."""
EMPTY = 500.0
"""Pa of suction from which on a line is not vented."""
SAMPLED, SLOW, AT_EASE = 5.0, 0.012, 20.0
"""χ² from which on samples are means over a period, or none (odds of twelve), s of a period from which on that matters,
and the penalty of a regulator that is not strained, which no other samples excuse."""
NO_TISSUE = SuctionTissue(0.0, creep=(), times=(), residual=0.0, softening=0.0)


def chain_of(session: GroupedSession, group: Group, tissue: SuctionTissue, **options: Any) -> Chain:
    """The nominal chain for a group: ``tissue`` if it is skin, else its specimen."""
    law = tissue if group.skin else _specimen(group.name)
    chain = sound_chain(session.instrument, session.marks, **options)
    laws = {op.name: op for op in tissue_operators(law)}
    return replace(chain, operators=tuple(laws.get(op.name, op) for op in chain.operators))


@lru_cache(maxsize=64)
def sound_chain(instrument: str, marks: tuple[float, ...], **options: Any) -> Chain:
    """The nominal chain of an instrument that is armed anew at ``marks`` (s)."""
    return nominal(instrument, marks=marks, **options)


def _specimen(name: str) -> SuctionTissue:
    try:
        return suction_tissue(name)
    except ValueError:
        return suction_tissue("silicone")


def commanded_line(
    chain: Chain,
    tables: Mapping[str, Table],
    kinks: FloatArray,
    time: FloatArray,
    early: Callable[[FloatArray], FloatArray],
) -> Table:
    """True pressure that ``chain`` makes of a command's ``tables``, with ``kinks`` (k,) s: times finer than ``time``
    (n,) s, within its span, and Pa; the record's stamps are ``early`` s (a function of them) before the command's
    clock."""
    nodes = np.concatenate([(kinks[:, None] + REFINEMENT).ravel(), kinks])
    fine = np.unique(np.concatenate([time, nodes - early(nodes)]))
    fine = fine[(fine >= time[0]) & (fine <= time[-1])]
    partial = replace(chain, operators=needed(chain, ("line_pressure",)))
    return fine, simulate(partial, tables, {"line_pressure": fine + early(fine)})["line_pressure"]


def vented(pressure: FloatArray) -> FloatArray:
    """How far (n,), 0 to 1, a line at ``pressure`` (n,) Pa is vented."""
    return np.clip(1.0 + pressure / EMPTY, 0.0, 1.0)


class PressureBlock(Block):
    """Command -> recorded pressure.

    Nuisance: the regulator's time constant and damping, the sampling convention (a shift within one sample), three
    quick lags and a lead that other regulators than the nominal second-order one would add, and, where nothing less
    comes to the noise, a limited rate, or the integral, set-point weight and uneven flow of a loop about a valve. Where
    it may be ``unknown``, only that is tried: whoever asks for it knows that nothing else will do. ``channel`` is the
    gauge's.
    """

    name = "pressure"
    floor = 5.0  # Pa: a twentieth of the command's resolution
    trust_other = 0.25  # where the regulator is of another structure, ours of that structure is not quite it
    vent = STAYS  # as physics has it: a chamber vents to the air and no further
    whole = held = False  # whether levels are held at whole steps of the command's resolution, sampled rows at all

    def __init__(
        self,
        session: GroupedSession,
        library: Mapping[str, Effect],
        unknown: bool = False,
        channel: str = "pressure",
    ) -> None:
        self.channels = (channel,)
        # An open probe holds no pressure: its record says nothing of the regulator.
        super().__init__(session, library, without=("open air",))
        self.row_noise.widen(np.flatnonzero(self._in_motion()), IGNORED)
        self.prior_sd = self.prior(lambda t: t.value)
        self.prior_mean = self.sound = np.zeros(len(self.prior_sd))
        self._begin = self.prior_mean
        # As a sound instrument of the nominal kind, or a regulator of another time and damping.
        self.prior_scales = (self.prior_sd, self.prior(lambda t: t.widest))
        self.blur_steep_parts(self._slope())
        best = self._followed(self._vented(self._averaged(self._resolved(self._second_order()))))
        self.structure = other_structure(self, best, unknown)
        if self.structure is not None:
            self._take(self.structure)
            best = self._averaged(self._resolved(fit(self)))
        best = self._followed(best)
        self._begin = best.nuisance
        left = self.unwhitened(best.residual, {})
        self.row_noise.remember(left, self.noise.tolist())
        rest = self.whitened(left, {})
        self.explained = float(rest @ rest) < len(rest) * NOISY  # by a regulator that is known

    def _resolved(self, found: Fit) -> Fit:
        """The better fit of ``found`` and of one whose levels are whole steps of the command's resolution, or not."""
        return self._better(found, whole=not self.whole)

    def _averaged(self, found: Fit) -> Fit:
        """The better fit of ``found`` and of one whose samples are means over a sampling period, or are none."""
        moot = self.dt < SLOW or found.penalty > AT_EASE
        return found if moot else self._better(found, SAMPLED, averaged=not self.averaged)

    def sampled_otherwise(self) -> Self:
        """The block as if its samples were means over a sampling period, or none, if they are taken for such."""
        out = copy.copy(self)
        vars(out).update(self.sampled(not self.averaged))
        vars(out).pop("_fitted", None)
        return out

    def _followed(self, found: Fit) -> Fit:
        """The better fit of ``found`` and of one whose sampled commands are held at each row, or straight between."""
        return self._better(found, held=not self.held) if self.session.sampled else found

    def _vented(self, found: Fit) -> Fit:
        """The better fit of ``found``, whose regulator vents to the air and no further, and of one that swings above
        it, as a line with a supply of its own pressure may, and a second order by itself does."""
        return self._better(found, vent=EMPTIES)

    def _better(self, found: Fit, worth: float = WORTH, **other: Any) -> Fit:
        """``found``, or the fit with ``other`` attributes of the block, taken on if that is ``worth`` it."""
        looked = under(self, self.prior_mean, self.prior_sd)
        changed = {**self.sampled(other.get("averaged", self.averaged)), **other}  # grids anew, of other commands maybe
        vars(looked).update(changed)
        again = fit(looked, nuisance=found.nuisance)
        if again.objective > found.objective - worth:
            return found
        vars(self).update(changed)
        return again

    def _take(self, structure: Structure) -> None:
        """Let a regulator of another structure be a third width of the prior."""
        self.prior_scales, self.prior_sd = (*self.prior_scales, structure.width), structure.width
        self._begin, self.vent = structure.begin, structure.vent
        if structure.keeps:
            self.row_noise = self._for_an_integral_that_stays

    def with_integral(self, width: FloatArray, vent: Vent) -> Self:
        """The block with a loop of an integral that vents as ``vent`` has it, under a ``width`` (p,) of the prior."""
        out = under(self, self.prior_mean, width)
        out.vent = vent
        if vent == STAYS:
            out.row_noise = self._for_an_integral_that_stays
        return out

    @cached_property
    def _for_an_integral_that_stays(self) -> RowNoise:
        """The rows' noise without those of the first stretch of suction in recordings that follow one of another
        specimen: the integral is of a command that is not in theirs."""
        out = copy.copy(self.row_noise)
        out.widen(np.flatnonzero(self._after_others()), IGNORED)
        return out

    @property
    def likelihood_powers(self) -> Sequence[float]:
        return (self.trust, self.trust, self.trust_other)[: len(self.prior_scales)]

    @property
    def unknown(self) -> bool:
        """Whether the regulator is of a structure that nobody knows."""
        return bool(self.prior_sd[UNKNOWN.start] > FROZEN)

    def start(self) -> FloatArray:
        return self._begin.copy()

    def prior(self, width: Callable[[Tolerance], float], opened: slice = slice(0)) -> FloatArray:
        """Prior widths (p,) of a sound instrument, by the one of its tolerances that ``width`` takes."""
        return prior_widths(self.tolerances, self.shift_sd, width, opened)

    def _in_motion(self) -> NDArray[np.bool_]:
        """Rows (n,) of recordings that begin while the pressure still comes back from the one before, until it rests:
        of that state no command tells."""
        out = np.zeros(len(self.stamps), dtype=bool)
        for k in self.runs:
            rest = np.flatnonzero((self.run == k) & (self.stamps < self.session.onset(k)))
            if len(rest) < SETTLED:
                continue
            off = np.abs(self.measured[rest] - np.median(self.measured[rest[len(rest) // 2 :]])) / self.sigma[rest]
            if off[0] > AWAY:
                out[rest[: 1 + np.flatnonzero(off > BACK)[-1]]] = True
        return out

    def _after_others(self) -> NDArray[np.bool_]:
        """Rows (n,) of the first stretch of suction in recordings that follow one of another specimen."""
        out = np.zeros(len(self.stamps), dtype=bool)
        for group, _ in self.groups:
            for k in group.members:
                if k > 0 and k - 1 not in group.members and np.any(self._asked(group, k)):
                    begin = self.session.onset(k)
                    turn = self.session.kinks[self.session.kinks > begin + TOGETHER]
                    until = float(turn[0]) if len(turn) else np.inf
                    out |= (self.run == k) & (self.stamps >= begin) & (self.stamps < until)
        return out

    def _asked(self, group: Group, k: int) -> FloatArray:
        """The set-points of recording ``k``, Pa."""
        asked, (begin, end) = group.commands["pressure"], self.session.span(k)
        return asked.value[(asked.time >= begin) & (asked.time <= end)]

    def _second_order(self) -> Fit:
        """The fit of the more probable kind of instrument, the nominal one or one of another time and damping, without
        an effect. The other is also begun where the nominal one ended: far off there are local optima."""
        alike, other = (under(self, self.prior_mean, sd) for sd in self.prior_scales)
        nominal = fit(alike)
        tries = [nominal, *(fit(other, nuisance=c) for c in (self.prior_mean, nominal.nuisance))]
        best = max(tries, key=lambda f: f.log_evidence(1.0, (f.prior_sd,)))
        self.prior_sd = best.prior_sd
        return best

    def line(self, group: Group, time: FloatArray) -> Table:
        """The pressure that the regulator, as fitted to the record, made of the command: times finer than ``time`` (n,)
        s, and Pa."""
        chain, kinks = self._regulated(group, self._fitted), group.commands["pressure"].kinks
        return commanded_line(chain, self.tables(group), kinks, time, self.early)

    def tables(self, group: Group) -> dict[str, Table]:
        """The commands, held at levels of whole steps where the regulator shows that."""
        tables = group.tables(self.held)
        return {q: in_whole_steps(*table, COMMAND_STEP) for q, table in tables.items()} if self.whole else tables

    def _regulated(self, group: Group, nuisance: FloatArray) -> Chain:
        """A group's nominal chain with the regulator at a nuisance vector."""
        # Bins average over the staircase of the command's resolution: simulate its mean.
        chain = chain_of(self.session, group, NO_TISSUE, command_step=0.0)
        return regulated(chain, nuisance, self.largest, self.vent)

    @cached_property
    def largest(self) -> float:
        """The largest suction that is asked for, Pa."""
        return max(float(np.max(np.abs(g.commands["pressure"].value))) for g, _ in self.groups)

    def early(self, time: FloatArray) -> FloatArray:
        """How far the record's stamps ``time`` (n,) are before the command's clock, s."""
        c = self._fitted
        return np.asarray(c[SHIFT] + c[CLOCK] * self.session.clock_age(time))

    def true(self, recorded: FloatArray) -> FloatArray:
        """Recorded pressures (n,) Pa without the gauge's error, as far as a sound one's goes."""
        gain, zero, more = self._fitted[GAIN:]
        true: FloatArray = recorded * (1.0 - gain) - zero - more * vented(recorded)
        return true

    @cached_property
    def _fitted(self) -> FloatArray:
        return fit(self).nuisance

    def _slope(self) -> FloatArray:
        later, earlier = self.prior_mean.copy(), self.prior_mean.copy()
        later[SHIFT], earlier[SHIFT] = 1e-3, -1e-3
        return (self._predict(later, {}) - self._predict(earlier, {})) / 2e-3

    def _predict(self, nuisance: FloatArray, active: Active) -> FloatArray:
        """Recorded pressure (n,) Pa, by a gauge without an error: its gain would shrink the noise of a record."""
        out = np.empty(len(self.stamps))
        for g, at in self.groups:
            shift = nuisance[SHIFT] + nuisance[CLOCK] * self.session.clock_age(self.stamps[at])
            chain = self.with_effects(self._regulated(g, nuisance), active, g)
            # Signals a gauge may read beside pressure are as recorded.
            out[at] = self.simulated(chain, g, at, shift, self.session.recorded("apex_height", g, smoothed=True))[0]
        return out

    def quantities(self, nuisance: FloatArray) -> Mapping[str, tuple[float, str]]:
        return quantities(nuisance, self.prior_sd)

    def warm_start(self, hypothesis: Sequence[Candidate], unit: FloatArray) -> Start | None:
        # Not from the null's shift, which has taken on much of a delay.
        return Start(self.prior_mean, self.prior_scales[0], self.prior_mean, unit)

    def lateness(self, fitted: Fit) -> Lateness | None:
        """Each kink's response, until the next, moved to and fro as a whole; and intervals of looks at the command that
        a ripple may tell."""
        intervals = self._ripple.intervals if self._ripple else ()
        kinks = self.session.kinks[np.diff(self.session.kinks, prepend=-np.inf) > TOGETHER]
        number = np.searchsorted(kinks, self.stamps, side="right") - 1
        number[(number < 0) | (self.stamps - kinks[number] > RESPONSE)] = len(kinks)
        slope = fitted.jacobian[:, SHIFT]

        def over(values: FloatArray) -> FloatArray:
            return np.bincount(number, values, len(kinks) + 1)[:-1].astype(float)

        known = over(slope**2)
        telling = known > QUIET * np.max(known)
        if not np.any(telling & (over(slope * fitted.residual) ** 2 > LATE**2 * known)):
            none = np.zeros(0)
            return Lateness(none, none, none, none.astype(bool), intervals) if intervals else None
        # The fitted regulator and clock have taken on much of the effect, the nominal ones may answer otherwise.
        nominal = np.concatenate([np.zeros(GAIN), fitted.nuisance[GAIN:]])
        seen = [self._late(n, fitted.active, number, telling) for n in (nominal, fitted.nuisance)]
        late, sd = min(seen, key=lambda found: float(np.median(found[1][telling])))
        good = np.isfinite(sd)
        steps = np.concatenate([g.commands["pressure"].steps for g, _ in self.groups])
        return Lateness(kinks[good], late[good], sd[good], np.isin(kinks[good], steps), intervals)

    @cached_property
    def _ripple(self) -> Ripple | None:
        """The ripple of a command that is held until the regulator looks at it next."""
        series = [(k, self.session.recordings[k].streams[self.channels[0]]) for k in self.runs]
        return ripple_of([(self.session.time(k, s), np.asarray(s.value, dtype=float)) for k, s in series])

    def _late(
        self, nuisance: FloatArray, active: Active, number: NDArray[np.int64], telling: NDArray[np.bool_]
    ) -> tuple[FloatArray, FloatArray]:
        """How late, s, the responses (k,) are that are ``telling``, and the standard deviations of that. ``number``
        (n,) says to which kink a row responds."""
        moved = np.concatenate([-MOVES[::-1], [0.0], MOVES])
        rows, chi2 = [], []
        for move in moved:
            there = nuisance.copy()
            there[SHIFT] -= move
            rows.append(self.evaluate(there, active, want_jacobian=False).residual)
            chi2.append(np.bincount(number, rows[-1] ** 2, len(telling) + 1)[:-1])
        best = np.clip(np.argmin(chi2, axis=0), 1, len(moved) - 2)
        late, sd = np.zeros(len(telling)), np.full(len(telling), np.inf)
        for k in np.flatnonzero(telling):
            at, j = number == k, best[k]
            change = (rows[j + 1][at] - rows[j - 1][at]) / (moved[j + 1] - moved[j - 1])
            square = float(change @ change)
            if square > 0:
                step = -float(change @ rows[j][at]) / square
                late[k] = moved[j] + np.clip(step, moved[j - 1] - moved[j], moved[j + 1] - moved[j])
                sd[k] = np.sqrt(1.0 / square) * max(1.0, np.sqrt(chi2[j][k] / at.sum()))
        return late, sd

    def evaluate(self, nuisance: FloatArray, active: Active, want_jacobian: bool = True) -> Evaluation:
        made = self._predict(nuisance, active)
        gain, zero, more = nuisance[GAIN:]
        empty = vented(made)
        residual = self.whitened(self.measured - made * (1.0 + gain) - zero - more * empty, active)
        if not want_jacobian:
            return Evaluation(residual, np.zeros((0, 0)))
        jacobian = np.ones((len(residual), len(nuisance)))
        for k, step in enumerate(steps(self.dt)):
            if VALVE.start <= k < UNKNOWN.stop and self.prior_sd[k] <= FROZEN:
                jacobian[:, k] = 0.0
                continue
            moved = nuisance.copy()
            moved[k] += step
            jacobian[:, k] = (self._predict(moved, active) - made) * (1.0 + gain) / step
        jacobian[:, GAIN], jacobian[:, VENTED] = made, empty
        return Evaluation(residual, self.whitened(jacobian, active))
