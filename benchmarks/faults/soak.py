"""A long run at full rate while benign faults go on: every gap is told in the file, memory does not grow."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from acquire.engine import State
from acquire.recording import Recording, open_recording
from benchmarks.faults.rig import Rig
from benchmarks.faults.table import Campaign, Part, Row
from protocols import load

HOUR, SHORTEST = 3600.0, 60.0  # s of the instrument's time; the length grows with the square of the share
SPEED = (
    10.0  # of the instrument's time: its rates are those of its own clock, so that an hour's samples pass in minutes
)
EVERY = 1.0  # s of the instrument's time between two faults
UNTIL = 5.0  # s of the instrument's time before the end without any: an end that is not heard is a trip, rightly
GROWTH = 0.05  # of the memory after a fifth of the run, at its end
PATIENT = 1.0  # s of watchdog: a busy computer is not what is tried here
BENIGN = ("garbage", "corrupt", "truncate", "drop", "repeat", "swap")


def rows(campaign: Campaign) -> Iterator[Row]:
    """Two rows: gaps, and memory."""
    seconds = max(SHORTEST, HOUR * campaign.share**2)
    must = f"completes, no gap that no event tells ({seconds:.0f} s of samples, {SPEED:g} times as fast)"
    gaps = Row("soak: benign faults every second at full rate", must, "samples in untold gaps", 0.0)
    memory = Row("soak: memory of the host", "grows by less than 5 %", "% of growth", 100 * GROWTH)
    # Most of what is allocated once is allocated in the first minutes.
    memory.exception = "" if seconds >= HOUR / 4 else f"{seconds:.0f} s are too short to judge: told, not judged"
    with Rig("cutometer", seed=campaign.seed, watchdog=PATIENT, speed=SPEED) as rig:
        cycles = int(seconds / 3) + 1
        steps = "[{type: hold, suction: 200 mbar, duration: 2 s}, {type: wait, duration: 1 s}]"
        group = f"- {{type: group, repeat: {cycles}, steps: {steps}}}\n"
        text = f"schema: protocol/1\nname: soak\ninstrument: cutometer\nsteps:\n{group}"
        engine, plan = rig.session.prepare(load(text))
        engine.arm(plan)
        engine.start()
        random, began, start = campaign.random("soak"), time.monotonic(), float("nan")
        while engine.state is State.RUNNING:
            fault = BENIGN[int(random.integers(len(BENIGN)))]
            if time.monotonic() - began < (3 * cycles - UNTIL) / SPEED:
                rig.call(fault, **{"count" if fault == "garbage" else "messages": 1 + int(random.integers(3))})
            time.sleep(EVERY / SPEED)
            if start != start and time.monotonic() - began > seconds / SPEED / 5:
                start = _memory()
        end = _memory()
        outcome = rig.over(engine)
        problem = "" if outcome.status is State.COMPLETED else f"ended {outcome.status}: {outcome.reason}"
        untold = _untold(open_recording(outcome.recording)) if outcome.recording else float("inf")
    gaps.trial(untold, problem)
    growth = 100 * (end / start - 1)
    memory.trial(growth if not memory.exception else min(growth, 100 * GROWTH))
    yield gaps
    yield memory


def _memory() -> float:
    """Memory that this process holds, MB."""
    return int(Path("/proc/self/status").read_text().split("VmRSS:")[1].split()[0]) / 1024


def _untold(recording: Recording) -> float:
    """Samples that are missing by their numbers, less those that events count."""
    seq = recording.streams["pressure"].seq
    assert seq is not None
    missing = int((np.diff(seq) - 1).sum())
    told = sum(event.count for event in recording.events if event.code == "lost")
    return float(max(0, missing - told))


CLOCKED = True
PARTS: dict[str, Part] = {"hour": rows}
