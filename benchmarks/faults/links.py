"""Faults of links and of the device behind them: pulled, rebooted, stalled, stale, out of set-points."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

from acquire.engine import State
from acquire.recording import open_recording
from benchmarks.faults.rig import AFTER_WATCHDOG, BY_HOST, KINDS, WATCHDOG, Rig, Stillness
from benchmarks.faults.table import Campaign, Part, Row

FULL = 105
SEGMENT = 1.0  # s, of the hold's pieces: a queue that is lost lets the running one end


@dataclass(frozen=True)
class Fault:
    """A call of the back door, and the codes of trips that name it."""

    name: str
    method: str
    codes: tuple[str, ...]
    arguments: tuple[tuple[str, Any], ...] = ()


#: Faults that must be answered within the same time (s), over the three instruments in turn.
GROUPS: dict[str, tuple[float, tuple[Fault, ...]]] = {
    "pulled": (
        WATCHDOG + AFTER_WATCHDOG,
        (
            Fault("cable pulled", "unplug", ("link", "stale")),
            Fault("controller stalls", "stall", ("stale", "device", "link"), (("seconds", 1.5),)),
        ),
    ),
    "stale": (
        BY_HOST,
        (
            Fault("device rebooted", "reboot", ("device", "link", "stale", "clock")),
            *(
                Fault(f"stale {what}", "stale", ("stale", "clock"), (("what", what),))
                for what in ("packet", "time", "sequence")
            ),
        ),
    ),
    "starved": (SEGMENT + WATCHDOG + AFTER_WATCHDOG, (Fault("empty queue", "starve", ("device",)),)),
}
MUST = "safe command in time, latched, the file opens, the trip names the link"


def rows(group: str, campaign: Campaign) -> Iterator[Row]:
    """The row of one group."""
    limit, faults = GROUPS[group]
    row = Row(", ".join(fault.name for fault in faults), MUST, "s to the safe command", limit)
    rigs: dict[str, Rig] = {}
    try:
        for number in range(campaign.count(FULL)):
            kind = KINDS[number % len(KINDS)]
            if kind not in rigs:
                rigs[kind] = Rig(kind, seed=campaign.seed)
            # Each instrument meets each fault: 1, 2 and 4 faults, 3 instruments.
            _trial(row, rigs[kind], faults[(number + number // len(KINDS)) % len(faults)])
    finally:
        for rig in rigs.values():
            rig.__exit__()
    yield row


def _trial(row: Row, rig: Rig, fault: Fault) -> None:
    engine = rig.begin()
    still = Stillness()
    began = time.monotonic()
    rig.call(fault.method, **dict(fault.arguments))
    moment, problem = rig.stopped(row.limit + 5)
    waited = still.close()
    rig.ended(engine)
    rig.call("heal")
    rig.call("plug")
    latched = engine.state is State.TRIPPED  # whatever is well again
    outcome = rig.over(engine)
    trip = outcome.trip
    if problem:
        pass
    elif outcome.status is not State.TRIPPED or trip is None:
        problem = f"ended {outcome.status}: {outcome.reason}"
    elif not latched:
        problem = "the trip did not latch"
    elif not any(source.name in trip.message for source in (engine.rig.device, *engine.rig.sources)):
        problem = f"the trip names no link: {trip.message}"
    elif trip.code not in fault.codes:
        problem = f"tripped by {trip.code} ({trip.message})"
    elif outcome.recording is None or open_recording(outcome.recording).info.status != "tripped":
        problem = "no recording of the trip"
    # For as long as this computer keeps everybody waiting, nobody can act: a trial is judged by the time that was its.
    row.trial(max(0.0, moment - began - waited), problem and f"{rig.kind}, {fault.name}: {problem}")


CLOCKED = True
PARTS: dict[str, Part] = {group: partial(rows, group) for group in GROUPS}
