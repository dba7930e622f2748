"""A thread that looks at a session's instruments twice a second: for other terminals, and for who is not looking."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from acquire.engine import Outcome, RunEngine, State, Trip
from acquire.notify import Hook, Notifier
from acquire.status import StatusFile

log = logging.getLogger(__name__)

PERIOD = 0.5  # s of wall time between two looks
#: After how long (s of wall time) without any change it is a stall.
RUNNING, PAUSED, WRITING, AWAY = 10.0, 120.0, 30.0, 60.0


@dataclass
class _Seen:
    """The last state seen of one engine."""

    outcome: Outcome | None = None
    trip: Trip | None = None
    mark: tuple[object, ...] = ()
    since: float = 0.0
    told: bool = False


class Attendant(threading.Thread):
    """``engines()`` are the open ones by name, ``addresses`` where each is ('' for one simulated in this process)."""

    def __init__(
        self,
        station: str,
        engines: Callable[[], Mapping[str, RunEngine]],
        addresses: Mapping[str, str],
        hooks: Sequence[Hook] = (),
    ) -> None:
        super().__init__(name="attendant", daemon=True)
        self._station = station
        self._engines = engines
        self._addresses = addresses
        self._notifier = Notifier(hooks)
        self._file = StatusFile()
        self._seen: dict[str, _Seen] = {}
        self._over = threading.Event()

    def run(self) -> None:
        """Look until closed."""
        while not self._over.wait(PERIOD):
            self.look()

    def look(self) -> None:
        """One look at everything. Never raises: nobody's run depends on it."""
        try:
            engines = self._engines()
            for name, engine in engines.items():
                self._notice(name, engine, self._seen.setdefault(name, _Seen()))
            rows = [self._row(name, engine) for name, engine in engines.items()]
            self._file.write({"station": self._station, "instruments": rows})
        except Exception:
            log.exception("the attendant failed")

    def close(self) -> None:
        """A last look, then end. Call it while the engines can still be asked."""
        self._over.set()
        self.join()
        self.look()
        self._notifier.close()
        self._file.close()

    def _notice(self, name: str, engine: RunEngine, seen: _Seen) -> None:
        trip, outcome = engine.trip, engine.outcome
        if trip is not None and trip is not seen.trip:
            self._tell("trip", name, engine, f"{trip.code}: {trip.message}")
        if outcome is not None and outcome is not seen.outcome:
            self._tell("end", name, engine, outcome.reason, outcome)
        seen.trip, seen.outcome = trip, outcome
        mark, patience, words = _course(engine)
        now = time.monotonic()
        if mark != seen.mark:
            seen.mark, seen.since, seen.told = mark, now, False
        elif patience and now - seen.since > patience and not seen.told:
            seen.told = True
            self._tell("stall", name, engine, words)

    def _tell(self, event: Any, name: str, engine: RunEngine, reason: str, outcome: Outcome | None = None) -> None:
        facts = self._row(name, engine) | {"station": self._station, "reason": reason}
        if outcome is not None:
            facts |= {"state": str(outcome.status), "recording": outcome.recording, "journal": outcome.journal}
        self._notifier.tell(event, facts)

    def _row(self, name: str, engine: RunEngine) -> dict[str, Any]:
        progress, plan, outcome = engine.progress, engine.plan, engine.outcome
        row: dict[str, Any] = {
            "name": name,
            "kind": engine.rig.instrument,
            "address": self._addresses.get(name, ""),
            "state": str(progress.state),
            "device": engine.status.words if engine.status is not None else "",
            "trip": f"{progress.trip.code}: {progress.trip.message}" if progress.trip else "",
            "away": engine.away,
        }
        if plan is None:
            return row
        return row | {
            "run": plan.info.id,
            "protocol": plan.info.protocol_name,
            "segment": progress.segment,
            "segments": progress.segments,
            "phase": progress.phase,
            "elapsed": round(progress.elapsed, 3),
            "duration": round(progress.duration, 3),
            "lost": progress.lost,
            "recording": outcome.recording if outcome is not None else None,
            "journal": plan.path.with_suffix(".journal").absolute() if outcome is None else outcome.journal,
        }


def _course(engine: RunEngine) -> tuple[tuple[object, ...], float, str]:
    """A sign that all goes well, how long (s) it may stay the same (0: for ever), and its name."""
    state = engine.state
    if state is State.RUNNING:
        progress = engine.progress
        return (state, progress.segment, progress.elapsed), RUNNING, f"the run stands still for {RUNNING:g} s"
    if state is State.PAUSED:
        return (state,), PAUSED, f"paused for {PAUSED:g} s"
    if engine.plan is not None and engine.outcome is None:
        return (state,), WRITING, f"{state}, and the recording is not written after {WRITING:g} s"
    if engine.away:
        return (state, "away"), AWAY, engine.away
    return (state,), 0.0, ""
