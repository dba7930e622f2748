"""The engine's links: opened on demand, watched, and opened anew where one is lost while no run is on."""

from __future__ import annotations

import abc
import logging
import math
import time
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import CancelledError
from typing import TypeVar

from acquire.engine.absence import Absence
from acquire.engine.link import LinkThread
from acquire.engine.links import Links
from acquire.engine.loop import ControlLoop
from acquire.engine.rules import Rules, Trip
from acquire.engine.state import State, StateMachine, WrongState
from acquire.supervisor import Heartbeat
from drivers.device import DeviceError, Faulted, Identity, LinkLost, Rig, Status
from drivers.signals import Block, Channel, Frame

log = logging.getLogger(__name__)
T = TypeVar("T")

SETTLE = 0.25  # s of device time that must have been heard before arming: a tare is made of it
CONNECT = 15.0  # s of wall time within which a link must be open


class Connection(ControlLoop):
    """A control loop with the links of one rig. The engine decides on their use."""

    def __init__(self, rig: Rig, machine: StateMachine, rules: Rules, heartbeat: Heartbeat | None) -> None:
        super().__init__(rig.device.name, machine, rules, heartbeat)
        self.rig = rig
        self.identities: dict[str, Identity] = {}
        self._links = Links(rig, self, heartbeat.permissions if heartbeat is not None else None)
        self._lost: deque[str] = deque()  # links that went away where nothing was live
        self._absence: Absence | None = None

    @property
    def state(self) -> State:
        """The present state."""
        return self._machine.state

    @property
    def channels(self) -> tuple[Channel, ...]:
        """The channels of the device and its further sources."""
        return tuple(c for source in (self.rig.device, *self.rig.sources) for c in source.channels)

    @property
    def status(self) -> Status | None:
        """The device's last status."""
        return self._links.status

    @property
    def found(self) -> str:
        """The state that an earlier host left behind and `connect` made safe, in words; '' where all was well."""
        return self._links.found

    @property
    def away(self) -> str:
        """Why no link is open although one was, and when it is tried again, in words; '' where nothing is missing."""
        absence = self._absence
        return absence.words if absence is not None else ""

    def connect(self, *, acknowledged: bool = False) -> None:
        """Open every link and make an earlier host's instrument safe (`found` tells its state).

        Raises DeviceError; the state is then ``failed``. A fault that the device latched is such an error, unless a
        person has ``acknowledged`` it.
        """
        self._do(lambda: self._connect(acknowledged))

    def make_safe(self) -> None:
        """Vent and stop where no run is on, and wait until the device says so. Raises WrongState, DeviceError."""
        self._do(self._confirm_safe)

    def disconnect(self) -> None:
        """Close the links."""
        self._do(self._disconnect)

    # Called by the links' threads -------------------------------------------------------------------------------------

    @abc.abstractmethod
    def receive(self, link: LinkThread, items: Sequence[Block | Frame]) -> None:
        """Take new data."""

    @abc.abstractmethod
    def behind(self) -> bool:
        """Whether links are to be read more slowly."""

    def lost(self, link: LinkThread, error: Exception) -> None:
        """A link failed: a trip where a person may be attached, else something to try again."""
        name, text = link.source.name, str(error)
        text = text if name in text else f"{name}: {text}"  # a transport knows its address alone
        log.warning("%s", text)
        if self._machine.can("lose"):
            self._lost.append(text)
            self._wake.set()
        else:
            self._interlock.fire(Trip("link", text, link.status.time if link.status else math.nan))

    # In the loop's thread ---------------------------------------------------------------------------------------------

    @abc.abstractmethod
    def _end(self, event: str, reason: str) -> None:
        """Leave whatever is going on, safely."""

    def _look_for_links(self) -> None:
        """Where nothing is live: close an instrument that lost a link, and try it again when that is due."""
        if self._lost and self._machine.can("lose"):
            self._absence = Absence(self._lost[0])
            self._links.close()
            self._machine.fire("lose")
        self._lost.clear()
        if self._absence is not None and self.state is State.IDLE and time.monotonic() >= self._absence.due:
            self._try_again(self._absence)

    def _try_again(self, absence: Absence) -> None:
        before = dict(self.identities)
        self._machine.fire("connect")
        try:
            self._open_links(acknowledged=False)
        except CancelledError:
            self._links.close()
            raise
        except (DeviceError, OSError) as error:
            self._links.close()
            if isinstance(error, Faulted):
                self._end("fail", str(error))
            else:
                absence.failed(str(error))
                self._machine.fire("abort")
            return
        if self.identities != before:
            self._end("fail", f"another instrument answers than before the link was lost: {self.identities}")
            return
        log.warning("%s: the link is back after %.1f s", self._name, time.monotonic() - absence.since)
        self._absence = None
        self._machine.fire("connected")

    def _connect(self, acknowledged: bool) -> None:
        if self.state is State.READY:
            return  # a lost link has come back meanwhile
        self._machine.fire("connect")
        self._absence = None
        try:
            self._open_links(acknowledged=acknowledged)
        except CancelledError:
            self._links.close()
            raise
        except Exception as error:
            self._end("fail", str(error))
            self._links.close()
            if isinstance(error, DeviceError):
                raise
            raise LinkLost(f"{self._name}: {error}") from error
        self._machine.fire("connected")

    def _open_links(self, *, acknowledged: bool) -> None:
        for name, identity in self._links.open(acknowledged=acknowledged).items():
            self.identities[name] = self._await(identity, CONNECT)

    def _confirm_safe(self) -> None:
        if not self._machine.can("disconnect"):
            raise WrongState(f"cannot make safe while {self.state}")
        self._ask(self.rig.device.make_safe)
        self._wait_until(lambda: self.status is not None and self.status.state == "safe", "say that it is safe")

    def _disconnect(self) -> None:
        if self._absence is None or self.state is not State.IDLE:
            self._machine.fire("disconnect")
        self._absence = None
        self._links.close()

    def _ask(self, action: Callable[[], T], link: LinkThread | None = None) -> T:
        """Have ``action`` carried out by a link's thread (the device's by default), beating meanwhile."""
        return self._await((link or self._links.device).ask(action))

    def _wait_for_data(self) -> None:
        """Wait until the device has been heard for long enough, and every link once more: a silent one is found now."""
        device = self._links.device
        before = [(link, link.latest) for link in self._links]
        self._wait_until(lambda: device.latest - device.first >= SETTLE, "deliver samples")
        self._wait_until(lambda: all(link.latest > then for link, then in before), "deliver data on every link")

    def _ended(self) -> None:
        self._absence = None
        self._links.close()

    def _tripped(self, trip: Trip) -> None:
        """The interlock tripped, in whatever thread: stop first, think later."""
        self._links.make_safe()
        self._wake.set()
