"""The run engine's view of an instrument: a driven device, maybe a camera, behind one interface each.

Segments are executed by the device from a bounded queue of its own, in device time, as motion controllers and
pressure controllers do: the host's scheduling then never shapes the waveform. The host feeds the queue ahead.
"""

from __future__ import annotations

import abc
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from drivers.signals import Block, Channel, Frame
from protocols.limits import Range
from protocols.setpoints import Segment


class DeviceError(Exception):
    """Base of everything a device or its link can report. The message names device, link and cause."""


class LinkLost(DeviceError):
    """The link is gone: unplugged, closed, or silent past its deadline."""


class ProtocolFault(DeviceError):
    """Bytes arrived that the codec cannot accept, after the resynchronisation it attempts."""


class Faulted(DeviceError):
    """The device latched a fault that a person has to acknowledge: it is vented, and nothing may be armed."""


class Refused(DeviceError):
    """The device understood a command and refused it (outside its limits, wrong state, queue full)."""


@dataclass(frozen=True)
class Identity:
    """Who answered: model, serial number, firmware version."""

    model: str
    serial: str
    firmware: str


#: How faults begin that say no more than that the host fell silent: nobody need look before the next one goes on.
HOST_SILENT, QUEUE_EMPTY = "no heartbeat", "the queue is empty"


@dataclass(frozen=True)
class Status:
    """The device's own view, carried in its sample stream: how far the queue is executed.

    ``time`` is device time in s; ``executed`` counts segments finished since ``start``; ``queued`` counts segments
    still waiting; ``state`` is one of ``idle``, ``armed``, ``running``, ``held``, ``safe``, ``fault``; ``fault`` says
    why. ``began`` is the device time in s at which the running segment (number ``executed``) began, or the last one
    ended; not a number before ``start``. It makes the recorded set-points exact after an ``until`` or a pause.
    """

    time: float
    state: str
    executed: int
    queued: int
    fault: str = ""
    began: float = math.nan

    @property
    def latched(self) -> bool:
        """Whether a fault stands that only a person may acknowledge."""
        return self.state == "fault" and not self.fault.startswith((HOST_SILENT, QUEUE_EMPTY))

    @property
    def words(self) -> str:
        """State and fault."""
        return f"{self.state}: {self.fault}" if self.fault else self.state


class Source(abc.ABC):
    """One link that delivers data. All methods are called by the one thread that owns the link."""

    name: str

    @property
    @abc.abstractmethod
    def channels(self) -> tuple[Channel, ...]:
        """Channels this source delivers (empty for a camera, whose data are frames)."""

    @property
    def discarded(self) -> int:
        """Bytes dropped since `connect` because they made no valid message (wrong checksum, cut short)."""
        return 0

    @abc.abstractmethod
    def connect(self) -> Identity:
        """Open the link and ask who is there. Raises LinkLost, ProtocolFault."""

    @abc.abstractmethod
    def start_stream(self) -> None:
        """Ask for samples (or frames)."""

    @abc.abstractmethod
    def read(self, timeout: float) -> Sequence[Block | Frame]:
        """Messages that arrived within ``timeout`` s of wall time, maybe nothing. Raises LinkLost, ProtocolFault."""

    @abc.abstractmethod
    def make_safe(self) -> None:
        """Leave the patient safe: vent, stop motion, forget the queue. Idempotent; tries even on a broken link."""

    @abc.abstractmethod
    def close(self) -> None:
        """Close the link. Idempotent, never raises."""


class Device(Source):
    """A source that also moves or sucks."""

    @property
    @abc.abstractmethod
    def quantities(self) -> tuple[str, ...]:
        """Commanded quantities: ``("pressure",)`` or ``("probe_x", "probe_y", "probe_z")``."""

    @property
    @abc.abstractmethod
    def status(self) -> Status:
        """The last status that the stream carried."""

    @property
    @abc.abstractmethod
    def queue_capacity(self) -> int:
        """How many segments the device's queue holds."""

    @abc.abstractmethod
    def arm(self, limits: Mapping[str, Range]) -> None:
        """Hand the limits (SI, per channel or quantity) to the firmware, zero or tare. Raises Refused.

        The device keeps them by itself: it refuses segments outside, and vents when a measured value leaves them, when
        it has been away from rest for longer than the dwell, or when its queue is empty while it is away from rest.
        """

    @abc.abstractmethod
    def enqueue(self, segments: Sequence[Segment]) -> None:
        """Append to the device's queue. Raises Refused when it would overflow or leave the limits."""

    @abc.abstractmethod
    def start(self) -> None:
        """Begin (or resume) to execute the queue."""

    @abc.abstractmethod
    def hold(self) -> None:
        """Pause: vent (or return to the centre) and wait; the queue is forgotten, the engine feeds it again."""

    @abc.abstractmethod
    def skip(self) -> None:
        """End the running segment now, at the value reached; go on with the next (an ``until`` was met)."""

    @abc.abstractmethod
    def beat(self) -> None:
        """Heartbeat. The device makes itself safe when beats stop for its watchdog time (wall time).

        Beats are counted: one that is repeated or late on the way is none.
        """


@dataclass(frozen=True)
class Rig:
    """An instrument ready to run: its driven device and the further sources (a camera) recorded with it."""

    instrument: str
    device: Device
    sources: tuple[Source, ...] = ()
