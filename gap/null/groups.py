"""A session's recordings by the specimen that they were made on.

Those of one specimen are simulated together, rests included, so that slow effects see the session's clock.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from acquire.recording.model import Recording, RunInfo
from gap.data.command import Command
from gap.data.innovations import RowNoise
from gap.data.pauses import continues
from gap.data.session import SKIN, Session
from gap.data.smoothing import significant
from protocols.specimens import SPECIMENS, Stated
from sim_devices.chain import FloatArray

Table = tuple[FloatArray, FloatArray]
"""Times (m,) s and values (m,)."""


@dataclass(frozen=True)
class Group:
    """Recordings of one specimen and the commands over them.

    ``specimen`` tells it from every other group (two gauge steps are two), ``name`` is that of its kind, ``known`` what
    is known of it.
    """

    specimen: str
    members: tuple[int, ...]
    commands: Mapping[str, Command]
    name: str = SKIN
    known: Mapping[str, Stated] = field(default_factory=dict)

    @property
    def skin(self) -> bool:
        return self.name == SKIN

    @property
    def reference(self) -> bool:
        """Whether it is a reference specimen: no law of a person's is in the way."""
        return self.name in SPECIMENS

    def tables(self, held: bool) -> dict[str, Table]:
        """Commands as tables for the simulation, sampled rows ``held`` or straight in between."""
        return {q: c.table(held) for q, c in self.commands.items()}


class GroupedSession(Session):
    """A session whose recordings are grouped by specimen."""

    held = False  # whether sampled rows are held until the next: the actuator's block tells those behind it
    averaged = False  # whether samples are means over a sampling period, which it tells as well
    of_height: RowNoise | None = None  # the noise of the height's sensor, as solid references show it
    of_force: RowNoise | None = None  # the noise of the transducers, as references show it

    def __init__(self, recordings: Sequence[Recording], quantities: Sequence[str]) -> None:
        super().__init__(recordings)
        self.instrument = recordings[0].info.instrument
        labels = [_label(r.info) for r in recordings]
        self.groups = []
        self._recorded: dict[tuple[str, str, bool], dict[str, Table]] = {}
        for label in dict.fromkeys(labels):
            members = tuple(k for k, s in enumerate(labels) if s == label)
            info = recordings[members[0]].info
            commands = {q: self.command(q, members) for q in quantities}
            self.groups.append(Group(label, members, commands, info.specimen or SKIN, info.specimen_properties))
        self.kinks = np.unique(np.concatenate([c.kinks for g in self.groups for c in g.commands.values()]))
        armed = [k for k, r in enumerate(recordings) if not continues(r)]
        self.marks = tuple(map(self.begin, armed))

    def whole(self, quantity: str, without: Sequence[str]) -> Group:
        """All recordings but those of specimens ``without`` as one group, in order, with the command of a quantity."""
        members = tuple(sorted(k for g in self.groups if g.name not in without for k in g.members))
        return Group("all", members, {quantity: self.command(quantity, members)})

    def recorded(self, channel: str, group: Group, *, smoothed: bool = False) -> dict[str, Table]:
        """A channel of a group's recordings as a table, always the same one; nothing where it was not recorded. It is
        ``smoothed`` for a sensor that reads it, too: noise fed into a prediction of itself would explain itself."""
        key = (channel, group.specimen, smoothed)
        if key not in self._recorded:
            series = [(k, s) for k in group.members if (s := self.recordings[k].streams.get(channel)) is not None]
            found = [(self.time(k, s), np.asarray(s.value, dtype=float)) for k, s in series]
            found = [(t[good], v[good]) for t, v in found if np.any(good := np.isfinite(v))]
            values = [significant(t, v) if smoothed else v for t, v in found]
            whole = (np.concatenate([t for t, _ in found]), np.concatenate(values)) if found else None
            self._recorded[key] = {channel: whole} if whole else {}
        return self._recorded[key]

    def onset(self, k: int) -> float:
        """When suction is first commanded in recording ``k``, s; its begin where it never is."""
        asked, (begin, end) = next(g for g in self.groups if k in g.members).commands["pressure"], self.span(k)
        acting = np.flatnonzero((asked.value != 0) & (asked.time >= begin) & (asked.time <= end))
        return float(asked.time[max(acting[0] - 1, 0)]) if len(acting) else begin

    def begins_under_suction(self, k: int) -> bool:
        """Whether recording ``k`` begins under suction: then it does not tell where the height's zero was."""
        asked, begin = self.recordings[k].setpoints["pressure"], self.span(k)[0] - self.shifts[k]
        return bool(np.interp(begin - 1e-9, asked.time, asked.value) != 0)


def _label(info: RunInfo) -> str:
    """The identity of a specimen: its name and, of a reference, its known properties."""
    known = info.specimen_properties if info.specimen in SPECIMENS else {}
    return ", ".join([info.specimen or SKIN, *(f"{key} {stated}" for key, stated in known.items())])
