"""The pressure that meets the skin: as recorded, without the gauge's noise, and as an actuator's or gauge's effect has
it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from gap.data.noise import denoised
from gap.inference.hypothesis import Active
from gap.null.blocks import Block, Group, GroupedSession, Table
from gap.null.chains import Kept, needed
from gap.null.suction_pressure import NO_TISSUE, PressureBlock, chain_of, commanded_line, sound_chain
from sim_devices.chain import Chain, Effect, FloatArray
from sim_devices.stages.sampling import simulate


class FedPressure:
    """Recorded pressures of a session as inputs of the skin; ``pressure`` is the fitted block of the gauge, where its
    channel was recorded."""

    def __init__(self, session: GroupedSession, pressure: PressureBlock | None) -> None:
        self.session, self._pressure = session, pressure
        self._before = Kept(8)

    def smoothed(self, group: Group) -> Table:
        """Recorded pressure of a group as a table, without its gauge noise; the command where none was recorded."""
        recorded = self.session.recorded("pressure", group)
        if not recorded:
            return group.tables()["pressure"]
        time, value = recorded["pressure"]
        if self._pressure is None:
            fine, base = commanded_line(
                chain_of(self.session, group, NO_TISSUE, command_step=0.0), group, time, np.zeros_like
            )
        else:
            (fine, base), value = self._pressure.line(group, time), self._pressure.true(value)
        remainder = denoised(time, value - np.interp(time, fine, base))
        return fine, base + np.interp(fine, time, remainder)

    def beside(self, chain: Chain, group: Group, active: Active, line: Table) -> Table:
        """The true pressure, where ``line`` is the recorded one: as it is for an actuator's effect, less the gauge's
        error for its own."""
        wanted = ("line_pressure", "pressure")
        sound = sound_chain(self.session.instrument, self.session.marks)
        if all(c.stage == "tissue" for c in active):
            return line
        height = self.session.recorded("apex_height", group, smoothed=True)  # which a gauge may read, too
        known = (wanted[0], *height)
        if needed(chain, wanted[1:], known) == needed(sound, wanted[1:], known):
            return line
        partial = replace(chain, operators=needed(chain, wanted, height))
        time, pressure = line

        def corrected() -> Table:
            made = simulate(partial, group.tables(), dict.fromkeys(wanted, time), height)
            return time, pressure + (made["line_pressure"] - made["pressure"])

        lines: Table = self._before.get((group.specimen, id(time), partial), corrected)
        return lines


class FedBlock(Block):
    """A block whose chain is fed the recorded pressure; commands are placed on the record's clock."""

    def __init__(
        self,
        session: GroupedSession,
        library: Mapping[str, Effect],
        pressure: PressureBlock | None,
        without: Sequence[str],
    ) -> None:
        super().__init__(session, library, without)
        self._pressure = pressure
        self._fed = FedPressure(session, pressure)
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

    def tables(self, group: Group) -> dict[str, Table]:
        """The commands by the record's clock: a zero that is taken milliseconds off is off by as many micrometres."""
        if self._pressure is None:
            return group.tables()
        return {q: (t - self._pressure.early(t), value) for q, (t, value) in group.tables().items()}

    def kinks(self, group: Group) -> FloatArray:
        kinks = super().kinks(group)
        return kinks if self._pressure is None else kinks - self._pressure.early(kinks)
