"""The micro-robot's axes: set-point -> axes, under the load that the recorded force is."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from gap.data.tolerances import Tolerance
from gap.inference.evidence import Fit
from gap.inference.hypothesis import FROZEN, Active, Candidate, Evaluation, Lateness, Start
from gap.inference.least_squares import fit
from gap.null.blocks import Block
from gap.null.chains import needed, run
from gap.null.groups import Group, GroupedSession, Table
from gap.null.lateness import lateness
from gap.null.robot_grid import LOOP_CURVE, LOOP_STEP, LOOP_TURN, averaged, commanded, leading, loop_grid, retimed
from gap.null.robot_load import SPRING, RecordedLoad
from gap.null.robot_loop import Controller, controllers, stated
from gap.null.robot_recorded import recorded, steepness
from gap.null.robot_specimens import specimen_chain
from gap.null.robot_suspects import WORTH, explains, likeliest, quickly
from sim_devices.chain import Chain, Effect, FloatArray, Operator
from sim_devices.stages.axes import AxisLoop
from sim_devices.stages.operators import Retimed
from sim_devices.stages.robot import TRANSDUCERS, numbered, xyz
from sim_devices.stages.sampling import COMMANDS
from sim_devices.stages.tissues import sheet_tissue

QUANTITIES = ("probe_x", "probe_y", "probe_z")
AXES, TARGETS = numbered("axis_position"), numbered("target")
ROBOT_BINS = 0.3, 0.4
"""Growth and largest width (s) of the bins: the motion is slow."""
MOST_SUBSTEPS = 12
"""Of a step of the loop's grid, where friction or the like acts: 1 ms behind a kink, 4 ms where motion is straight."""
SETTLED, BEYOND = 3.0, 0.1
"""s for which a grid begins before the recordings, as a loop holds its load when they begin, a weight that hangs; and
by which it goes beyond them, as clocks differ."""
WEIGHTS = "proportional", "derivative", "acceleration"
"""Parts of a controller that may see more or less of a set-point than the known ones do."""
KICK = 1e-3
"""s for which a card's cycles and filter show a rate where the set-point jumps, of a derivative that is the error's."""
KICKED, NEARLY = 0.02, 2e-3
"""s behind such a jump for which an axis shows in which part of the card's cycle it fell, and s by which a stamp may be
early."""
ANSWERS, ROUGHLY = 0.05, 0.03
"""s within which an axis answers to a kick, and the share of its way that is not known meanwhile (assumed): the coils'
force is late to first order only."""
LATEST = 2e-3
"""s at most that the coils' force is late: what follows to first order is not known beyond."""
SHIFT, CLOCK = 3, 4
"""The nuisance by which all is late, s, and that of the clock, 1."""
SOMEWHERE = 0.3
"""Quantile of its prior at which an effect does something: most do nothing in the middle of a range about nought."""


def _stable(axes: Operator) -> bool:
    return not isinstance(axes, AxisLoop) or axes.stable


class AxesBlock(Block):
    """Tip set-point -> axis positions, under the load that the recorded force is.

    Nuisance: the loop's gains and the sampling convention within their tolerances, and a zero of each sensor in each
    recording. Which of the known controllers it is, the recording tells.
    """

    name, channels, input_block = "axes", AXES, "force"
    trust = 0.5  # the skin's force loads the axes, as far as the recorded force tells
    growth, widest = ROBOT_BINS
    floor = 0.5e-6  # m
    TOLERANCES = 12
    """Logarithms of three gains; s by which all is late; 1, of the clock; s by which the load on the axes is late;
    N s/m of drag; s by which the coils' force is late; by how much more the set-point and its rate weigh, the share of
    the mass that is fed forward; and the logarithm of how long a coil is at its limit where the set-point jumps, over
    `KICK`."""
    ZERO_SD = 2e-6  # m
    STEPS = (1e-2, 1e-2, 1e-2, 1e-3, 1e-6, 1e-3, 0.1, 1e-4, 1e-2, 1e-2, 1e-2, 5e-2)
    NEAR = 0.5
    """Of the logarithms of the gains, within which the Jacobian of another place is good enough for a step."""

    def __init__(self, session: GroupedSession, library: Mapping[str, Effect]) -> None:
        super().__init__(session, library)
        self._forces = [recorded(self, g, TRANSDUCERS, TRANSDUCERS, smooth=True) for g, _ in self.groups]
        self._seen = [recorded(self, g, AXES, numbered("axis"), smooth=True) for g, _ in self.groups]
        self.blur_steep_parts(steepness(self, self._seen, numbered("axis")))
        self._grids_ahead: dict[tuple[str, bool], tuple[FloatArray, tuple[Operator, ...], dict[str, FloatArray]]] = {}
        self._made: dict[tuple[object, ...], FloatArray] = {}  # most effects leave the axes alone
        self._kept: list[tuple[FloatArray, FloatArray]] = []  # Jacobians, by the gains that they were made at
        self._misleading: dict[str, bool] = {}
        self._runs = np.kron(np.eye(3), self.member)
        self.prior_mean = self.sound = np.zeros(self.TOLERANCES + self._runs.shape[1])
        self._known = controllers(stated([session.recordings[k] for k in self.runs]))
        ways = [(controller, held) for controller in self._known for held in (False, True)[: 1 + session.sampled]]
        alone, self._rubs = likeliest(self, self._take, ways, library)
        self.suspected = frozenset(self._rubs)
        self._best = min([alone, *self._rubs.values()], key=lambda f: f.objective)
        self._start, self._strained = alone.nuisance, not explains(alone)
        self._leave_out_kicks()

    def _leave_out_kicks(self) -> None:
        """Have rows tell nothing in which an axis shows what the controller's derivative of the error made of a
        jump, and less while it answers to that."""
        if not self.controller.on_error:
            return
        jumps = np.append(-np.inf, self._jumps())
        last = jumps[np.searchsorted(jumps[1:], self.stamps + NEARLY, side="right")]
        since = np.where(np.isfinite(last), self.stamps - last, np.inf)
        moved = np.zeros((len(AXES), len(since)))
        for (_, at), seen in zip(self.groups, self._seen, strict=True):
            for row, axis in zip(moved, numbered("axis"), strict=True):
                row[at] = np.abs(np.interp(last[at] + 3.0 * ANSWERS, *seen[axis]) - np.interp(last[at], *seen[axis]))
        self.row_noise.blur((ROUGHLY * moved * np.exp(-since / ANSWERS)).ravel())
        self.row_noise.widen(np.flatnonzero(np.tile(since < KICKED, len(AXES))))

    def _jumps(self) -> FloatArray:
        """When the set-point jumps (k,), s."""
        commands = [group.commands[q] for group, _ in self.groups for q in QUANTITIES]
        return np.unique(np.concatenate([command.steps for command in commands]))

    def lateness(self, fitted: Fit) -> Lateness | None:
        in_time = np.where(np.isin(np.arange(len(fitted.nuisance)), (SHIFT, CLOCK)), 0.0, fitted.nuisance)
        kinks, marks = self.session.kinks, self.session.marks
        return lateness(self, fitted, kinks, self._jumps(), marks, SHIFT, (fitted.nuisance, in_time))

    def _take(self, controller: Controller, held: bool) -> None:
        """Assume a controller that has sampled rows of a command ``held`` until the next or goes straight in between,
        and the tolerances of a sound instrument with it."""
        self.controller, self.held = controller, held
        self.prior_sd = self._prior(lambda t: t.widest)
        self.prior_scales = (self._prior(lambda t: t.value), self.prior_sd)
        self._forget()

    def _prior(self, width: Callable[[Tolerance], float]) -> FloatArray:
        """Prior widths (p,) of a sound instrument, by the one of its tolerances that ``width`` takes.

        Drag acts as the derivative gain of a controller that damps the position, and is not free there. One that
        damps the error may weigh its set-point, which acts as drag does.
        """
        own, loop = self.tolerances, self.tolerances["loop"]
        gains = [width(loop[name]) for name in ("proportional", "integral", "derivative")]
        late = max(own["latency"]["delay"].value, self.shift_sd)
        drag = own["viscous_drag"]["drag"].value if self.controller.on_error else FROZEN
        rest = [late, own["clock_skew"]["rate"].value, loop["load"].value, drag]
        rest += [loop["lag"].value, *(width(loop[f"{name}_weight"]) for name in WEIGHTS)]
        rest.append(loop["kick"].value if self.controller.on_error else FROZEN)
        return np.array([*gains, *rest, *[self.ZERO_SD] * self._runs.shape[1]])

    def reload(self, forces: Mapping[str, dict[str, Table]]) -> None:
        """Take the load from transducer forces, a table each by specimen, instead of the smoothed record where there
        are some; then the slow noise of the axes shows.

        Smoothing rounds the force where motion turns, and the loop answers to that for a tenth of a second.
        """
        known = zip(self.groups, self._forces, strict=True)
        self._forces = [forces.get(g.specimen, smoothed) for (g, _), smoothed in known]
        self._forget()
        best = self._best
        self._best = fit(self, best.hypothesis, best.unit, best.nuisance, iterations=3)
        alone = self._best if not best.hypothesis else fit(self, nuisance=self._start, iterations=3)
        if not explains(alone):
            alone = self._reconsidered(alone)
        alone = self._levered(alone)
        self._start = alone.nuisance
        self.remember(self._best)

    def _reconsidered(self, alone: Fit) -> Fit:
        """The fit of another controller, which is taken if it explains the axes by itself under the load that is known
        now, or ``alone``, the one of the controller that was taken."""
        taken = self.controller
        for controller in (c for c in self._known if c != taken):
            found = self._plain(controller, self.held)
            if explains(found):
                self._best, self._strained = found, False
                if not taken.on_error:
                    self._leave_out_kicks()
                return found
        self._take(taken, self.held)
        return alone

    def _levered(self, alone: Fit) -> Fit:
        """The fit of the same controller whose axes are loaded by the other lever arms, if that is worth it, or
        ``alone``: these are the mechanics', and no controller's."""
        taken = self.controller
        other = self._plain(replace(taken, centred=not taken.centred), self.held)
        if other.objective < min(alone.objective, self._best.objective) - WORTH:
            self._best = other
            return other
        self._take(taken, self.held)
        return alone

    def _forget(self) -> None:
        """Drop tables made for another load or controller."""
        groups = zip(self.groups, self._forces, self._seen, strict=True)
        centred, tissue = self.controller.centred, sheet_tissue("forearm")
        self._read = [RecordedLoad(specimen_chain(g, tissue), f, axes, centred) for (g, _), f, axes in groups]
        self._loads = [read.load() for read in self._read]
        self._undone: tuple[tuple[object, ...], Sequence[dict[str, Table]]] = (), ()
        self._made.clear()
        self._kept.clear()

    def _plain(self, controller: Controller, held: bool) -> Fit:
        self._take(controller, held)
        return quickly(self)

    def start(self) -> FloatArray:
        return self._start.copy()

    def quantities(self, nuisance: FloatArray) -> Mapping[str, tuple[float, str]]:
        names = ("loop_gain_1", "loop_gain_2", "loop_gain_3")
        gains = {n: (float(np.exp(v)), "1") for n, v in zip(names, nuisance, strict=False)}
        times = {"delay": (float(nuisance[3]), "s"), "clock_rate": (float(nuisance[4]), "s/s")}
        return (
            gains | times | {"coil_lag": (float(nuisance[7]), "s"), "setpoint_weight": (1.0 + float(nuisance[8]), "1")}
        )

    def warm_start(self, hypothesis: Sequence[Candidate], unit: FloatArray) -> Start | None:
        # Strained tolerances have taken on much of an effect.
        if not self._strained:
            return None
        known = self._rubs.get(hypothesis[0].key) if len(hypothesis) == 1 else None
        if known is not None:
            return Start(self.prior_mean, self.prior_sd, known.nuisance, known.unit)
        return Start(self.prior_mean, self.prior_sd, self.prior_mean, unit)

    def _loads_under(self, active: Active) -> tuple[Sequence[dict[str, Table]], tuple[object, ...]]:
        """The loads of all groups once errors of the transducers among the effects are undone, and a key that tells
        them from others."""
        key = tuple((c.key, *sorted(v.items())) for c, v in active.items() if self._misleads(c))
        if key and key != self._undone[0]:
            loads = []
            for (g, _), read in zip(self.groups, self._read, strict=True):
                chain = specimen_chain(g, sheet_tissue("forearm"), self.session.marks)
                loads.append(read.load(self.with_effects(chain, active, g)))
            self._undone = key, loads
        return (self._undone[1] if key else self._loads), key

    def _misleads(self, candidate: Candidate) -> bool:
        """Whether an effect falsifies the transducers' load."""
        if candidate.key not in self._misleading:
            given = (*xyz("reaction"), *numbered("axis"))
            chain = specimen_chain(self.groups[0][0], sheet_tissue("forearm"), self.session.marks)
            values = candidate.values(np.full(len(candidate.parameters), SOMEWHERE))
            changed = self.with_effects(chain, {candidate: values}, self.groups[0][0])
            misled = needed(changed, TRANSDUCERS, given) != needed(chain, TRANSDUCERS, given)
            self._misleading[candidate.key] = misled
        return self._misleading[candidate.key]

    def greatest(self) -> float:
        """The greatest force that a coil has to hold in the session, N; 0 where that is not known."""
        return max(read.greatest() for read in self._read)

    def _loop(self, group: Group, nuisance: FloatArray, active: Active) -> Chain:
        chain = self.controller.installed(
            specimen_chain(group, sheet_tissue("forearm"), self.session.marks),
            np.exp(np.clip(nuisance[:3], -3, 3)),
            float(nuisance[6]),
            float(np.clip(nuisance[7], -LATEST, LATEST)),
            tuple(nuisance[8:11].tolist()),
            KICK * float(np.exp(np.clip(nuisance[11], -2.0, 2.0))),
        )
        spring = SPRING if self._loads[0] else 0.0
        return self.with_effects(chain.tuned("axes", spring=spring, most_substeps=MOST_SUBSTEPS), active, group)

    def _predict(self, nuisance: FloatArray, active: Active) -> FloatArray:
        out = np.empty((3, len(self.stamps)))
        loads, undone = self._loads_under(active)
        for i, ((g, at), load) in enumerate(zip(self.groups, loads, strict=True)):
            chain = self._loop(g, nuisance, active)
            if not _stable(chain["axes"]):
                return np.full(out.size, np.inf)  # nobody runs such a robot, and its simulation takes long
            operators = needed(chain, AXES, load)
            key = (i, operators, undone, *nuisance[3:6].tolist())
            if key not in self._made:
                if len(self._made) > 20:
                    self._made.clear()
                late = self._arriving(load, nuisance)
                # Two nodes of a bin are not enough: behind a kink the loop answers within a part of it.
                grid, made = self._on_grid(g, operators, late)
                ends = self._commanded(self._ends[:, at], nuisance)
                self._made[key] = averaged(grid, [made[c] for c in AXES], ends)
            out[:, at] = self._made[key]
        return out.ravel()

    def _commanded(self, time: FloatArray, nuisance: FloatArray) -> FloatArray:
        """The record's ``time`` s by the command's clock."""
        return np.asarray(time + nuisance[3] + nuisance[4] * self.session.clock_age(time))

    def _arriving(self, load: Mapping[str, Table], nuisance: FloatArray) -> dict[str, Table]:
        """Tables of a ``load``, all at the same times, by the command's clock."""
        time, _ = next(iter(load.values()), (np.zeros(0), None))
        due = self._commanded(time, nuisance) + nuisance[5]
        return {name: (due, value) for name, (_, value) in load.items()}

    def true_axes(self, group: Group, time: FloatArray) -> FloatArray:
        """Where the axes were at ``time`` (n,) s, (3, n) m, as far as the quick fits know."""
        nuisance = self._best.nuisance
        load = self._loads[[g for g, _ in self.groups].index(group)]
        late = self._arriving(load, nuisance)
        operators = needed(self._loop(group, nuisance, self._best.active), numbered("axis"), load)
        at = self._commanded(time, nuisance)
        return self._at(at, numbered("axis"), group, operators, late)

    def _at(
        self,
        stamps: FloatArray,
        wanted: Sequence[str],
        group: Group,
        operators: Sequence[Operator],
        given: Mapping[str, Table],
    ) -> FloatArray:
        """The wanted signals at ``stamps`` (n,) s, (signals, n), by way of a group's own grid: the loop's exact step is
        then computed for few lengths and not for every sample, and the stages ahead of it but once."""
        grid, made = self._on_grid(group, operators, given)
        return np.stack([np.interp(stamps, grid, made[name]) for name in wanted])

    def _on_grid(
        self, group: Group, operators: Sequence[Operator], given: Mapping[str, Table]
    ) -> tuple[FloatArray, Mapping[str, FloatArray]]:
        """A group's grid, (n,) s, and the signals that operators make there."""
        lead = leading(operators)
        grid, further, signals = self._grid_ahead(group, lead, retimed(operators))
        operators = operators[len(lead) :]
        if operators[: len(further)] == further:
            operators = operators[len(further) :]
        return grid, run(operators, grid, signals | {name: np.interp(grid, *table) for name, table in given.items()})

    def _grid_ahead(
        self, group: Group, lead: tuple[Retimed, ...], delays: tuple[Retimed, ...]
    ) -> tuple[FloatArray, tuple[Operator, ...], dict[str, FloatArray]]:
        """Even steps, finer after kinks as ``delays`` show them; the nominal operators between those that ``lead`` and
        the axes, and all signals up to there."""

        def make() -> tuple[FloatArray, tuple[Operator, ...], dict[str, FloatArray]]:
            tables = {COMMANDS[q]: table for q, table in group.tables(self.held).items()}
            corners = np.unique(np.concatenate([time for time, _ in tables.values()]))
            spans = [self.session.span(k) for k in group.members]
            begin, end = min(spans[0][0], corners[0]) - SETTLED, spans[-1][1] + BEYOND
            pace = self.session.pace(group.members, LOOP_STEP, LOOP_TURN, LOOP_CURVE)
            grid = loop_grid(self.session.kinks, corners, begin, end, delays, pace)
            ahead = needed(specimen_chain(group, sheet_tissue("forearm"), self.session.marks), TARGETS, tables)
            further = ahead[len(leading(ahead)) :]
            return grid, further, run(further, grid, commanded(grid, tables, lead))

        if delays:
            found: tuple[FloatArray, tuple[Operator, ...], dict[str, FloatArray]]
            found = self._delayed.get((group.specimen, self.held, lead, delays), make)
            return found
        key = group.specimen, self.held
        if key not in self._grids_ahead:
            self._grids_ahead[key] = make()
        return self._grids_ahead[key]

    def evaluate(self, nuisance: FloatArray, active: Active, want_jacobian: bool = True) -> Evaluation:
        k = self.TOLERANCES
        difference = self.measured - self._predict(nuisance, active) - self._runs @ nuisance[k:]
        with np.errstate(invalid="ignore"):  # of an axis that does not come to rest
            residual = self.whitened(difference, active)
            return Evaluation(residual, self._tolerances(nuisance, active) if want_jacobian else np.zeros((0, 0)))

    def _tolerances(self, nuisance: FloatArray, active: Active) -> FloatArray:
        """Whitened Jacobian (n, p) of the nuisance, of the prediction without any effect, at the first gains within
        `NEAR` of these: tolerances are narrow, so that a costly effect changes little in their columns."""
        kept = next((jac for gains, jac in self._kept if np.max(np.abs(gains - nuisance[:3])) < self.NEAR), None)
        if kept is None:
            nominal = self._predict(nuisance, {})
            chain_part = np.empty((len(nominal), self.TOLERANCES))
            for j, step in enumerate(self.STEPS):
                moved = nuisance.copy()
                moved[j] += step
                chain_part[:, j] = (self._predict(moved, {}) - nominal) / step
            kept = np.hstack([chain_part, self._runs])
            if np.isfinite(kept).all():
                self._kept.append((nuisance[:3].copy(), kept))
        return self.whitened(kept, active)
