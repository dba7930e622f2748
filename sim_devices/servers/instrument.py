"""A simulated instrument: one thread that speaks bytes, runs the firmware and advances the physics.

The thread owns everything; a lock lets the back door in between two turns. Each turn it reads commands, watches
the host's heartbeat, advances the chain to the (scaled) clock's time and sends the measured values. When the link does
not take more bytes it stops advancing: time slips instead of samples being lost. Between runs time goes no faster than
real: a stream that nobody records must not take the processor from the one that is being recorded.
"""

from __future__ import annotations

import math
import select
import threading
import time

import numpy as np

from drivers import messages as msg
from drivers.device import Refused
from sim_devices.chain import Chain, Runner
from sim_devices.clock import Clock
from sim_devices.servers.bench import Bench
from sim_devices.servers.faults import Faults
from sim_devices.servers.firmware import Firmware
from sim_devices.servers.links import Link
from sim_devices.servers.ports import CameraPort, ControlPort, Port, Render
from sim_devices.servers.timeline import commanded, grid
from sim_devices.stages import runner
from sim_devices.stages.specimens import SPECIMEN

#: Samples are sent about this often (wall time, s).
BLOCK_WALL = 0.01
#: Longest sleep of the thread (wall time, s): how soon it sees the watchdog and the back door.
LONGEST_SLEEP = 0.02
#: A device that is safe already does not wait for a host that has taken nothing for this long (wall time, s).
PATIENCE = 0.5
#: With time running faster than real, a dry queue stops it for at most this long (wall time, s): the host would have
#: fed a real instrument long before.
FEEDING = 1.0
#: Bytes that may wait while the device goes safe, so that it gets there whatever the host does.
SAFE_DEPTH = 2**24
_ACTIVE = ("armed", "running", "held")


class SimInstrument:
    """An instrument on one control link and, if it has a camera, a frame link; ``start`` it and ``close`` it.

    ``render(height_m, time_s)`` makes the camera's image.
    """

    def __init__(
        self,
        bench: Bench,
        chain: Chain,
        clock: Clock,
        control: Link,
        camera: Link | None = None,
        render: Render | None = None,
    ) -> None:
        self.bench = bench
        self.faults = Faults()
        self.lock = threading.RLock()
        self.error: BaseException | None = None
        self.firmware = self._boot()
        self._chain = chain
        self._runner = runner(chain)
        self._clock = clock
        self._control = ControlPort(control, bench.codec, len(bench.raw), self.faults)
        self._camera = CameraPort(camera, bench.identity, render) if camera and render else None
        self.ports: list[Port] = [self._control, *([self._camera] if self._camera else [])]
        self._ticks = 0  # samples since the chain began: its time, which no reboot changes
        self._booted = 0  # tick at the last boot, where the device's own time begins
        self._dry_since = 0.0  # wall time at which the queue last held something
        self._unloaded = 0  # samples still to come before the probe touches the skin
        self.signals: dict[str, float] = {}
        self.still = True
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"sim-{bench.instrument.name}", daemon=True)

    def start(self) -> None:
        """Switch it on, once everything is compiled: a device answers from its first moment."""
        rest = np.arange(2) / self.bench.rate
        runner(self._chain).advance(rest, {name: np.zeros(2) for name in self.bench.command.values()})
        if self._camera is not None:
            self._camera.prepare()
        self._thread.start()

    def close(self) -> None:
        """Switch it off and release its links. Idempotent."""
        self._stopping.set()
        if self._thread.is_alive():
            self._thread.join()
        for port in self.ports:
            port.link.close()

    def reboot(self) -> None:
        """Start the firmware anew: nothing commanded, no limits, stream off, device time and sample count from 0."""
        self._booted = self._ticks
        self.firmware = self._boot()
        for port in self.ports:
            port.reset()
        self._control.announce(self.bench.identity)

    @property
    def time(self) -> float:
        """Simulated time in s."""
        return self._ticks / self.bench.rate

    def _boot(self) -> Firmware:
        b = self.bench
        return Firmware(b.identity, b.instrument.quantities, b.raw, b.capacity, b.instrument.limits)

    def _run(self) -> None:
        try:
            while not self._stopping.is_set():
                with self.lock:
                    wait = self._turn(time.monotonic())
                    inputs = [f for port in self.ports for f in port.link.filenos()]
                    outputs = [f for port in self.ports if port.backlog for f in port.link.filenos()[-1:]]
                _sleep(inputs, outputs, min(wait, LONGEST_SLEEP))
        except BaseException as error:
            self.error = error
            raise

    def _turn(self, wall: float) -> float:
        """One turn at ``wall`` (monotonic s); for how long (wall s) there is nothing to do after it."""
        if not self.faults.stalled(wall):
            for message in self._control.receive():
                self._obey(message, wall)
            if self._camera:
                self._camera.receive()
        self.firmware.watch_host(wall)
        for port in self.ports:
            port.flush(wall)
        if self._asleep or self._blocked(wall) or self._hungry(wall):
            self._clock.slip(self.time)
            return LONGEST_SLEEP
        self._clock.hurry(self.firmware.state in _ACTIVE or not self.still)
        due = int(self._clock.now() * self.bench.rate) + 1 - self._ticks
        batch = max(1, min(round(self._clock.speed * BLOCK_WALL * self.bench.rate), self.bench.longest))
        if due < batch:
            return self._clock.wall_until((self._ticks + batch - 1) / self.bench.rate)
        if due > 4 * batch:
            self._clock.slip(self.time)
        self._advance(min(batch, self._fed))
        for port in self.ports:
            port.flush(wall)
        return 0.0

    @property
    def _asleep(self) -> bool:
        """Nobody watches and nothing moves: time stands still."""
        return self.firmware.resting and self.still and not any(port.streaming for port in self.ports)

    def _blocked(self, wall: float) -> bool:
        """Whether time must stand still for a host that does not read."""
        if self.firmware.state in _ACTIVE:
            return any(port.backlog > port.depth for port in self.ports)
        for port in self.ports:
            if port.silent(wall) > PATIENCE:
                port.drop()
        return any(port.backlog > SAFE_DEPTH for port in self.ports)

    def _hungry(self, wall: float) -> bool:
        """Whether time must stand still until the host has fed the queue."""
        if self._clock.speed <= 1 or not self.firmware.starved:
            self._dry_since = wall
        return 0 < wall - self._dry_since < FEEDING

    @property
    def _fed(self) -> int:
        """How many samples the queue lasts, at least 1; the longest block while nothing is executed."""
        left = min(self.firmware.horizon - self.firmware.time, self.bench.longest / self.bench.rate)
        return max(1, math.ceil(left * self.bench.rate))

    def _obey(self, message: msg.Message, wall: float) -> None:
        if isinstance(message, msg.Beat):
            self.firmware.beat(message.count, wall)
        elif isinstance(message, msg.Request) and not self._control.outdated(message):
            self._control.reply(self._answer(message, wall))

    def _answer(self, request: msg.Request, wall: float) -> msg.Reply:
        body = request.body
        if isinstance(body, msg.Identify):
            return msg.Reply(request.number, identity=self.firmware.identity)
        again = self._control.answered(request.number)
        if again is not None:
            return again
        try:
            if isinstance(body, msg.Stream):
                self._control.streaming = body.on
                self._unloaded = self.bench.unloaded
            else:
                self.firmware.handle(body, wall)
                if isinstance(body, msg.Arm) and isinstance(self._runner, Runner):
                    for name in (self.bench.zeroing, SPECIMEN):  # the zero is taken, a person slides the step in
                        self._runner.restart(name)
        except Refused as refusal:
            return msg.Reply(request.number, refused=str(refusal))
        # Status goes ahead of the answer, so that a host never acts on the state before its command.
        self._control.status(self.firmware.status)
        return msg.Reply(request.number)

    def _advance(self, count: int) -> None:
        """Take ``count`` samples."""
        bench, first = self.bench, self._ticks
        offset = self._booted / bench.rate
        stamps = np.arange(first, first + count) / bench.rate
        waveform = self.firmware.advance(float(stamps[-1]) - offset).shifted(offset)
        nodes = grid(first, count, bench.rate, bench.substeps, waveform)
        signals = self._runner.advance(
            nodes, {bench.command[q]: values for q, values in commanded(waveform, nodes, self.firmware.quantities)}
        )
        at = np.searchsorted(nodes, stamps - 0.25e-9)
        sampled = {name: values[at] for name, values in signals.items()}
        self._ticks += count
        self.signals = {name: float(values[-1]) for name, values in signals.items()}
        self.still = bench.still(self.signals)
        values = bench.measure(sampled)
        if bench.unload and self._unloaded:
            bench.unload(values[: self._unloaded])
            self._unloaded = max(0, self._unloaded - count)
        self.firmware.watch_values(values)
        self.faults.spoil(values, bench.raw, bench.rate)
        number, times, status = self.faults.stamp(first - self._booted, stamps - offset, self.firmware.status)
        self._control.samples(number, times, values, status)
        if self._camera:
            self._camera.frames(first - self._booted, stamps - offset, sampled[bench.seen])


def _sleep(inputs: list[int], outputs: list[int], wait: float) -> None:
    try:
        select.select(inputs, outputs, [], wait)
    except (OSError, ValueError):
        # The back door unplugged a link just now; the next turn sees it.
        time.sleep(min(wait, 0.001))
