"""The micro-robot's block with the skin in it: recorded axis positions -> transducer forces."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from gap.blocks import Block, Group, GroupedSession, Table, compressed
from gap.chains import needed, run
from gap.hypothesis import Active, Evaluation, FloatArray
from gap.robot_axes import AXES, ROBOT_BINS, STAMPS_SD, AxesBlock, recorded, specimen_chain
from gap.sheet_null import sheet_discrepancy
from gap.smoothing import significant
from gap.solve import fit
from sim_devices.chain import Chain, Effect
from sim_devices.stages.robot import TRANSDUCERS, numbered, xyz
from sim_devices.stages.tissues import SheetTissue, sheet_tissue

RELAXATION_TIMES = (0.06, 0.2, 0.6, 1.8, 5.0, 15.0, 50.0)
"""s: dense enough for any relaxation spectrum."""
SHEET_STEP = 0.05
"""s between nodes of the sheet, stamps apart."""


class ForceBlock(Block):
    """Recorded axis positions -> transducer forces.

    Nuisance: the reduced sheet's parameters; the sampling convention; the transducers' calibration; per recording a
    gain and their zeros; what other sheets could do.
    """

    name, channels = "force", TRANSDUCERS
    trust = 0.08
    growth, widest = ROBOT_BINS
    floor = 0.3e-3  # N
    TISSUE: tuple[str, ...] = ("stiffness1", "stiffness2", "stiffness3", "angle", "length", "exponent",
              *(f"relaxation{k + 1}" for k in range(len(RELAXATION_TIMES))), "softening")  # fmt: skip
    TISSUE_SD: tuple[float, ...] = (1.0, 1.0, 1.0, 1.5, 0.7, 0.3, *[0.1] * len(RELAXATION_TIMES), 0.04)
    GAIN_SD = 0.04  # of the tissue's stiffness between recordings
    CALIBRATION_SD = 2e-3  # of each transducer
    ZERO_SD = 3e-3  # N
    DISCREPANCY_SD = 0.02  # of the force, per basis function
    DISCREPANCY_SCALES = (0.15, 0.5, 2.0, 8.0)
    DISCREPANCY_SIZE = 400

    def __init__(self, session: GroupedSession, library: Mapping[str, Effect], axes: AxesBlock) -> None:
        super().__init__(session, library)
        self._tissue = replace(
            sheet_tissue("forearm"),
            relaxation=(0.5 / len(RELAXATION_TIMES),) * len(RELAXATION_TIMES),
            times=RELAXATION_TIMES,
        )
        self._axes = [self._smoothed(g, axes) for g, _ in self.groups]
        self._grids_of = [self._grid_of(g, at, axes) for (g, at), axes in zip(self.groups, self._axes, strict=True)]
        self._zeros = np.kron(np.eye(3), self.member)
        self._gains = np.tile(self.member, (3, 1))
        self._legs = np.kron(np.eye(3), np.ones((len(self.stamps), 1)))
        size = max(float(np.ptp(self.measured)), 10 * float(np.median(self.sigma)))
        columns, weights = compressed(*self._discrepancy_columns(), self.DISCREPANCY_SIZE)
        self._basis = columns * size
        runs = self.member.shape[1]
        sd = {
            "tissue": np.asarray(self.TISSUE_SD),
            "shift": np.array([STAMPS_SD]),
            "calibration": np.full(3, self.CALIBRATION_SD),
            "gain": np.full(runs, self.GAIN_SD),
            "zero": np.full(3 * runs, self.ZERO_SD),
            "discrepancy": self.DISCREPANCY_SD * weights,
        }
        ends = np.cumsum([len(v) for v in sd.values()])
        self._parts = {name: slice(end - len(v), end) for (name, v), end in zip(sd.items(), ends.tolist(), strict=True)}
        self.prior_sd = np.concatenate(list(sd.values()))
        self.prior_mean = np.zeros(len(self.prior_sd))
        self.local = np.zeros(len(self.prior_sd), bool)
        self.local[self._parts["gain"].start : self._parts["zero"].stop] = True
        widths = []
        for scale in self.DISCREPANCY_SCALES:
            widths.append(self.prior_sd.copy())
            widths[-1][self._parts["discrepancy"]] *= scale
        self.alternatives = tuple(widths)
        self._start: FloatArray | None = None

    @property
    def plain_sd(self) -> FloatArray:
        sd = self.alternatives[0].copy()
        sd[self._parts["discrepancy"]] = 1e-6
        return sd

    def start(self) -> FloatArray:
        """The null's fit, which also tells how far other sheets are from the reduced one."""
        if self._start is None:
            null = fit(self, nuisance=self.prior_mean)
            self._start, self.prior_sd = null.nuisance, null.best_prior(self.alternatives)
        return self._start.copy()

    def _grid_of(self, group: Group, at: slice, axes: Mapping[str, Table]) -> tuple[FloatArray, dict[str, FloatArray]]:
        """Nodes for a group, fine enough for a sheet between them, and the axes there."""
        begin, end = self.stamps[at][0], self.stamps[at][-1]
        kinks = group.tables()["probe_x"][0]
        time = axes["axis_1"][0]
        even = np.arange(min(begin, time[0]), end, SHEET_STEP)
        grid = np.unique(
            np.concatenate([even, self.stamps[at], kinks[(kinks > even[0]) & (kinks < end)], [end + 0.05]])
        )
        return grid, {name: np.interp(grid, *table) for name, table in axes.items()}

    def _smoothed(self, group: Group, axes: AxesBlock) -> dict[str, Table]:
        """Recorded axis positions of a group without their sensors' noise: the fitted axes, and the significant part
        of what the record shows beyond them."""
        raw = recorded(self, group, AXES, numbered("axis"), smooth=False)
        time = raw["axis_1"][0]
        fitted = axes.true_axes(group, time)
        return {
            name: (time, base + significant(time, value - base))
            for (name, (_, value)), base in zip(raw.items(), fitted, strict=True)
        }

    def _discrepancy_columns(self) -> tuple[FloatArray, FloatArray]:
        parts, weights = [], np.zeros(0)
        for (g, at), axes in zip(self.groups, self._axes, strict=True):
            chain = specimen_chain(g, self._tissue)
            time = axes["axis_1"][0]
            made = run(needed(chain, xyz("skin"), numbered("axis")), time, {n: t[1] for n, t in axes.items()})
            inverse = np.asarray(chain["transducers"].matrix).reshape(3, 3)  # type: ignore[attr-defined]
            basis, weights = sheet_discrepancy(time, np.stack([made[s] for s in xyz("skin")]), self.stamps[at])
            legs = np.einsum("ij,jnq->inq", inverse, basis) * float(g.skin)
            parts.append(legs)
        columns = np.concatenate(parts, axis=1).reshape(3 * len(self.stamps), -1)
        return columns / max(float(np.max(np.abs(columns))), 1e-12), weights

    def tissue(self, nuisance: FloatArray) -> SheetTissue:
        """The reduced sheet at a nuisance vector."""
        c = dict(zip(self.TISSUE, nuisance, strict=False))
        base = self._tissue
        k1, k2, k3 = (k * float(np.exp(np.clip(c[f"stiffness{i + 1}"], -8, 5))) for i, k in enumerate(base.stiffness))
        return replace(
            base,
            stiffness=(k1, k2, k3),
            angle=base.angle + c["angle"],
            length=base.length * float(np.exp(np.clip(c["length"], -3, 3))),
            exponent=float(np.clip(base.exponent + c["exponent"], -0.3, 3.0)),
            relaxation=tuple(g + c[f"relaxation{i + 1}"] for i, g in enumerate(base.relaxation)),
            softening=base.softening + c["softening"],
        )

    def _law_chain(self, group: Group, nuisance: FloatArray) -> Chain:
        """The nominal chain of a group with the tissue at a nuisance vector."""
        return specimen_chain(group, self.tissue(nuisance))

    def _chain_forces(self, nuisance: FloatArray, active: Active) -> FloatArray:
        shift = nuisance[self._parts["shift"]][0]
        out = np.empty((3, len(self.stamps)))
        for (g, at), (grid, axes) in zip(self.groups, self._grids_of, strict=True):
            operators = needed(self.with_effects(self._law_chain(g, nuisance), active), TRANSDUCERS, axes)
            made = run(operators, grid, axes)
            out[:, at] = np.stack([np.interp(self.stamps[at] + shift, grid, made[c]) for c in TRANSDUCERS])
        return out.ravel()

    def evaluate(self, nuisance: FloatArray, active: Active, want_jacobian: bool = True) -> Evaluation:
        part = {name: nuisance[where] for name, where in self._parts.items()}
        gain = 1 + self._gains @ part["gain"] + self._legs @ part["calibration"]
        forces = self._chain_forces(nuisance, active)
        predicted = forces * gain + self._zeros @ part["zero"] + self._basis @ part["discrepancy"]
        residual = (self.measured - predicted) / self.sigma
        if not want_jacobian:
            return Evaluation(residual, np.zeros((0, 0)))
        n = self._parts["shift"].stop
        chain_part = np.empty((len(residual), n))
        for k in range(n):
            moved = nuisance.copy()
            step = 1e-3 if k < n - 1 else 0.1 * self.dt
            moved[k] += step
            chain_part[:, k] = (self._chain_forces(moved, active) - forces) / step * gain
        scaled = np.hstack([self._legs, self._gains]) * forces[:, None]
        return Evaluation(residual, np.hstack([chain_part, scaled, self._zeros, self._basis]) / self.sigma[:, None])
