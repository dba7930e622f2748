"""The micro-robot as four blocks: set-point -> axes; axes -> probe and transducers -> force (both recomputed, no
freedom); axes -> transducers.

The axes are fed the load that the recorded forces put on them, the tissue the recorded axis positions; so a gap of
the control loop, of the arithmetic and of everything beyond the tip show in different blocks.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from acquire.recording.model import Recording
from gap.blocks import CLOCK_SD, Block, Group, GroupedSession, Table, candidates_for, compressed
from gap.chains import needed, run
from gap.hypothesis import Active, Candidate, Evaluation, FloatArray, Problem
from gap.robot_loop import CONTROLLERS, Controller
from gap.sheet_null import sheet_discrepancy
from gap.smoothing import significant
from gap.solve import Fit, fit
from sim_devices.chain import Chain, Effect, Operator
from sim_devices.stages import nominal
from sim_devices.stages.robot import TRANSDUCERS, numbered, xyz
from sim_devices.stages.tissues import SheetTissue, sheet_tissue

QUANTITIES = ("probe_x", "probe_y", "probe_z")
AXES = numbered("axis_position")
ROBOT_BINS = 0.15, 0.4
"""Growth and largest width (s) of the bins: the motion is slow."""
RELAXATION_TIMES = (0.06, 0.2, 0.6, 1.8, 5.0, 15.0, 50.0)
"""s: dense enough for any relaxation spectrum."""
SHEET_STEP = 0.05
"""s between nodes of the sheet, stamps apart."""
STAMPS_SD = 1e-3
"""s: how late or early all stamps, or all commands, may soundly be (assumed)."""
STRAINED = 60.0
"""Penalty of the loop's tolerances above which the quick fit asks for drag."""
KINK = 1e-6
"""s, within which a speed changes."""
LOOP_STEP = 0.02
"""s; the loop is exact between kinks, so this only has to resolve what is not linear in it."""


def _chain(group: Group, tissue: SheetTissue) -> Chain:
    """The nominal chain for a group: ``tissue`` if it is skin, else what its specimen is."""
    law = tissue if group.skin else _specimen(group.specimen)
    return nominal("microrobot", tissue=law)


def _specimen(name: str) -> SheetTissue:
    try:
        return sheet_tissue(name)
    except ValueError:
        return sheet_tissue("silicone")


def _recorded(
    block: Block, group: Group, names: Sequence[str], targets: Sequence[str], smooth: bool
) -> dict[str, Table]:
    """Recorded channels of a group as tables for signals of the chain, without their noise if ``smooth``."""
    out = {}
    for name, target in zip(names, targets, strict=True):
        times, values = [], []
        for k in group.members:
            series = block.session.recordings[k].streams.get(name)
            if series is None:
                continue
            value = np.asarray(series.value, dtype=float)
            good = np.isfinite(value)
            time = block.session.time(k, series)[good]
            times.append(time)
            values.append(significant(time, value[good]) if smooth else value[good])
        if times:
            out[target] = (np.concatenate(times), np.concatenate(values))
    return out


def _on_even_grid(
    operators: Sequence[Operator], wanted: Sequence[str], group: Group, stamps: FloatArray, given: Mapping[str, Table]
) -> FloatArray:
    """The wanted signals at ``stamps`` (n,) s, (signals, n), by way of even steps: the loop's exact step is then
    computed once and not for every sample."""
    tables = group.tables()
    kinks = tables["probe_x"][0]
    begin = min(stamps[0], kinks[0])
    kinks = kinks[kinks <= stamps[-1]]
    grid = np.unique(np.concatenate([np.arange(begin, stamps[-1] + LOOP_STEP, LOOP_STEP), kinks, kinks + KINK]))
    grid = grid[np.diff(grid, prepend=-np.inf) > 0.5 * KINK]
    inputs = {f"command_{a}": np.interp(grid, *tables[f"probe_{a}"]) for a in "xyz"}
    inputs |= {name: np.interp(grid, *table) for name, table in given.items()}
    made = run(operators, grid, inputs)
    return np.stack([np.interp(stamps, grid, made[name]) for name in wanted])


class AxesBlock(Block):
    """Tip set-point -> axis positions, under the load that the recorded force is.

    Nuisance: the loop's gains and the sampling convention within their tolerances, and a zero of each sensor in each
    recording. Which of the known controllers it is, the recording tells.
    """

    name, channels = "axes", AXES
    trust = 0.4  # the skin's force loads the axes, as far as the recorded force tells
    growth, widest = ROBOT_BINS
    floor = 0.5e-6  # m
    SD = (0.02, 0.02, 0.04, STAMPS_SD, CLOCK_SD, 3e-3)
    """Of the logarithms of the gains; s by which all is late; 1; s by which the load on the axes is."""
    ZERO_SD = 2e-6  # m
    STEPS = (1e-2, 1e-2, 1e-2, 1e-3, 1e-6, 1e-3)

    def __init__(self, session: GroupedSession, library: Mapping[str, Effect]) -> None:
        super().__init__(session, library)
        self._loads = [self._load(g) for g, _ in self.groups]
        self._made: dict[tuple[object, ...], FloatArray] = {}  # most effects leave the axes alone
        self._runs = np.kron(np.eye(3), self.member)
        k = len(self.SD)
        self.prior_sd = np.concatenate([self.SD, np.full(self._runs.shape[1], self.ZERO_SD)])
        self.prior_mean = np.zeros(len(self.prior_sd))
        self.local = np.zeros(len(self.prior_sd), bool)
        self.local[k:] = True
        self.alternatives = (self.prior_sd,)
        self.controller = CONTROLLERS[0]
        fits = [pair for controller in CONTROLLERS for pair in self._tried(controller)]
        self._best, self.controller = min(fits, key=lambda pair: pair[0].objective)
        alone = [f for f, controller in fits if controller is self.controller and not f.hypothesis]
        self._start = alone[0].nuisance

    def _tried(self, controller: Controller) -> list[tuple[Fit, Controller]]:
        """Quick fits with a controller; also with drag where its gains are strained without, because much drag looks
        like the other controller."""
        self.controller = controller
        fits = [fit(self, nuisance=self.prior_mean, iterations=3)]
        drag = self.library.get("viscous_drag")
        if fits[0].penalty > STRAINED and drag is not None:
            extra = Candidate("viscous_drag", drag.name, drag.stage, drag.parameters, (self.name,))
            fits.append(fit(self, (extra,), np.array([0.6]), self.prior_mean, iterations=6))
        return [(f, controller) for f in fits]

    def start(self) -> FloatArray:
        return self._start.copy()

    def _load(self, group: Group) -> dict[str, Table]:
        """The recorded force as load on the axes, N."""
        given = _recorded(self, group, xyz("force"), xyz("reaction"), smooth=True)
        given |= _recorded(self, group, AXES, numbered("axis"), smooth=True)
        if len(given) < 6:
            return {}
        time = given["axis_1"][0]
        signals = {name: np.interp(time, *table) for name, table in given.items()}
        unique, first = np.unique(time, return_index=True)
        operators = needed(_chain(group, sheet_tissue("forearm")), numbered("axis_load"), tuple(signals))
        made = run(operators, unique, {n: v[first] for n, v in signals.items()})
        return {f"pushed_{k}": (unique, made[f"axis_load_{k}"]) for k in "123"}

    def _chain(self, group: Group, nuisance: FloatArray, active: Active) -> Chain:
        chain = self.controller.installed(_chain(group, sheet_tissue("forearm")), np.exp(np.clip(nuisance[:3], -3, 3)))
        return self.with_effects(chain, active)

    def _predict(self, nuisance: FloatArray, active: Active) -> FloatArray:
        out = np.empty((3, len(self.stamps)))
        for i, ((g, at), load) in enumerate(zip(self.groups, self._loads, strict=True)):
            operators = needed(self._chain(g, nuisance, active), AXES, load)
            key = (i, operators, *nuisance[3:6].tolist())
            if key not in self._made:
                if len(self._made) > 20:
                    self._made.clear()
                shift = nuisance[3] + nuisance[4] * (self.stamps[at] - self.stamps[0])
                late = {name: (time + nuisance[5], value) for name, (time, value) in load.items()}
                self._made[key] = _on_even_grid(operators, AXES, g, self.stamps[at] + shift, late)
            out[:, at] = self._made[key]
        return out.ravel()

    def true_axes(self, group: Group, time: FloatArray) -> FloatArray:
        """Where the axes were at ``time`` (n,) s, (3, n) m, as far as the quick fits know."""
        load = self._loads[[g for g, _ in self.groups].index(group)]
        nuisance = self._best.nuisance
        operators = needed(self._chain(group, nuisance, self._best.active), numbered("axis"), load)
        return _on_even_grid(operators, numbered("axis"), group, time + nuisance[3], load)

    def evaluate(self, nuisance: FloatArray, active: Active, want_jacobian: bool = True) -> Evaluation:
        k = len(self.SD)
        moved_axes = self._predict(nuisance, active)
        residual = (self.measured - moved_axes - self._runs @ nuisance[k:]) / self.sigma
        if not want_jacobian:
            return Evaluation(residual, np.zeros((0, 0)))
        chain_part = np.empty((len(residual), k))
        for j, step in enumerate(self.STEPS):
            moved = nuisance.copy()
            moved[j] += step
            chain_part[:, j] = (self._predict(moved, active) - moved_axes) / step
        return Evaluation(residual, np.hstack([chain_part, self._runs]) / self.sigma[:, None])


class ArithmeticBlock(Block):
    """Recomputed channels: axis positions -> probe, transducers -> force. No freedom but a zero in each recording."""

    growth, widest = 0.4, 0.8  # nothing is quick in a formula, and noise there is none

    def __init__(
        self,
        session: GroupedSession,
        library: Mapping[str, Effect],
        name: str,
        source: Sequence[str],
        target: Sequence[str],
        floor: float,
    ) -> None:
        self.name, self.channels, self._source, self.floor = name, tuple(target), tuple(source), floor
        super().__init__(session, library)
        # What is recomputed carries the noise of what it is computed from: both are the recording's own.
        self.sigma = np.full(len(self.measured), floor)
        self._runs = np.kron(np.eye(3), self.member)
        self.prior_sd = np.full(self._runs.shape[1], 5 * floor)
        self.prior_mean = np.zeros(len(self.prior_sd))
        self.local = np.ones(len(self.prior_sd), bool)
        self.alternatives = (self.prior_sd,)
        self._given = [self._binned_source(g, at) for g, at in self.groups]

    def _binned_source(self, group: Group, at: slice) -> dict[str, Table]:
        out = {}
        for name in self._source:
            parts = []
            for k in dict.fromkeys(self.run[at].tolist()):
                bins = self.session.binned(name, k, self.session.kinks, self.growth, self.widest)
                parts.append(bins.value[: int(np.sum(self.run[at] == k))])
            values = np.concatenate(parts)
            out[name] = (self.stamps[at], values)
        return out

    def evaluate(self, nuisance: FloatArray, active: Active, want_jacobian: bool = True) -> Evaluation:
        out = np.empty((3, len(self.stamps)))
        for (g, at), given in zip(self.groups, self._given, strict=True):
            chain = self.with_effects(_chain(g, sheet_tissue("forearm")), active)
            signals = {n: v for n, (_, v) in given.items()}
            made = run(needed(chain, self.channels, signals), self.stamps[at], signals)
            out[:, at] = np.stack([made[c] for c in self.channels])
        residual = (self.measured - out.ravel() - self._runs @ nuisance) / self.sigma
        return Evaluation(residual, self._runs / self.sigma[:, None] if want_jacobian else np.zeros((0, 0)))


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
    DISCREPANCY_SIZE = 180

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
        raw = _recorded(self, group, AXES, numbered("axis"), smooth=False)
        time = raw["axis_1"][0]
        fitted = axes.true_axes(group, time)
        return {
            name: (time, base + significant(time, value - base))
            for (name, (_, value)), base in zip(raw.items(), fitted, strict=True)
        }

    def _discrepancy_columns(self) -> tuple[FloatArray, FloatArray]:
        parts, weights = [], np.zeros(0)
        for (g, at), axes in zip(self.groups, self._axes, strict=True):
            chain = _chain(g, self._tissue)
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
        return _chain(group, self.tissue(nuisance))

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


def robot_problems(
    recordings: Sequence[Recording],
    effects: Mapping[str, Effect],
    force: Callable[[GroupedSession, Mapping[str, Effect], AxesBlock], ForceBlock] = ForceBlock,
) -> tuple[Sequence[Problem], tuple[Candidate, ...]]:
    """The blocks that a session's channels allow, and the effects that show in them.

    ``force`` makes the block of the transducers: with the reduced tissue, or another one.

    Raises ValueError when what was commanded, or what was measured, is missing.
    """
    missing = [r.info.id for r in recordings if not all(q in r.setpoints for q in QUANTITIES)]
    if missing:
        raise ValueError(f"recording {missing[0]} has no set-points of probe_x, probe_y and probe_z")
    session = GroupedSession(recordings, QUANTITIES)

    def has(*names: str) -> bool:
        return any(all(n in r.streams for n in names) for r in recordings)

    blocks: list[Block] = []
    if has(*AXES):
        axes = AxesBlock(session, effects)
        blocks.append(axes)
    if has(*AXES, *xyz("probe")):
        blocks.append(ArithmeticBlock(session, effects, "kinematics", AXES, xyz("probe"), 2e-6))
    if has(*TRANSDUCERS, *xyz("force")):
        blocks.append(ArithmeticBlock(session, effects, "matrix", TRANSDUCERS, xyz("force"), 2e-3))
    if has(*AXES, *TRANSDUCERS):
        blocks.append(force(session, effects, axes))
    if not blocks:
        raise ValueError(f"recording {recordings[0].info.id} has neither axis positions nor transducer forces")
    return blocks, candidates_for(effects, blocks)
