"""The nominal chain of a suction instrument, and the pressure that it makes in its line."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from gap.null.blocks import AFTER_KINK
from gap.null.chains import needed
from gap.null.groups import Group, GroupedSession, Table
from sim_devices.chain import Chain, FloatArray
from sim_devices.stages import nominal
from sim_devices.stages.operators import Map, after
from sim_devices.stages.sampling import simulate
from sim_devices.stages.suction import tissue_operators
from sim_devices.stages.tissues import SuctionTissue, suction_tissue

CLOSE, APART = 0.02, 1.0
"""s between nodes of a line within a recording, and from which on two samples are of two recordings."""
STEP, CLOSER = 6.0, 0.005
"""s for which a step is held to see whether a regulator overshoots, and between looks at it."""
EMPTY = 500.0
"""Pa of suction from which on a line is not vented, usually."""
GAUGE_ZERO = 100.0
"""Pa of a gauge's zero over which a loop is closed, to tell how far a line is vented where the command ends that."""
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
    nodes = np.concatenate([(kinks[:, None] + AFTER_KINK).ravel(), kinks])
    fine = np.unique(np.concatenate([_closer(time), nodes - early(nodes)]))
    fine = fine[(fine >= time[0]) & (fine <= time[-1])]
    partial = replace(chain, operators=needed(chain, ("line_pressure",)))
    return fine, simulate(partial, tables, {"line_pressure": fine + early(fine)})["line_pressure"]


def overshoot(chain: Chain, size: float) -> float:
    """By which share a chain's recorded pressure goes beyond a step of ``size`` Pa and what it settles at."""
    time, rise = np.linspace(0.0, STEP, 1 + round(STEP / CLOSER)), np.array([0.0, CLOSE, CLOSE, STEP])
    partial, flat = replace(chain, operators=needed(chain, ("pressure",), ("apex_height",))), (rise, np.zeros(4))
    command = {"pressure": (rise, np.array([0.0, 0.0, -size, -size]))}
    made = simulate(partial, command, {"pressure": time}, {"apex_height": flat})["pressure"]
    return float(-np.min(made) / max(size, -made[-1]) - 1.0)


def vented(pressure: FloatArray, empty: float = EMPTY) -> FloatArray:
    """How far (n,), 0 to 1, a line at ``pressure`` (n,) Pa is vented: from ``empty`` Pa of suction on it is not."""
    return np.clip(1.0 + pressure / empty, 0.0, 1.0)


def closed_over(chain: Chain, empty: float) -> Chain:
    """The chain with a loop that is closed over a gauge which reads `GAUGE_ZERO` too much: it leaves so much less,
    wholly from ``empty`` Pa of suction on that are asked for."""
    return after(chain, "command_resolution", lambda s, t: Map("closed_over", "command", s, t, _less, (empty,)))


def _less(time: FloatArray, command: FloatArray, empty: float) -> FloatArray:
    return command - GAUGE_ZERO * (1.0 - vented(command, empty))


def unasked(made: FloatArray, closed: FloatArray) -> FloatArray:
    """How far (n,), 0 to 1 in the end, a regulator answers to no suction being asked for: of the pressures (n,) Pa that
    it ``made``, and made `closed_over` a gauge's zero."""
    return 1.0 - (made - closed) / GAUGE_ZERO


def _closer(time: FloatArray) -> FloatArray:
    """Times (m,) s among which are ``time`` (n,) s, no farther apart than `CLOSE` within a recording: between samples
    that are rare a pressure bends by more than its noise."""
    parts = np.where(np.diff(time) < APART, np.ceil(np.diff(time) / CLOSE), 1.0).astype(int)
    begin, step = np.repeat(time[:-1], parts), np.repeat(np.diff(time) / parts, parts)
    which = np.arange(len(begin)) - np.repeat(np.cumsum(parts) - parts, parts)
    return np.append(begin + which * step, time[-1:])
