"""The micro-robot's block with the skin in it: recorded axis positions -> transducer forces."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gap.data.smoothing import significant
from gap.inference.hypothesis import FROZEN, Active, Evaluation
from gap.inference.linear import compressed
from gap.null.chains import Kept, Memo, needed, run, undone
from gap.null.groups import Group, GroupedSession, Table
from gap.null.robot_axes import AXES, AxesBlock
from gap.null.robot_grid import averaged, nodes_within, sticking, thinned
from gap.null.robot_laws import SheetLawBlock
from gap.null.robot_recorded import path_of_axes, recorded, steepness
from gap.null.robot_specimens import specimen_chain
from gap.null.sheet_discrepancy import sheet_discrepancy
from gap.null.sheet_law import quantities, rewired, sheet
from protocols.specimens import SPECIMENS
from sim_devices.chain import Chain, Effect, FloatArray
from sim_devices.stages.robot import TRANSDUCERS, numbered, xyz
from sim_devices.stages.tissues import SheetTissue, sheet_tissue

SHEET_STEP, SHEET_TURN = 0.1, 0.04
"""s between nodes of the sheet, stamps apart, at most; and rad by which a curved command may turn in it."""
LATELY = 4
"""Skins, and linear parts of predictions, that are kept."""


class ForceBlock(SheetLawBlock):
    """Recorded axis positions -> transducer forces.

    Nuisance: the reduced sheet's parameters; the sampling convention; the transducers' calibration; per recording a
    gain and their zeros; changes that other sheets could make.
    """

    name, channels = "force", TRANSDUCERS
    growth, widest = 0.1, 0.12  # s: a pulse of 1.2 Hz, and what is twice as fast, keep their amplitude
    floor = 0.3e-3  # N
    GAIN_SD = 0.04  # of the tissue's stiffness between recordings
    ZERO_SD = 1.5e-3  # N: those of sound recordings scatter by 0.6 to 1.5 mN
    DISCREPANCY_SD = 0.02  # of the force, per basis function
    DISCREPANCY_SIZE = 200

    def __init__(self, session: GroupedSession, library: Mapping[str, Effect], axes: AxesBlock) -> None:
        super().__init__(session, library, self.left_out(session))
        smooth = [recorded(self, g, TRANSDUCERS, TRANSDUCERS, smooth=True) for g, _ in self.groups]
        self.blur_steep_parts(steepness(self, smooth, TRANSDUCERS))
        if session.of_force is not None:
            self.row_noise.alike(session.of_force)
        self._tissue = sheet_tissue("forearm")
        self._nominal = {g.specimen: specimen_chain(g, self._tissue, session.marks) for g, _ in self.groups}
        self._axes = [path_of_axes(self, g, axes.true_axes) for g, _ in self.groups]
        seen, paths = self.floor / max(self.greatest(), self.floor), zip(self.groups, self._axes, strict=True)
        self._sticking = [sticking(axes, self._ends[:, at], seen) for (_, at), axes in paths]
        parts = zip(self.groups, self._axes, self._sticking, strict=True)
        self._grids_of = [self._grid_of(g, at, axes, sticks) for (g, at), axes, sticks in parts]
        self._zeros = np.kron(np.eye(3), self.member)
        self._gains = np.tile(self.member, (3, 1))
        self._legs = np.kron(np.eye(3), np.ones((len(self.stamps), 1)))
        self._skin = [self._skin_path(g, axes) for (g, _), axes in zip(self.groups, self._axes, strict=True)]
        square = np.concatenate([np.sum(path**2, axis=0) for path in self._skin])
        self._strongest = max(self.greatest(), self.floor)
        self._typical = float(np.sqrt(np.sum(square**2) / max(np.sum(square), 1e-30))) or self._tissue.length
        size = max(float(np.ptp(self.measured)), 10 * float(np.median(self.sigma)))
        columns, weights = compressed(*self._discrepancy_columns(), self.DISCREPANCY_SIZE)
        self._basis = columns * size
        sd = {
            "tissue": np.asarray(self.LAWS[-1].sd),
            "shift": np.array([max(self.tolerances["latency"]["delay"].value, self.shift_sd)]),
            "calibration": np.full(3, self.tolerances["sensor_gain"]["error"].value),
            "gain": self._gain_sd(),
            "zero": np.tile(self._zero_sd(), 3),
            "discrepancy": self.DISCREPANCY_SD * weights,
        }
        ends = np.cumsum([len(v) for v in sd.values()])
        self._parts = {name: slice(end - len(v), end) for (name, v), end in zip(sd.items(), ends.tolist(), strict=True)}
        self.prior_sd = np.concatenate(list(sd.values()))
        self.prior_mean = np.zeros(len(self.prior_sd))
        self._take_all_laws()
        self._held: Active = {}  # effects that act whatever is asked for
        self._coarse = self._thinned()
        self._memos = [[Memo(grid) for grid, _ in made] for made in (self._grids_of, self._coarse)]
        self._skins, self._linear = Kept(LATELY), Kept(LATELY)

    def left_out(self, session: GroupedSession) -> tuple[str, ...]:
        """Names of the specimens that say nothing here: a reference block has them, and against a post skin moves by
        micrometres that nobody measures."""
        return tuple(SPECIMENS)

    def _gain_sd(self) -> FloatArray:
        """By recording (r,): how far its stiffness is another."""
        return np.full(len(self.runs), self.GAIN_SD)

    def _zero_sd(self) -> FloatArray:
        """By recording (r,), N: how far a transducer's zero is off."""
        return np.full(len(self.runs), self.ZERO_SD)

    def scattered(self, active: Active) -> FloatArray | None:
        """None beside a discrepancy: the residual where force is steep may be the skin's as well as chance."""
        return None if self._basis.shape[1] else super().scattered(active)

    def greatest(self) -> float:
        """The greatest force of a transducer in the session, N."""
        return float(np.max(np.abs(self.measured)))

    def _grid_of(
        self, group: Group, at: slice, axes: Mapping[str, Table], sticks: NDArray[np.bool_]
    ) -> tuple[FloatArray, dict[str, FloatArray]]:
        """Nodes for a group, fine enough for a sheet between them and in bins in which an axis ``sticks``, (n,)."""
        ends = self._ends[:, at]
        time = axes["axis_1"][0]
        begin, end = min(ends.min(), time[0]), ends.max() + 0.05
        kinks = self.session.kinks
        even = self.session.pace(group.members, SHEET_STEP, SHEET_TURN).nodes(begin, end)
        bins = np.concatenate([ends.ravel(), nodes_within(ends[:, sticks])])
        grid = np.unique(np.concatenate([even, bins, kinks[(kinks > begin) & (kinks < end)], [end]]))
        return grid, {name: np.interp(grid, *table) for name, table in axes.items()}

    def _thinned(self) -> list[tuple[FloatArray, dict[str, FloatArray]]]:
        """Nodes of each group, and the axes there, that do for the difference of two simulations."""
        bins = [self._ends[:, at] for _, at in self.groups]
        return [thinned(*made, b, self.session.kinks) for made, b in zip(self._grids_of, bins, strict=True)]

    def _skin_path(self, group: Group, axes: Mapping[str, Table]) -> FloatArray:
        """Displacement of the skin (3, m) m at the axes' time stamps."""
        operators = needed(specimen_chain(group, self._tissue), xyz("skin"), numbered("axis"))
        made = run(operators, axes["axis_1"][0], {name: value for name, (_, value) in axes.items()})
        return np.stack([made[s] for s in xyz("skin")])

    def _discrepancy_columns(self) -> tuple[FloatArray, FloatArray]:
        parts, weights = [], np.zeros(0)
        for (g, at), axes, path in zip(self.groups, self._axes, self._skin, strict=True):
            inverse = np.asarray(specimen_chain(g, self._tissue)["transducers"].matrix).reshape(3, 3)  # type: ignore[attr-defined]
            ends = self._ends[:, at]
            basis, weights = sheet_discrepancy(axes["axis_1"][0], path, ends.ravel())
            means = basis.reshape(3, *ends.shape, -1).mean(axis=1)
            parts.append(np.einsum("ij,jnq->inq", inverse, means) * float(g.skin))
        columns = np.concatenate(parts, axis=1).reshape(3 * len(self.stamps), -1)
        return columns / max(float(np.max(np.abs(columns))), 1e-12), weights

    def tissue(self, nuisance: FloatArray) -> SheetTissue:
        """The reduced sheet at a nuisance vector."""
        return sheet(nuisance, self._tissue, self._typical)

    def quantities(self, nuisance: FloatArray) -> Mapping[str, tuple[float, str]]:
        return quantities(self.tissue(nuisance))

    def _law_chain(self, group: Group, nuisance: FloatArray) -> Chain:
        """The nominal chain of a group with the tissue at a nuisance vector."""
        chain = self._nominal[group.specimen]
        if not group.skin:
            return chain
        chain = chain.tuned("tissue", tissue=self.tissue(nuisance))
        return rewired(chain, nuisance, self._typical, self._strongest)

    def _true_axes(
        self, group: Group, grid: FloatArray, axes: Mapping[str, FloatArray], active: Active
    ) -> Mapping[str, FloatArray]:
        """A group's axes at its nodes, where processing spoils their record: a sensor's small error looks
        like another stiffness, an exchange of channels like nothing that skin does."""
        spoiling = {c: values for c, values in active.items() if c.stage == "processing"}
        if not spoiling:
            return axes
        nominal, names = self._nominal[group.specimen], numbered("axis")
        erring = needed(self.with_effects(nominal, spoiling, group), AXES, axes)
        if erring == needed(nominal, AXES, axes):
            return axes

        def made(true: FloatArray) -> FloatArray:
            signals = run(erring, grid, dict(zip(names, true, strict=True)))
            return np.stack([signals[n] for n in AXES])

        def make() -> Mapping[str, FloatArray]:
            return dict(zip(names, undone(made, np.stack([axes[n] for n in names])), strict=True))

        found: Mapping[str, FloatArray] = self._linear.get((group.specimen, grid.size, erring), make)
        return found

    def _chain_forces(self, nuisance: FloatArray, active: Active, coarse: bool = False) -> FloatArray:
        """Forces of the chain (3 · n,) N, before gains, zeros and discrepancy; ``coarse`` for differences."""
        shift = nuisance[self._parts["shift"]][0]
        out = np.empty((3, len(self.stamps)))
        grids = self._coarse if coarse else self._grids_of
        parts = zip(self.groups, grids, self._sticking, self._memos[coarse], strict=True)
        for (g, at), (grid, axes), sticks, memo in parts:
            key = g.specimen, nuisance[self._parts["tissue"]].tobytes()
            chain = self._skins.get(key, partial(self._law_chain, g, nuisance))
            operators = needed(self.with_effects(chain, active, g), TRANSDUCERS, axes)
            made = memo.run(operators, self._true_axes(g, grid, axes, active))
            ends = self._ends[:, at] + shift
            forces = [made[channel] for channel in TRANSDUCERS]
            out[:, at] = [np.interp(ends, grid, force).mean(axis=0) for force in forces]
            if sticks.any() and not coarse:
                out[:, at][:, sticks] = averaged(grid, forces, ends[:, sticks])
        return out.ravel()

    def denoised(self) -> list[dict[str, Table]]:
        """Transducer forces of each group, as fitted, and the significant part of the record beyond them."""
        null = self._from_guesses(self.LAWS[-1], self.prior_sd, 6)
        beyond = (self._basis @ null.nuisance[self._parts["discrepancy"]]).reshape(3, -1)
        out = []
        for (g, at), (grid, axes) in zip(self.groups, self._grids_of, strict=True):
            made = run(needed(self._law_chain(g, null.nuisance), TRANSDUCERS, axes), grid, axes)
            tables, read = {}, recorded(self, g, TRANSDUCERS, TRANSDUCERS, smooth=False)
            for (name, (time, value)), more in zip(read.items(), beyond, strict=True):
                base = np.interp(time, grid, made[name]) + np.interp(time, self.stamps[at], more[at])
                tables[name] = (time, base + significant(time, value - base))
            out.append(tables)
        return out

    def _beside_the_chain(self, nuisance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """A nuisance vector's factor on the chain's forces, and its addition to them, (3 · n,) each."""
        part = {name: nuisance[where] for name, where in self._parts.items()}
        gain = 1 + self._gains @ part["gain"] + self._legs @ part["calibration"]
        return gain, self._zeros @ part["zero"] + self._basis @ part["discrepancy"]

    def evaluate(self, nuisance: FloatArray, active: Active, want_jacobian: bool = True) -> Evaluation:
        active = {**self._held, **active}
        n = self._parts["shift"].stop
        gain, more = self._linear.get(nuisance[n:].tobytes(), partial(self._beside_the_chain, nuisance))
        forces = self._chain_forces(nuisance, active)
        residual = self.whitened(self.measured - forces * gain - more, active)
        if not want_jacobian:
            return Evaluation(residual, np.zeros((0, 0)))
        jacobian = np.zeros((len(residual), len(nuisance)))
        roughly = self._chain_forces(nuisance, active, coarse=True)
        for k in np.flatnonzero(self.prior_sd[:n] > FROZEN).tolist():
            tissue = k < n - 1  # a shift by less than a node needs the fine ones, but no new simulation
            step = 1e-3 if tissue else 0.1 * self.dt
            moved = nuisance.copy()
            moved[k] += step
            at, here = self._chain_forces(moved, active, tissue), roughly if tissue else forces
            jacobian[:, k] = (at - here) / step * gain
        jacobian[:, n:] = np.hstack([np.hstack([self._legs, self._gains]) * forces[:, None], self._zeros, self._basis])
        return Evaluation(residual, self.whitened(jacobian, active))
