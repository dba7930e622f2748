"""The back door of a simulated instrument: its true state, and faults to inject. For tests, not for hosts."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass

from sim_devices.servers.faults import SENSOR, STALE, Distortion
from sim_devices.servers.instrument import SimInstrument


@dataclass(frozen=True)
class Truth:
    """The true state of the instrument, whatever the link says.

    ``signals`` are the chain's signals at the last moment computed (``line_pressure`` in Pa, ``axis_1`` in m …);
    ``vented`` when nothing is commanded, nothing moves and the skin is free. ``limits`` are those it was armed with.
    """

    time: float
    state: str
    fault: str
    executed: int
    command: Mapping[str, float]
    limits: Mapping[str, tuple[float, float]]
    signals: Mapping[str, float]
    vented: bool
    streaming: bool


class BackDoor:
    """Thread-safe access to one `SimInstrument`."""

    def __init__(self, sim: SimInstrument) -> None:
        self._sim = sim

    def truth(self) -> Truth:
        """The true state, now. Raises RuntimeError when the simulation itself has failed."""
        sim = self._sim
        if sim.error is not None:
            raise RuntimeError(f"the simulated {sim.bench.instrument.name} has failed: {sim.error!r}") from sim.error
        with sim.lock:
            firmware = sim.firmware
            return Truth(
                time=sim.time,
                state=firmware.state,
                fault=firmware.fault,
                executed=firmware.executed,
                command=firmware.command,
                limits={name: (r.low, r.high) for name, r in firmware.limits.items()},
                signals=dict(sim.signals),
                vented=firmware.resting and sim.still,
                streaming=any(port.streaming for port in sim.ports),
            )

    def wait_vented(self, timeout: float = 3.0) -> Truth:
        """The first truth that is vented and still. Raises TimeoutError after ``timeout`` s of wall time."""
        deadline = time.monotonic() + timeout
        while not (truth := self.truth()).vented:
            if time.monotonic() > deadline:
                raise TimeoutError(f"not vented and still after {timeout:g} s: {truth}")
            time.sleep(0.005)
        return truth

    def wait_stopped(self, timeout: float = 5.0) -> float:
        """When the device was first seen not to act: neither armed nor running nor held (monotonic s of this computer).

        Raises TimeoutError after ``timeout`` s of wall time.
        """
        deadline = time.monotonic() + timeout
        while self._sim.firmware.state in ("armed", "running", "held"):
            if time.monotonic() > deadline:
                raise TimeoutError(f"still {self._sim.firmware.state} after {timeout:g} s")
            time.sleep(0.001)
        return time.monotonic()

    def unplug(self) -> None:
        """Pull every cable."""
        with self._sim.lock:
            for port in self._sim.ports:
                port.link.unplug()
                port.reset()

    def plug(self) -> None:
        """Put the cables back. A pseudo-terminal may have another address then."""
        with self._sim.lock:
            for port in self._sim.ports:
                port.link.plug()

    def reboot(self) -> None:
        """Restart the firmware while the cable stays in."""
        with self._sim.lock:
            self._sim.reboot()

    def stall(self, seconds: float) -> None:
        """No byte either way for ``seconds`` of wall time."""
        with self._sim.lock:
            for port in self._sim.ports:
                port.faults.stall_until = time.monotonic() + seconds

    def garbage(self, count: int) -> None:
        """``count`` random bytes before the next message."""
        with self._sim.lock:
            for port in self._sim.ports:
                port.faults.garbage = count

    def corrupt(self, messages: int) -> None:
        """One byte changed in each of the next ``messages``."""
        self._on_the_wire("corrupt", messages)

    def truncate(self, messages: int) -> None:
        """The second half of each of the next ``messages`` lost."""
        self._on_the_wire("truncate", messages)

    def drop(self, messages: int) -> None:
        """The next ``messages`` lost."""
        self._on_the_wire("drop", messages)

    def repeat(self, messages: int) -> None:
        """Each of the next ``messages`` sent twice."""
        self._on_the_wire("repeat", messages)

    def swap(self, messages: int) -> None:
        """Each of the next ``messages`` sent after the one that follows it."""
        self._on_the_wire("swap", messages)

    def stale(self, what: str = "packet") -> None:
        """From now on the device says the same for ever, although the link works and it obeys.

        ``packet``: the last packet again and again, byte for byte; ``time`` or ``sequence``: only that stands still;
        empty: over. Raises ValueError for anything else.
        """
        if what not in ("", *STALE):
            raise ValueError(f"no stale {what!r}; there is {', '.join(STALE)}")
        with self._sim.lock:
            for port in self._sim.ports:
                port.faults.stale = what

    def starve(self) -> None:
        """The device loses its queue, and the running segment is its last."""
        with self._sim.lock:
            self._sim.firmware.starve()

    def distort(self, channel: str, kind: str, amount: float = 0.0, samples: float = math.inf) -> None:
        """The next ``samples`` of a raw channel are wrong: `sim_devices.servers.faults.SENSOR` lists the kinds.

        Raises ValueError for a channel it does not have, or an unknown kind.
        """
        if channel not in self._sim.bench.raw:
            raise ValueError(f"no raw channel {channel!r}; there are {', '.join(self._sim.bench.raw)}")
        if kind not in SENSOR:
            raise ValueError(f"no sensor fails as {kind!r}; there is {', '.join(SENSOR)}")
        with self._sim.lock:
            self._sim.faults.sensors[channel] = Distortion(kind, amount, samples)

    def heal(self) -> None:
        """Every fault is over, but for unplugged links."""
        with self._sim.lock:
            for port in self._sim.ports:
                port.faults.clear()

    def short_reads(self, size: int) -> None:
        """At most ``size`` bytes at once on the control link; 0 lifts it."""
        with self._sim.lock:
            self._sim.faults.short = size

    def nan(self, channel: str, samples: float = math.inf) -> None:
        """The next ``samples`` of a raw channel are not numbers. Raises ValueError for a channel it does not have."""
        self.distort(channel, "nan", samples=samples)

    def _on_the_wire(self, fault: str, messages: int) -> None:
        with self._sim.lock:
            for port in self._sim.ports:
                setattr(port.faults, fault, messages)
