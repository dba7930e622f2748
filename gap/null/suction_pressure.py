"""Command -> recorded pressure of a suction instrument: the actuator by itself, no tissue in it."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
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
from gap.null.blocks import Block
from gap.null.groups import Group, GroupedSession, Table
from gap.null.lateness import TOGETHER, lateness
from gap.null.suction_line import (
    EMPTY,
    NO_TISSUE,
    chain_of,
    closed_over,
    commanded_line,
    overshoot,
    unasked,
    vented,
)
from gap.null.suction_regulator import (
    CLOCK,
    DAMPING,
    EMPTIES,
    GAIN,
    SHIFT,
    SIZE,
    STAYS,
    TIME,
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
from sim_devices.stages.suction import COMMAND_STEP

SETTLED = 8
"""Samples before suction from which on it can be told where a pressure rests."""
AWAY, BACK = 8.0, 4.0
"""σ by which a recording must begin off where it rests to count as begun in motion, and from which on it rests."""
SOONER = 150.0, 30.0
"""Pa of suction from which on a line may not be vented, if not from `EMPTY` on;"""
EMPTIES_SOONER = 50.0
"""and by which a gauge must be off otherwise while vented for that to matter."""
SAMPLED, SLOW, AT_EASE = 5.0, 0.012, 20.0
"""χ² from which on samples are means over a period, or none (odds of twelve), s of a period from which on that matters,
and the penalty of a regulator that is not strained, which no other samples excuse."""
SLOWER = (1.0, 0.4)
"""Logarithms of time and damping of a second order that is far slower than the nominal one, from which a fit begins."""


def zeros_of_recordings(block: Block) -> FloatArray:
    """Which recording's zero a gauge's rows have, (n, recordings) of 0 and 1; a single recording's is the gauge's."""
    return block.member if len(block.runs) > 1 else np.zeros((len(block.stamps), 0))


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
    empty = EMPTY
    commanded = False  # whether its loop sees a gauge's zero while suction is asked for, not while there is some
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
        self.row_noise.widen(np.flatnonzero(self._in_motion()))
        self._zeros = zeros_of_recordings(self)
        self.prior_sd = self.prior(lambda t: t.value)
        self.prior_mean = self.sound = np.zeros(len(self.prior_sd))
        self._begin = self.prior_mean
        # As a sound instrument of the nominal kind, or a regulator of another time and damping.
        self.prior_scales = (self.prior_sd, self.prior(lambda t: t.widest))
        self.blur_steep_parts(self._slope())
        best = self._followed(self._vented(self._averaged(self._resolved(self._second_order()))))
        self.structure = self._structured(best, unknown)
        if self.structure is not None:
            self._take(self.structure)
            best = self._averaged(self._resolved(fit(self)))
        best = self._emptied(self._followed(best))
        self._begin = best.nuisance
        self.row_noise, left = self._with_memory(best)
        self.explained = left < len(best.residual) * NOISY  # by a regulator that is known

    def _structured(self, found: Fit, unknown: bool) -> Structure | None:
        """The regulator's structure, if not the second order ``found``; of sampled commands that are held at each row,
        or straight between, whichever comes nearer."""
        structure, n = other_structure(self, found, unknown), len(found.residual)
        if not self.session.sampled or (structure or found).objective < n * NOISY:
            return structure
        looked, changed = self._changed(held=not self.held)
        again = other_structure(looked, fit(looked, nuisance=found.nuisance), unknown)
        if again is None or (structure is not None and again.objective > structure.objective - WORTH):
            return structure
        vars(self).update(changed)
        return again

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

    def _emptied(self, found: Fit) -> Fit:
        """The better fit of ``found`` and of those whose line is vented from less suction on, or by the command."""
        if abs(found.nuisance[VENTED]) < EMPTIES_SOONER:
            return found
        for empty in SOONER:
            found = self._better(found, empty=empty)
        return self._better(found, commanded=True)

    def _better(self, found: Fit, worth: float = WORTH, **other: Any) -> Fit:
        """``found``, or the fit with ``other`` attributes of the block, taken on if that is ``worth`` it."""
        looked, changed = self._changed(**other)
        again = fit(looked, nuisance=found.nuisance)
        if again.objective > found.objective - worth:
            return found
        vars(self).update(changed)
        return again

    def _changed(self, **other: Any) -> tuple[Self, dict[str, Any]]:
        """The block with ``other`` attributes, and all that these change: grids anew, of other commands maybe."""
        looked = under(self, self.prior_mean, self.prior_sd)
        changed = {**self.sampled(other.get("averaged", self.averaged)), **other}
        vars(looked).update(changed)
        return looked, changed

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
        """The rows' noise without those of the first stretch of suction in recordings that follow an open probe's,
        whose integral nobody knows."""
        out = copy.copy(self.row_noise)
        out.widen(np.flatnonzero(self._after_open_air()))
        return out

    def _simulated_together(self, without: Sequence[str]) -> Sequence[Group]:
        return [self.session.whole("pressure", without)]  # what a regulator remembers goes on to the next specimen

    @property
    def _all(self) -> Group:
        """The one group of all recordings."""
        return self.groups[0][0]

    @property
    def likelihood_powers(self) -> Sequence[float]:
        return (self.trust, self.trust, self.trust_other)[: len(self.prior_scales)]

    @property
    def unknown(self) -> bool:
        """Whether the regulator is of a structure that nobody knows."""
        return bool(self.prior_sd[UNKNOWN.start] > FROZEN)

    def remembered(self, found: Fit) -> float:
        """χ² of a fit without an effect, its noise being as slow as what it leaves shows."""
        return self._with_memory(found)[1]

    def _with_memory(self, found: Fit) -> tuple[RowNoise, float]:
        """Noise as slow as what a fit without an effect leaves shows, and the fit's χ² by it."""
        left, out = self.unwhitened(found.residual, {}), copy.copy(self)
        out.row_noise = copy.copy(self.row_noise)
        out.row_noise.remember(left, self.noise.tolist())
        rest = out.whitened(left, {})
        return out.row_noise, float(rest @ rest)

    def start(self) -> FloatArray:
        return self._begin.copy()

    def prior(self, width: Callable[[Tolerance], float], opened: slice = slice(0)) -> FloatArray:
        """Prior widths (p,) of a sound instrument, by the one of its tolerances that ``width`` takes."""
        regulator = prior_widths(self.tolerances, self.shift_sd, width, opened)
        again = self.tolerances["gauge_offset"]["again"].value
        return np.concatenate([regulator, np.full(self._zeros.shape[1], again)])

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

    def _after_open_air(self) -> NDArray[np.bool_]:
        """Rows (n,) of the first stretch of suction in recordings that follow one that is left out."""
        out, members = np.zeros(len(self.stamps), dtype=bool), self._all.members
        for k in members:
            if k > 0 and k - 1 not in members and np.any(self._asked(k)):
                begin = self.session.onset(k)
                turn = self.session.kinks[self.session.kinks > begin + TOGETHER]
                until = float(turn[0]) if len(turn) else np.inf
                out |= (self.run == k) & (self.stamps >= begin) & (self.stamps < until)
        return out

    def _asked(self, k: int) -> FloatArray:
        """The set-points of recording ``k``, Pa."""
        asked, (begin, end) = self._all.commands["pressure"], self.session.span(k)
        return asked.value[(asked.time >= begin) & (asked.time <= end)]

    def _second_order(self) -> Fit:
        """The fit of the more probable kind of instrument, the nominal one or one of another time and damping, without
        an effect. The other is also begun where the nominal one ended, and far slower: far off there are local optima,
        and it is rounding that decides which of them one start comes to."""
        alike, other = (under(self, self.prior_mean, sd) for sd in self.prior_scales)
        nominal = fit(alike)
        slower = self.prior_mean.copy()
        slower[[TIME, DAMPING]] = SLOWER
        tries = [nominal, *(fit(other, nuisance=c) for c in (self.prior_mean, nominal.nuisance, slower))]
        best = max(tries, key=lambda f: f.log_evidence(1.0, (f.prior_sd,)))
        self.prior_sd = best.prior_sd
        return best

    def line(self, group: Group, time: FloatArray, closed: bool = False) -> Table:
        """The pressure that the regulator, as fitted to the record, made of the command, or `closed_over` a gauge's
        zero: times finer than ``time`` (n,) s, and Pa."""
        chain, kinks = self._regulated(group, self._fitted, closed), group.commands["pressure"].kinks
        return commanded_line(chain, self.tables(group), kinks, time, self.early)

    def tables(self, group: Group) -> dict[str, Table]:
        """The commands, held at levels of whole steps where the regulator shows that."""
        tables = group.tables(self.held)
        return {q: in_whole_steps(*table, COMMAND_STEP) for q, table in tables.items()} if self.whole else tables

    def _regulated(self, group: Group, nuisance: FloatArray, closed: bool = False) -> Chain:
        """A group's nominal chain with the regulator at a nuisance vector, or `closed_over` a gauge's zero."""
        # Bins average over the staircase of the command's resolution: simulate its mean.
        chain = chain_of(self.session, group, NO_TISSUE, command_step=0.0)
        chain = closed_over(chain, self.empty) if closed else chain
        return regulated(chain, nuisance, self.largest, self.vent)

    @cached_property
    def largest(self) -> float:
        """The largest suction that is asked for, Pa."""
        return float(np.max(np.abs(self._all.commands["pressure"].value)))

    def early(self, time: FloatArray) -> FloatArray:
        """How far the record's stamps ``time`` (n,) are before the command's clock, s."""
        c = self._fitted
        return np.asarray(c[SHIFT] + c[CLOCK] * self.session.clock_age(time))

    def true(self, group: Group, time: FloatArray, recorded: FloatArray) -> FloatArray:
        """Pressures ``recorded`` (n,) Pa at ``time`` (n,) s without the gauge's error, as far as a sound one's goes."""
        gain, zero, more = self._fitted[GAIN:SIZE]
        if self.commanded:
            fine, made = self.line(group, time)
            share = np.interp(time, fine, unasked(made, self.line(group, time, closed=True)[1]))
        else:
            share = vented(recorded, self.empty)
        true: FloatArray = recorded * (1.0 - gain) - zero - more * share
        return true

    @cached_property
    def _fitted(self) -> FloatArray:
        return fit(self).nuisance

    def _slope(self) -> FloatArray:
        later, earlier = self.prior_mean.copy(), self.prior_mean.copy()
        later[SHIFT], earlier[SHIFT] = 1e-3, -1e-3
        return (self._predict(later, {}) - self._predict(earlier, {})) / 2e-3

    def _predict(self, nuisance: FloatArray, active: Active, coarse: bool = False, closed: bool = False) -> FloatArray:
        """Recorded pressure (n,) Pa, by a gauge without an error: its gain would shrink the noise of a record;
        ``coarse`` for differences, and of a loop that is `closed_over` a gauge's zero."""
        shift = nuisance[SHIFT] + nuisance[CLOCK] * self.session.clock_age(self.stamps)
        chain = self.with_effects(self._regulated(self._all, nuisance, closed), active, self._all)
        # Signals a gauge may read beside pressure are as recorded.
        beside = self.session.recorded("apex_height", self._all, smoothed=True)
        out: FloatArray = self.simulated(chain, self._all, slice(0, len(self.stamps)), shift, beside, coarse)[0]
        return out

    def _vented_share(self, nuisance: FloatArray, active: Active, made: FloatArray) -> FloatArray:
        """How far (n,), 0 to 1, the line is vented where it was ``made`` so (n,) Pa."""
        if self.commanded:
            return unasked(made, self._predict(nuisance, active, closed=True))
        return vented(made, self.empty)

    def quantities(self, nuisance: FloatArray) -> Mapping[str, tuple[float, str]]:
        return quantities(nuisance, self.prior_sd)

    def warm_start(self, hypothesis: Sequence[Candidate], unit: FloatArray) -> Start | None:
        # Not from the null's shift, which has taken on much of a delay.
        return Start(self.prior_mean, self.prior_scales[0], self.prior_mean, unit)

    def belies(self, fitted: Fit) -> bool:
        if all(candidate.name != "overshoot" for candidate in fitted.active):
            return False
        chain = self.with_effects(self._regulated(self._all, fitted.nuisance), fitted.active, self._all)
        return overshoot(chain, 0.5 * self.largest) < self.tolerances["overshoot"]["overshoot"].value

    def lateness(self, fitted: Fit) -> Lateness | None:
        intervals = self._ripple.intervals if self._ripple else ()
        # The fitted clock has taken on much of a latency, and so has the regulator; the nominal one may do otherwise.
        nominal = np.concatenate([np.zeros(GAIN), fitted.nuisance[GAIN:]])
        in_time = np.where(np.arange(len(nominal)) == CLOCK, 0.0, fitted.nuisance)
        steps, session = self._all.commands["pressure"].steps, self.session
        return lateness(self, fitted, session.kinks, steps, session.marks, SHIFT, (nominal, in_time), intervals)

    @cached_property
    def _ripple(self) -> Ripple | None:
        """The ripple of a command that is held until the regulator looks at it next."""
        series = [(k, self.session.recordings[k].streams[self.channels[0]]) for k in self.runs]
        return ripple_of([(self.session.time(k, s), np.asarray(s.value, dtype=float)) for k, s in series])

    def evaluate(self, nuisance: FloatArray, active: Active, want_jacobian: bool = True) -> Evaluation:
        made = self._predict(nuisance, active)
        gain, zero, more = nuisance[GAIN:SIZE]
        empty = self._vented_share(nuisance, active, made)
        zeros = zero + more * empty + self._zeros @ nuisance[SIZE:]
        residual = self.whitened(self.measured - made * (1.0 + gain) - zeros, active)
        if not want_jacobian:
            return Evaluation(residual, np.zeros((0, 0)))
        jacobian = np.ones((len(residual), len(nuisance)))
        coarse = not self.unknown  # its free lines bend too sharply
        roughly = self._predict(nuisance, active, coarse=True) if coarse else made
        for k, step in enumerate(steps(self.dt)):
            if VALVE.start <= k < UNKNOWN.stop and self.prior_sd[k] <= FROZEN:
                jacobian[:, k] = 0.0
                continue
            rough = coarse and k not in (SHIFT, CLOCK)  # a shift by less than a node needs the fine ones
            moved = nuisance.copy()
            moved[k] += step
            change = self._predict(moved, active, rough) - (roughly if rough else made)
            jacobian[:, k] = change * (1.0 + gain) / step
        jacobian[:, GAIN], jacobian[:, VENTED], jacobian[:, SIZE:] = made, empty, self._zeros
        return Evaluation(residual, self.whitened(jacobian, active))
