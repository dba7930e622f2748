"""Reference specimens under a suction probe: the instrument without a person's law in the way.

On a block and a manometer's adapter the height is 0, on a gauge step it is the step's, on the membrane a monotone and
nearly memoryless function of pressure, the same in all its recordings. So the height's gain, zero, lag and friction are
the instrument's, as they are when the same effects are fitted to skin. The manometer tells the true pressure.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from gap.data.noise import smoothed_error
from gap.inference.evidence import Fit
from gap.inference.hypothesis import Active, Evaluation
from gap.inference.least_squares import fit
from gap.null.groups import Group, GroupedSession, Table
from gap.null.skin_laws import bounded_exp
from gap.null.suction_discrepancy import KNEES
from gap.null.suction_feed import FedBlock
from gap.null.suction_line import NO_TISSUE, chain_of, vented
from gap.null.suction_pressure import PressureBlock, zeros_of_recordings
from protocols.specimens import MEMORY
from sim_devices.chain import Chain, Effect, FloatArray
from sim_devices.stages.kernels import evaluate, low_pass
from sim_devices.stages.suction import elastic_height

STEP, MEMBRANE = "gauge step", "reference membrane"
MOVING = 1.5
"""s about the moment at which a step is slid in or out that are left out."""
FLAT, ON_THE_WAY, LEAST_STEP = 0.8, 0.04, 0.1
"""Quantile of the readings that a step's flat has at least; share of it by which a reading beside a record's end is off
both that and nought if the step is on its way; and share of the stated height below which no step is there."""
BEND_SD, OTHER_CURVE = 0.05, 0.5
"""Of the membrane's greatest height, by which its curve may differ from one of three parameters, per function; and so
far if it earns that freedom: a cap of rubber rises as the cube root of a small pressure."""
CURVE_SD = np.array([0.7, 2.0, 1.5])
"""Logarithms by which these three, compliance, knee and exponent, may differ from the curve that fits the heights as
read: nobody knows them, and a height that lags bends the curve that seems to fit."""
AS_FITTED, CURVE_STEP = np.zeros(3), 1e-3
"""None of this, and a step of it for differences."""
MEMORIES = (0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0)
"""s: of the little memory that a membrane may have."""
LOOSE, BENT = 0.2, 1e-4
"""Were a specimen not as stated: share of a step's height or of a membrane's that creeps; m by which a block gives
way at the strongest suction."""
TELLING = 100
"""Rows of specimens that do not yield from which on they tell the slow part of the sensor's noise."""
CREEPS = 0.3
"""s: shorter lags of a membrane are taken for the sensor's, longer ones may be a membrane's that creeps."""


@dataclass(frozen=True)
class _Column:
    """Something added to the height: ``values`` (n,) m times a number of prior width ``sd``; ``loose`` is the width
    were the specimen it is ``of`` not as stated; one that ``bends`` a membrane's curve may be of another curve."""

    values: FloatArray
    sd: float
    of: str = ""
    loose: float = 0.0
    bends: bool = False


class ReferenceBlock(FedBlock):
    """Apex height on reference specimens.

    Nuisance: the sampling convention; the height's gain within its tolerance; each recording's zero; a step's height
    within its uncertainty; the membrane's curve, and as much memory as it states.
    """

    name, channels = "reference", ("apex_height",)

    def __init__(
        self, session: GroupedSession, library: Mapping[str, Effect], pressure: PressureBlock | None = None
    ) -> None:
        others = {g.name for g in session.groups if not g.reference}
        super().__init__(session, library, pressure, without=tuple(others))
        self._bulge = [self._solid(g, at) for g, at in self.groups]
        self._curve = self._membrane_curve()
        later, earlier = (self._chain_height(shift, {}) for shift in (1e-3, -1e-3))
        self.blur_steep_parts((later - earlier) / 2e-3)
        columns = self._columns()
        self._added = np.column_stack([c.values for c in columns])
        self._of = [c.of for c in columns]
        curve = CURVE_SD if any(g.name == MEMBRANE for g, _ in self.groups) else np.zeros(0)
        self._of += [""] * len(curve)
        self._loose = np.array([*(c.loose for c in columns), *curve])
        self.prior_sd = np.array([self.shift_sd, *(c.sd for c in columns), *curve])
        self.prior_mean = self.sound = np.zeros(len(self.prior_sd))
        self.prior_scales = (self.prior_sd,)
        bends = np.array([False, *(c.bends for c in columns), *np.zeros(len(curve), dtype=bool)])
        if np.any(bends):
            self.prior_scales = (self.prior_sd, np.where(bends, OTHER_CURVE, self.prior_sd))
            self.prior_sd = fit(self).best_prior(self.prior_scales)
        # The sensor's slow noise shows where nothing yields; on a membrane it may be the membrane's.
        still = [bulge is not None for bulge in self._bulge]
        rigid = np.repeat(still, [at.stop - at.start for _, at in self.groups])
        if np.count_nonzero(rigid) >= TELLING:
            self.remember(fit(self), rigid)

    def _solid(self, group: Group, at: slice) -> Table | None:
        """Height of a solid over a group's time, m; None of a membrane. A step is there from half of its reading on,
        and the moments in which it is moved are left out."""
        begin, end = self.stamps[at][[0, -1]]
        if group.name == MEMBRANE:
            return None
        if group.name != STEP or "height" not in group.known:
            return np.array([begin, end]), np.zeros(2)
        height = group.known["height"].scalar
        level = float(np.quantile(self.measured[at], FLAT))  # as read: a gain may be half of the right one
        share = self.measured[at] / level if level > LEAST_STEP * height else np.ones(at.stop - at.start)
        there = share > 0.5  # where no step shows, its statement is wrong, and the misfit will tell
        moved = np.flatnonzero(np.diff(there.astype(int)) != 0)
        edges = 0.5 * (self.stamps[at][moved] + self.stamps[at][moved + 1])
        # It may come or leave as the record begins or ends.
        beside = np.minimum(self.stamps[at] - begin, end - self.stamps[at]) < MOVING
        off = beside & (share > ON_THE_WAY) & (share < 1.0 - ON_THE_WAY)
        moves = np.concatenate([edges, self.stamps[at][off]])
        near = np.min(np.abs(self.stamps[at][:, None] - moves), axis=1, initial=np.inf) < MOVING
        self.row_noise.widen(at.start + np.flatnonzero(near))
        return self.stamps[at], np.where(there, height, 0.0)

    def _membrane_curve(self) -> tuple[float, float, float]:
        """Compliance (m/Pa), knee (Pa) and exponent of the membrane's curve, fitted to its heights."""
        parts = [
            (np.interp(self.stamps[at], *line), self.measured[at])
            for (g, at), line in zip(self.groups, self._line, strict=True)
            if g.name == MEMBRANE
        ]
        if not parts:
            return 0.0, 1e4, 1.0
        pressure, height = (np.concatenate(p) for p in zip(*parts, strict=True))
        top, deepest = max(float(height.max()), 1e-6), max(-float(pressure.min()), 1.0)

        def off(x: FloatArray) -> FloatArray:
            shape = elastic_height(pressure, pressure, 1.0, deepest * np.exp(x[1]), x[2])
            misfit: FloatArray = (x[0] * shape / max(float(shape.max()), 1e-30) * top + x[3] * top - height) / top
            return misfit

        start = np.array([1.0, 0.0, 0.6, 0.0])
        low, high = (-np.inf, -4.0, 0.05, -0.2), (np.inf, 4.0, 3.0, 0.2)
        x = least_squares(off, start, bounds=(low, high), loss="soft_l1", f_scale=0.01).x
        knee = deepest * float(np.exp(x[1]))
        unit = float(elastic_height(pressure, pressure, 1.0, knee, float(x[2])).max())
        return float(x[0]) * top / unit, knee, float(x[2])

    def _columns(self) -> list[_Column]:
        """Columns that are simply added to the prediction."""
        n = len(self.stamps)
        height = self._chain_height(0.0, {})
        on_step = np.zeros(n)
        solid: dict[int, bool] = {}
        for g, at in self.groups:
            if g.name == STEP:
                on_step[at] = height[at]
            solid |= dict.fromkeys(g.members, g.name not in (STEP, MEMBRANE))
        labels = {k: g.specimen for g, _ in self.groups for k in g.members}
        columns = [_Column(on_step, self.tolerances["sensor_gain"]["error"].value)]
        zero = float(np.hypot(self.noise[0], 1e-6))
        for j, k in enumerate(self.runs):
            member = self.member[:, j]
            # Whether a reading is zeroed when it begins, at the first suction or at both, instruments do not agree.
            free = float(np.max(np.abs(self.measured))) if self.session.begins_under_suction(k) else zero
            columns += [_Column(member, free), _Column(member * (self.stamps < self.session.onset(k)), zero)]
            known = self.session.recordings[k].info.specimen_properties
            if "height" in known:
                share = max(known["height"].se / max(known["height"].scalar, 1e-9), 1e-6)
                columns.append(_Column(member * on_step, share, labels[k], LOOSE))
        for (g, at), (time, pressure) in zip(self.groups, self._line, strict=True):
            bend = np.zeros(n)
            bend[at] = np.interp(self.stamps[at], time, pressure) / min(float(pressure.min()), -1.0)
            if solid[g.members[0]]:
                columns.append(_Column(bend, 1e-9, g.specimen, BENT))
            elif g.name == MEMBRANE:
                columns += self._freedom(g, at, time, pressure)
        return columns

    def _freedom(self, group: Group, at: slice, time: FloatArray, pressure: FloatArray) -> list[_Column]:
        """Discrepancy of a membrane beside its curve of three parameters: other curves, and lags within its memory."""
        memory = group.known["memory"].scalar if "memory" in group.known else MEMORY.otherwise
        u = np.maximum(-pressure, 0.0)
        u = u / (float(u.max()) or 1.0)
        height = elastic_height(time, pressure, *self._curve)
        top = float(np.max(np.abs(height), initial=1e-9))

        def column(values: FloatArray, sd: float, loose: float, bends: bool = False) -> _Column:
            full = np.zeros(len(self.stamps))
            full[at] = np.interp(self.stamps[at], time, values)
            return _Column(full, sd, group.specimen, loose, bends)

        curves = [u, u**2, u**3, np.sqrt(u), np.cbrt(u), *(np.minimum(u, k) / k for k in KNEES[3:])]
        lags = {tau: evaluate(low_pass, time, height, tau) - height for tau in MEMORIES}
        return [
            *(column(curve * top, BEND_SD, BEND_SD, bends=True) for curve in curves),
            *(column(lag, 0.5 * memory, LOOSE if tau >= CREEPS else 0.5 * memory) for tau, lag in lags.items()),
        ]

    def loosened(self) -> Mapping[str, tuple[FloatArray, tuple[int, ...]]]:
        """For each specimen, the prior widths (p,) were it not as stated, and the numbers of its recordings."""
        out = {}
        for g, _ in self.groups:
            own = np.array([of == g.specimen for of in self._of])
            if own.any():
                widths = self.prior_sd.copy()
                widths[1:][own] = np.maximum(self._loose[own], widths[1:][own])
                out[g.specimen] = widths, g.members
        return out

    def _chain_of(self, group: Group, off: FloatArray) -> Chain:
        """The chain of a group; the curve of a membrane is ``off`` (3,) the one that fits, in `CURVE_SD`'s terms."""
        chain = chain_of(self.session, group, NO_TISSUE)
        if group.name == STEP:
            return chain.tuned("zeroing", held=True)
        if group.name == MEMBRANE:
            curve = tuple(value * bounded_exp(log) for value, log in zip(self._curve, off, strict=True))
            return chain.tuned("elastic", parameters=curve)
        return chain

    def _chain_height(self, shift: float, active: Active, off: FloatArray = AS_FITTED) -> FloatArray:
        """Apex height of the chain, (n,) m, read ``shift`` s late; ``off`` (3,) is how a membrane's curve differs."""
        return self.read(lambda g: self._chain_of(g, off), shift, active, self._bulge)

    def quantities(self, nuisance: FloatArray) -> Mapping[str, tuple[float, str]]:
        return {"height_gain_error": (float(nuisance[1]), "1"), "height_shift": (float(nuisance[0]), "s")}

    def evaluate(self, nuisance: FloatArray, active: Active, want_jacobian: bool = True) -> Evaluation:
        """The nuisance is the shift, the added columns' and, of a membrane, its curve's."""
        curve_at = 1 + self._added.shape[1]
        shift, off = float(nuisance[0]), nuisance[curve_at:]
        height = self._chain_height(shift, active, off)
        residual = self.whitened(self.measured - height - self._added @ nuisance[1:curve_at], active)
        if not want_jacobian:
            return Evaluation(residual, np.zeros((0, 0)))
        step = 0.05 * self.dt
        late = (self._chain_height(shift + step, active, off) - height) / step
        steps = CURVE_STEP * np.eye(len(off))
        bent = [(self._chain_height(shift, active, off + by) - height) / CURVE_STEP for by in steps]
        return Evaluation(residual, self.whitened(np.column_stack([late, self._added, *bent]), active))


class ManometerBlock(FedBlock):
    """Recorded pressure -> true pressure at the probe, by a second gauge.

    The loop closes over the instrument's own gauge, whose error only the second one tells: whichever regulator made
    the pressure, and whatever it met on its way, both have read the same. Nuisance: how late the second gauge is (s),
    and the gain, the zero (Pa) and a further zero while vented (Pa) by which it reads other than the first; of several
    recordings by how much each one's zero is off that (Pa).
    """

    name, channels = "manometer", ("pressure_reference",)
    as_read = True  # both gauges read what a regulator leaves, and the first one's error is what the second tells

    def __init__(self, session: GroupedSession, library: Mapping[str, Effect], pressure: PressureBlock) -> None:
        super().__init__(session, library, pressure, without=())
        later, earlier = (self._true(shift, {}) for shift in (1e-3, -1e-3))
        self.blur_steep_parts((later - earlier) / 2e-3)
        # The first gauge's noise is in it as well.
        self.row_noise.blur(np.full(len(self.stamps), smoothed_error(float(pressure.noise[0]), pressure.dt)))
        self.row_noise.share(pressure.row_noise)
        gain, zero = self.tolerances["gauge_gain"]["error"].value, self.tolerances["gauge_offset"]["offset"].value
        self._zeros = zeros_of_recordings(self)
        again = np.full(self._zeros.shape[1], self.tolerances["gauge_offset"]["again"].value)
        self.prior_sd = np.concatenate([[self.shift_sd, gain, zero, zero], again])
        self.prior_mean = self.sound = np.zeros(len(self.prior_sd))
        self.prior_scales = (self.prior_sd,)
        best = self._averaged(fit(self))
        if self.row_noise.memory is None:
            self.remember(best)

    def _averaged(self, found: Fit) -> Fit:
        """The better fit of ``found`` and of one whose samples are means where the first gauge's are none, or are none
        where they are."""
        other = copy.copy(self)
        changed = self.sampled(not self.averaged)
        vars(other).update(changed)
        again = fit(other)
        if again.objective > found.objective:
            return found
        vars(self).update(changed)
        return again

    @property
    def shift_sd(self) -> float:
        """How late the second gauge may be, s, which has a response and stamps of its own."""
        return float(np.hypot(super().shift_sd, self.tolerances["sampling"]["second_gauge"].value))

    def _true(self, shift: float, active: Active) -> FloatArray:
        """True pressure (n,) Pa, read ``shift`` s late."""
        return self.read(lambda g: chain_of(self.session, g, NO_TISSUE), shift, active)

    def quantities(self, nuisance: FloatArray) -> Mapping[str, tuple[float, str]]:
        gain, zero = nuisance[1:3].tolist()
        return {"pressure_gauge_gain_error": (-gain, "1"), "pressure_gauge_zero": (-zero, "Pa")}

    def evaluate(self, nuisance: FloatArray, active: Active, want_jacobian: bool = True) -> Evaluation:
        shift, gain, zero, more = nuisance[:4].tolist()
        true = self._true(shift, active)
        empty = vented(true)
        zeros = zero + more * empty + self._zeros @ nuisance[4:]
        residual = self.whitened(self.measured - true * (1.0 + gain) - zeros, active)
        if not want_jacobian:
            return Evaluation(residual, np.zeros((0, 0)))
        step = 0.05 * self.dt
        late = (self._true(shift + step, active) - true) * (1.0 + gain) / step
        columns = np.column_stack([late, true, np.ones_like(true), empty, self._zeros])
        return Evaluation(residual, self.whitened(columns, active))
