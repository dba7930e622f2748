"""One thread per link, which alone talks to it: everybody else asks that thread."""

from __future__ import annotations

import logging
import math
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from typing import Any, Protocol, TypeVar

import numpy as np

from acquire.engine.requests import Requests
from drivers.device import Device, Faulted, LinkLost, Source, Status
from drivers.signals import Block, Frame

log = logging.getLogger(__name__)
T = TypeVar("T")

READ_TIMEOUT = 0.02  # s of wall time: how long a read may keep a command, or a stop, waiting
THROTTLE = 0.005  # s of wall time between looks while the receiver is behind


class Receiver(Protocol):
    """The receiver of a link's data. Called in the link's thread."""

    def receive(self, link: LinkThread, items: Sequence[Block | Frame]) -> None:
        """Take new data. Must be quick."""

    def behind(self) -> bool:
        """Whether to read more slowly: a simulated instrument then waits, a real one fills its buffers first."""

    def lost(self, link: LinkThread, error: Exception) -> None:
        """The link failed."""


class LinkThread(threading.Thread):
    """Owns one `Source` (or `Device`): opens it, reads it, carries out requests of other threads, makes it safe.

    A request to make safe overtakes everything that is queued.
    """

    def __init__(self, source: Source, receiver: Receiver, beat: Callable[[], int] | None = None) -> None:
        """``beat()`` counts the supervisor's permissions so far; the device gets one beat for each new one."""
        super().__init__(name=f"link-{source.name}", daemon=True)
        self.source = source
        self.status: Status | None = None
        self.first = math.inf  # device time in s of the first data after connecting
        self.latest = -math.inf  # device time in s of the newest data
        self.error: Exception | None = None
        self.found = ""  # the state of an earlier host that `connect` made safe, in words
        self._receiver = receiver
        self._beat = beat if isinstance(source, Device) else None
        self._beaten = 0
        self._wake = threading.Event()
        self._requests = Requests(self._wake)
        self._urgent = threading.Event()
        self._safe = threading.Event()
        self._confirmed = False  # the device's answer to the last `make_safe` over an open link
        self._streaming = False
        self._closing = False

    # Called by others -------------------------------------------------------------------------------------------------

    def ask(self, action: Callable[[], T]) -> Future[T]:
        """Have ``action`` carried out by this thread, after earlier requests."""
        if self._closing:
            future: Future[T] = Future()
            future.set_exception(LinkLost(f"{self.source.name}: the link is closed"))
            return future
        return self._requests.ask(action)

    def make_safe(self) -> None:
        """Make the source safe as soon as the thread is out of the driver; does not wait (see `wait_safe`)."""
        self._safe.clear()
        self._urgent.set()
        self._wake.set()

    def wait_safe(self, timeout: float) -> bool:
        """Whether the device confirmed the last `make_safe` within ``timeout`` s; a source that drives nothing need
        not."""
        return self._safe.wait(timeout) and (self._confirmed or not isinstance(self.source, Device))

    def connect(self, *, acknowledged: bool = False) -> Future[Any]:
        """Open the link, make an earlier host's instrument safe; the result is the instrument's `Identity`.

        Raises Faulted where the device latched a fault of its own, unless a person has ``acknowledged`` it.
        """
        return self.ask(lambda: self._connect(acknowledged))

    def stop(self) -> None:
        """Make safe, close the link and end the thread."""
        self._closing = True
        self.make_safe()

    # In this thread ---------------------------------------------------------------------------------------------------

    def run(self) -> None:
        """Serve until stopped."""
        while not self._closing:
            self._turn()
        self._make_safe()
        self.source.close()
        self._requests.refuse(LinkLost(f"{self.source.name}: the link is closed"))

    def _turn(self) -> None:
        self._wake.clear()
        if self._urgent.is_set():
            self._make_safe()
        for action, future in self._requests.take():
            self._carry_out(action, future)
            if self._urgent.is_set():
                break
        if not self._streaming:
            self._wake.wait(READ_TIMEOUT)
            return
        if self._receiver.behind():
            self._wake.wait(THROTTLE)
        try:
            self._pass_beat()
            if not self._receiver.behind():
                items = self.source.read(READ_TIMEOUT)
                if isinstance(self.source, Device):
                    self.status = self.source.status
                if items:
                    self.latest = max(float(np.max(item.time)) for item in items)
                    self.first = min(self.first, self.latest)
                    self._receiver.receive(self, items)
        except Exception as error:  # whatever it is, this link can no longer be trusted
            self._fail(error)

    def _pass_beat(self) -> None:
        if self._beat is not None and (permitted := self._beat()) != self._beaten:
            self._beaten = permitted
            assert isinstance(self.source, Device)
            self.source.beat()

    def _carry_out(self, action: Callable[[], Any], future: Future[Any]) -> None:
        try:
            result = action()
        except Exception as error:
            future.set_exception(error)
            if isinstance(error, LinkLost):
                self._fail(error)
        else:
            future.set_result(result)

    def _connect(self, acknowledged: bool) -> Any:
        identity = self.source.connect()
        if isinstance(self.source, Device):
            self._settle(self.source, acknowledged)
        self.source.start_stream()
        self.error = None
        self._streaming = True
        return identity

    def _settle(self, device: Device, acknowledged: bool) -> None:
        """See that the device begins safe, whatever it was left in."""
        status = device.status
        self.found = ""
        if status.latched and not acknowledged:
            device.close()  # it has vented by itself, and making it safe would clear a state that a person has to see
            raise Faulted(
                f"{device.name} stopped by itself ({status.fault}): look at the person and the instrument, "
                "then acknowledge it (acquire safe, or Reset in the window)"
            )
        if status.state not in ("idle", "safe"):
            device.make_safe()
            self.found = f"{device.name} was left in {status.words}; it was made safe"
            log.warning("%s", self.found)

    def _make_safe(self) -> None:
        self._urgent.clear()
        # Requests from before the stop are void: a `start` behind it must not undo it.
        self._requests.void()
        try:
            self.source.make_safe()
            self._confirmed |= self.error is None  # a link that was lost is closed by now, and nobody answers
        except Exception as error:
            self._confirmed = False
            log.warning("%s: make_safe: %s", self.source.name, error)
            if self._streaming and not self._closing:
                self._fail(error)
        self._safe.set()

    def _fail(self, error: Exception) -> None:
        if not self._streaming:
            return
        self._streaming = False
        self.error = error
        self._confirmed = False
        self._receiver.lost(self, error)
        try:
            self.source.make_safe()
            self._confirmed = True
        except Exception as second:
            log.warning("%s: make_safe after failure: %s", self.source.name, second)
        self.source.close()
