"""The pressure that meets the skin: as recorded, without the gauge's noise, and as an actuator's or gauge's effect has
it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from gap.data.binning import node_times
from gap.data.noise import SHRUNK, denoised
from gap.inference.hypothesis import Active
from gap.null.blocks import Block
from gap.null.chains import Kept, needed, run, undone
from gap.null.groups import Group, GroupedSession, Table
from gap.null.suction_line import NO_TISSUE, chain_of, commanded_line, sound_chain
from gap.null.suction_pressure import PressureBlock
from sim_devices.chain import Chain, Effect, FloatArray
from sim_devices.stages.operators import Map, Noise, Pass
from sim_devices.stages.sampling import simulate


class FedPressure:
    """Recorded pressures of a session as inputs of the skin; ``pressure`` is the fitted block of the gauge, where its
    channel was recorded. Taken ``as_read``, they keep the error that the gauge's tolerances would explain, and all of
    the rest that its regulator did not foretell."""

    def __init__(self, session: GroupedSession, pressure: PressureBlock | None, as_read: bool) -> None:
        self.session, self._pressure, self._as_read = session, pressure, as_read
        self._before = Kept(8)

    def smoothed(self, group: Group) -> Table:
        """Recorded pressure of a group as a table, without its gauge noise; where none was recorded, the one that the
        regulator, as fitted elsewhere, makes of the command, or the command itself."""
        recorded, commanded = self.session.recorded("pressure", group), group.tables(self.session.held)
        if not recorded:
            return commanded["pressure"] if self._pressure is None else self._made(group, self._pressure)
        time, value = recorded["pressure"]
        if self._pressure is None:
            chain, kinks = chain_of(self.session, group, NO_TISSUE, command_step=0.0), group.commands["pressure"].kinks
            fine, base = commanded_line(chain, commanded, kinks, time, np.zeros_like)
        else:
            fine, base = self._pressure.line(group, time)
            value = value if self._as_read else self._pressure.true(group, time, value)
        period = self._pressure.dt if self._pressure is not None and self._pressure.averaged else 0.0
        foretold = np.interp(node_times(time, np.zeros(len(time)), period), fine, base).mean(axis=0)
        off = value - foretold
        levels, by_level = off_by_level(foretold, off)
        rest = off - np.interp(foretold, levels, by_level)
        rest = denoised(time, rest, shrunk=0.0 if self._as_read else SHRUNK)
        return fine, base + np.interp(base, levels, by_level) + np.interp(fine, time, rest)

    def _made(self, group: Group, pressure: PressureBlock) -> Table:
        """The pressure that the regulator, as fitted elsewhere, makes of a group's command."""
        spans = [self.session.span(k) for k in group.members]
        return pressure.line(group, np.concatenate([np.arange(*s, pressure.dt) for s in spans]))

    def beside(self, chain: Chain, group: Group, active: Active, line: Table) -> Table:
        """The true pressure, where ``line`` is the recorded one: as it is for an actuator's effect, less the gauge's
        error for its own: of one with a memory the error that a nominal regulator would meet."""
        wanted = ("line_pressure", "pressure")
        sound = sound_chain(self.session.instrument, self.session.marks)
        if all(c.stage == "tissue" for c in active):
            return line
        height = self.session.recorded("apex_height", group, smoothed=True)  # which a gauge may read, too
        known = (wanted[0], *height)
        if needed(chain, wanted[1:], known) == needed(sound, wanted[1:], known):
            return line
        partial = replace(chain, operators=needed(chain, wanted, height))
        gauge = needed(chain, wanted[1:], known)
        time, pressure = line

        def corrected() -> Table:
            if all(isinstance(op, Map | Pass | Noise) for op in gauge):  # no memory: of the pressure at once
                beside = {name: np.interp(time, *table) for name, table in height.items()}
                return time, undone(lambda true: run(gauge, time, {wanted[0]: true, **beside})["pressure"], pressure)
            made = simulate(partial, group.tables(self.session.held), dict.fromkeys(wanted, time), height)
            return time, pressure + (made["line_pressure"] - made["pressure"])

        lines: Table = self._before.get((group.specimen, id(time), partial), corrected)
        return lines


LEVELS, BY_LEVEL = 9, 0.5
"""Number of pressures, evenly spaced, at which a record's error is told by level; and the share of its squares that
this must explain."""


def off_by_level(foretold: FloatArray, off: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Levels (k,) Pa and by how much a record is off at each, (k,) Pa, where its error ``off`` (n,) Pa mostly follows
    the pressure (n,) Pa that was ``foretold``, as with a leak or a bent gauge; nought elsewhere.

    Such an error steps with the pressure: a mean over time, which takes the noise out of it, would smear each step.
    """
    known = np.isfinite(off)
    levels = np.linspace(np.min(foretold), np.max(foretold) + 1e-9, LEVELS)
    near = np.interp(foretold[known], levels, np.arange(LEVELS))
    hats = np.maximum(1.0 - np.abs(near[:, None] - np.arange(LEVELS)), 0.0)
    by_level = np.asarray(np.linalg.lstsq(hats, off[known], rcond=None)[0])
    left = np.sum(np.square(off[known] - hats @ by_level))
    mostly = left < (1.0 - BY_LEVEL) * np.sum(np.square(off[known]))
    return levels, by_level * mostly


AT_REST, SURE = 5, 3.0
"""Rows before suction that tell a recording's reading at rest, and the standard errors that it must be off nought."""


class FedBlock(Block):
    """A block whose chain is fed the recorded pressure; commands are placed on the record's clock."""

    as_read = False  # for skin, without the gauge's error and noise

    def __init__(
        self,
        session: GroupedSession,
        library: Mapping[str, Effect],
        pressure: PressureBlock | None,
        without: Sequence[str],
    ) -> None:
        super().__init__(session, library, without)
        self._pressure = pressure
        self._fed = FedPressure(session, pressure, self.as_read)
        self._line = [self._fed.smoothed(g) for g, _ in self.groups]

    def with_effects(self, chain: Chain, active: Active, group: Group) -> Chain:
        """With the active effects but for those on the way of a command to the regulator: the record, whose clock the
        commands go by here, has them already."""
        out = super().with_effects(chain, active, group)
        if self._pressure is None or not active:
            return out
        late, due = (needed(c, ("due_pressure",)) for c in (out, chain))
        if late == due:
            return out
        return replace(out, operators=(*due, *(op for op in out.operators if op not in late)))

    def read(
        self,
        sound: Callable[[Group], Chain],
        shift: float,
        active: Active,
        solid: Sequence[Table | None] = (),
        coarse: bool = False,
    ) -> FloatArray:
        """The channel (n,) ``shift`` s late, as each group's ``sound`` chain makes it with effects of the pressure that
        it is fed; ``solid`` has the heights of specimens that do not yield, group by group. As for `simulated`."""
        out = np.empty(len(self.stamps))
        for j, (g, at) in enumerate(self.groups):
            chain = self.with_effects(sound(g), active, g)
            given = {"line_pressure": self._fed.beside(chain, g, active, self._line[j])}
            if solid and (height := solid[j]) is not None:
                given["bulge"] = height
            out[at] = self.simulated(chain, g, at, shift, given, coarse)[0]
        return out

    def tables(self, group: Group) -> dict[str, Table]:
        """The commands by the record's clock: a zero that is taken milliseconds off is off by as many micrometres."""
        tables = super().tables(group)
        if self._pressure is None:
            return tables
        return {q: (t - self._pressure.early(t), value) for q, (t, value) in tables.items()}

    def kinks(self, group: Group) -> FloatArray:
        kinks = super().kinks(group)
        return kinks if self._pressure is None else kinks - self._pressure.early(kinks)

    def read_at_rest(self, k: int) -> float:
        """How far from nought recording ``k`` reads just before its first suction, for sure: where the zero is taken
        once in the session, by the deformation that earlier suction left."""
        rest = np.flatnonzero((self.run == k) & (self.stamps < self.session.onset(k)))[-AT_REST:]
        if not len(rest):
            return 0.0
        sure = SURE * float(np.sqrt(np.mean(np.square(self.sigma[rest])) / len(rest)))
        return max(abs(float(np.mean(self.measured[rest]))) - sure, 0.0)
