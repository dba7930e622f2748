"""One open instrument of a session: its engine, its heartbeat's keeper and, where it is simulated here, its server."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from acquire import latches
from acquire.engine import RunEngine, State
from acquire.plugins import instrument as descriptor
from acquire.simulation import Mounted
from acquire.station import Instrument
from acquire.supervisor import Supervisor

if TYPE_CHECKING:
    from sim_devices.servers import Server


class Bench:
    """Not connected at first. An emergency stop of a real instrument is kept beyond this program (see `latches`)."""

    def __init__(
        self,
        name: str,
        kind: str,
        entry: Instrument,
        set_up: Mounted,
        *,
        speed: float = 1.0,
        frame_size: tuple[int, int] = (640, 480),
        watched: Sequence[str] = (),
        listener: Callable[[str, State, str], None] | None = None,
    ) -> None:
        """Raises ValueError (plugin, options, simulated kinds), NotAllowed."""
        self.set_up = set_up
        self.server: Server | None = None
        self._name = name
        self._listener = listener
        # A simulated one has nobody at it.
        self._latched_at = "" if entry.simulated is not None else entry.address
        if entry.here:
            from acquire import simulation

            self.server = simulation.start(kind, entry, speed=speed, mounted=set_up, frame_size=frame_size)
            rig = self.server.open_rig()
        else:
            rig = descriptor(kind).open_rig(entry.entry(kind))
        self.supervisor = Supervisor(("engine", *watched))
        self.engine = RunEngine(rig, rules=entry.rules, heartbeat=self.supervisor, listener=self._changed)

    def connect(self, *, acknowledged: bool) -> None:
        """Open the links; ``acknowledged`` by a person is then whatever was latched. Raises DeviceError."""
        if self._latched_at and not acknowledged:
            latches.check(self._name, self._latched_at)
        self.engine.connect(acknowledged=acknowledged)
        if self._latched_at:
            latches.acknowledge(self._latched_at)

    def close(self) -> None:
        """Make safe, close the links, end everything. Idempotent."""
        self.engine.close()
        self.supervisor.close()
        if self.server is not None:
            self.server.close()

    def _changed(self, state: State, event: str) -> None:
        """The engine's state has changed; called in its thread."""
        trip = self.engine.trip
        if self._latched_at and event == "trip" and trip is not None and trip.code == "estop":
            latches.latch(self._latched_at, trip.message)
        elif self._latched_at and event == "reset":
            latches.acknowledge(self._latched_at)
        if self._listener is not None:
            self._listener(self._name, state, event)
