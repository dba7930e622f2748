"""Readings that are wrong: not finite, spiking, stuck, frozen, scaled, offset, drifting, of the other sign."""

from __future__ import annotations

import time
from collections.abc import Iterator

from acquire.engine import State
from benchmarks.faults.rig import Rig, Stillness
from benchmarks.faults.table import Campaign, Row

FULL = 100
#: Two control cycles (20 ms each), the answer of the device, and the block of samples that carries the reading.
TWO_CYCLES = 0.04 + 0.06
TRACKING = 3.0  # s that a deviation from the set-point may last: a regulator needs its time
FROZEN = 2.0  # s in which a frozen value might be noticed
HOLD = "pressure is held at -200 mbar"
#: Group -> kinds with their amounts (Pa; a factor), the limit in s, and why some are not noticed at once.
GROUPS: tuple[tuple[str, tuple[tuple[str, float], ...], float, str], ...] = (
    ("NaN, Inf", (("nan", 0.0), ("inf", 0.0)), TWO_CYCLES, ""),
    ("stuck beyond a limit, offset beyond a limit", (("stuck", 30e3), ("offset", -60e3)), TWO_CYCLES, ""),
    (
        "stuck, scaled, offset, sign-swapped within the limits",
        (("stuck", 0.0), ("scale", 0.3), ("offset", 15e3), ("sign", 1.0)),
        TRACKING + 1.0,
        "one gauge cannot tell its own error from a regulator's lag: a deviation above 100 mbar trips after 3 s of "
        "tracking; a smaller one is not seen without a second gauge",
    ),
    ("drifting by 60 mbar/s", (("drift", 6e3),), TRACKING + 3.0, "a drift trips 3 s after it has reached 100 mbar"),
)


def rows(campaign: Campaign) -> Iterator[Row]:
    """A row a group, on the Cutometer's pressure; and spikes, which must not trip."""
    with Rig("cutometer", seed=campaign.seed) as rig:
        for name, kinds, limit, exception in GROUPS:
            row = Row(f"reading: {name}", f"trips in time ({HOLD})", "s to the safe command", limit, exception)
            for number in range(campaign.count(FULL)):
                _trial(row, rig, *kinds[number % len(kinds)])
            yield row
        yield _frozen(campaign, rig)
        row = Row("reading: one sample spikes", "one sample alone does not trip; it is recorded")
        for number in range(campaign.count(FULL)):
            _spike(row, rig, -60e3 if number % 2 else 60e3)
        yield row


def _trial(row: Row, rig: Rig, kind: str, amount: float) -> None:
    engine = rig.begin()
    time.sleep(0.4)  # held, no longer settling
    still = Stillness()
    began = time.monotonic()
    rig.call("distort", channel="pressure", kind=kind, amount=amount)
    stopped, problem = rig.stopped(row.limit + 3)
    waited = still.close()
    outcome = rig.over(engine)
    if not problem and outcome.status is not State.TRIPPED:
        problem = f"ended {outcome.status}: {outcome.reason}"
    row.trial(max(0.0, stopped - began - waited), problem and f"{kind} {amount:g}: {problem}")


def _frozen(campaign: Campaign, rig: Rig) -> Row:
    """A value that stands still while nothing is to move: only noise that is missing could tell."""
    row = Row("reading: frozen in a hold", f"trips within {FROZEN:g} s, or is an exception", "s to the safe command")
    unseen = 0
    for _ in range(campaign.count(FULL)):
        engine = rig.begin()
        time.sleep(0.4)
        began = time.monotonic()
        rig.call("distort", channel="pressure", kind="frozen")
        stopped, problem = rig.stopped(FROZEN)
        engine.abort("enough")
        rig.over(engine)
        unseen += bool(problem)
        row.trial(None if problem else stopped - began)
    row.exception = (
        f"{unseen} of {row.trials} were not seen: in a hold the frozen value is a right one; it shows "
        "as soon as the set-point moves, and the limit of time under suction ends the run in any case"
    )
    return row


def _spike(row: Row, rig: Rig, amount: float) -> None:
    engine = rig.begin()
    rig.call("distort", channel="pressure", kind="spike", amount=amount, samples=1)
    time.sleep(0.5)
    state = engine.state
    engine.abort("enough")
    outcome = rig.over(engine)
    seen = False
    if outcome.recording is not None:
        from acquire.recording import open_recording

        value = open_recording(outcome.recording).streams["pressure"].value
        seen = bool((abs(value) > 55e3).any() if amount < 0 else (value > 20e3).any())
    problem = f"ended {state}: {outcome.reason}" if state is not State.RUNNING else "" if seen else "not recorded"
    row.trial(problem=problem)
