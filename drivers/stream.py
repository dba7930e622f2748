"""The device that all three instruments are: requests, a sample stream and a segment queue over one link.

An instrument adds its codec, its channels and the conversion from raw values to channels.
"""

from __future__ import annotations

import abc
import time
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from drivers import messages as msg
from drivers.device import Device, Identity, LinkLost, ProtocolFault, Refused, Status
from drivers.instrument import NotAllowed
from drivers.signals import Block, Channel, FloatArray, Frame
from drivers.transports import Transport
from protocols.limits import Range
from protocols.setpoints import Segment

#: A request unanswered for this long (wall time, s) is sent again, this many times in all.
REPLY_TIMEOUT = 0.15
ATTEMPTS = 8
#: Within this wall time in s the samples for the tare must have come.
FIRST_TIMEOUT = 3.0
#: Bytes without one valid message after which the other end is not speaking our dialect.
MOST_GARBAGE = 65536


class Codec(abc.ABC):
    """One end of a link in one dialect: messages to bytes, bytes to messages, no I/O.

    `decode` keeps an incomplete rest, drops unreadable bytes and is in step again at the next message.
    """

    def __init__(self) -> None:
        self.tally = msg.Tally()

    @abc.abstractmethod
    def encode(self, message: msg.Message) -> bytes:
        """The bytes of one message. Raises ValueError for a value that the dialect cannot carry."""

    @abc.abstractmethod
    def decode(self, data: bytes) -> list[msg.Message]:
        """The messages completed by ``data``."""


class StreamDevice(Device):
    """A `Device` over any codec and transport. Single-threaded: the thread that owns the link calls it.

    ``raw`` are the channels on the wire; ``convert`` maps raw values (n, raw channels) to every channel's (n,) values;
    ``zero`` is called with the first so many raw samples when the stream begins. A ``simulated`` one must say that it
    is when asked who it is.
    """

    def __init__(
        self,
        name: str,
        *,
        open_link: Callable[[], Transport],
        codec: Callable[[], Codec],
        channels: tuple[Channel, ...],
        quantities: tuple[str, ...],
        capacity: int,
        watchdog: float,
        convert: Callable[[FloatArray], Mapping[str, FloatArray]],
        zero: tuple[Callable[[FloatArray], None], int] | None = None,
        simulated: bool = False,
    ) -> None:
        self.name = name
        self._open_link = open_link
        self._new_codec = codec
        self._channels = channels
        self._quantities = quantities
        self._capacity = capacity
        self._watchdog = watchdog
        self._convert = convert
        self._zero = zero
        self._simulated = simulated
        self._link: Transport | None = None
        self._codec = codec()
        self._number = 0
        self._pending: list[tuple[msg.Samples, float]] = []
        self._status = Status(0.0, "idle", 0, 0)
        self._garbage = 0
        self._beats = 0
        self._packet = -1  # number of the newest packet with a status

    @property
    def channels(self) -> tuple[Channel, ...]:
        return self._channels

    @property
    def quantities(self) -> tuple[str, ...]:
        return self._quantities

    @property
    def status(self) -> Status:
        return self._status

    @property
    def queue_capacity(self) -> int:
        return self._capacity

    @property
    def discarded(self) -> int:
        return self._codec.tally.discarded

    def connect(self) -> Identity:
        self.close()
        self._link = self._open_link()
        self._codec = self._new_codec()
        self._pending.clear()
        self._garbage, self._packet = 0, -1
        self._status = Status(0.0, "idle", 0, 0)
        identity = self._request(msg.Identify()).identity
        if identity is None:
            raise ProtocolFault(f"{self.name} on {self._link.address}: the answer to 'identify' names nobody")
        if self._simulated and "simulat" not in identity.model.lower():
            raise NotAllowed(
                f"{self.name} on {self._link.address}: {identity.model!r} answers, which does not call itself a "
                "simulator, and the station says 'simulated: true'"
            )
        # An earlier host may have left the stream on; its bytes on the wire are not this run's data.
        self._request(msg.Stream(False))
        self._pending.clear()
        return identity

    def start_stream(self) -> None:
        self._request(msg.Stream(True))
        if self._zero is not None:
            tare, count = self._zero
            tare(self._first(count))

    def arm(self, limits: Mapping[str, Range]) -> None:
        missing = [q for q in self._quantities if not limits.get(q, Range()).bounded]
        if missing:
            raise Refused(f"{self.name}: no finite limits for {', '.join(missing)}; without limits nothing is armed")
        self._request(msg.Arm(dict(limits), self._watchdog, self._beats))

    def enqueue(self, segments: Sequence[Segment]) -> None:
        if not segments:
            return
        pieces = []
        for segment in segments:
            absent = [q for q in self._quantities if q not in segment.start or q not in segment.end]
            if absent or len(segment.start) != len(self._quantities):
                raise Refused(
                    f"{self.name} is commanded by {', '.join(self._quantities)}, "
                    f"not by {', '.join(segment.start)} (step {segment.step or '?'})"
                )
            pieces.append(
                msg.Piece(
                    float(segment.duration),
                    tuple(float(segment.start[q]) for q in self._quantities),
                    tuple(float(segment.end[q]) for q in self._quantities),
                )
            )
        self._request(msg.Enqueue(tuple(pieces)))

    def start(self) -> None:
        self._request(msg.Start())

    def hold(self) -> None:
        self._request(msg.Hold())

    def skip(self) -> None:
        self._request(msg.Skip(self._status.executed))

    def make_safe(self) -> None:
        """As `Source.make_safe`. Raises LinkLost when the device did not confirm: then its own watchdog vents it."""
        if self._link is not None:
            self._request(msg.Safe())

    def beat(self) -> None:
        self._beats += 1
        self._need_link().write(self._codec.encode(msg.Beat(self._beats)))

    def read(self, timeout: float) -> Sequence[Block | Frame]:
        if not self._pending:
            self._receive(timeout)
        arrived, self._pending = self._pending, []
        return [self._block(arrived)] if arrived else []

    def close(self) -> None:
        if self._link is not None:
            self._link.close()
            self._link = None
        self._pending.clear()

    def _need_link(self) -> Transport:
        if self._link is None:
            raise LinkLost(f"{self.name}: not connected")
        return self._link

    def _request(self, body: msg.Body) -> msg.Reply:
        """Ask until answered. Raises Refused with the device's reason, LinkLost when nobody answers."""
        link = self._need_link()
        self._number = self._number % msg.LAST_NUMBER + 1
        data = self._codec.encode(msg.Request(self._number, body))
        for _ in range(ATTEMPTS):
            link.write(data)
            deadline = time.monotonic() + REPLY_TIMEOUT
            while (left := deadline - time.monotonic()) > 0:
                for reply in self._receive(left):
                    if reply.number != self._number:
                        continue
                    if reply.refused:
                        raise Refused(f"{self.name} refused {type(body).__name__.lower()}: {reply.refused}")
                    return reply
        raise LinkLost(
            f"{self.name} on {link.address}: no answer to {type(body).__name__.lower()} "
            f"within {ATTEMPTS * REPLY_TIMEOUT:.1f} s ({self._codec.tally.last_fault or 'silence'})"
        )

    def _receive(self, timeout: float) -> list[msg.Reply]:
        """Read once; keep samples and status, return replies."""
        link = self._need_link()
        data = link.read(timeout)
        if not data:
            return []
        replies = []
        now = time.monotonic()
        heard = self._codec.decode(data)
        self._garbage = 0 if heard else self._garbage + len(data)
        if self._garbage > MOST_GARBAGE:
            raise ProtocolFault(
                f"{self.name} on {link.address}: {self._garbage} bytes without one valid message "
                f"({self._codec.tally.last_fault})"
            )
        for message in heard:
            if isinstance(message, msg.Samples):
                if message.packet >= self._packet:  # an older one came late, or again
                    self._packet, self._status = message.packet, message.status
                if len(message.time):
                    self._pending.append((message, now))
            elif isinstance(message, msg.Reply):
                if message.number == 0:
                    raise LinkLost(f"{self.name} on {link.address}: the device restarted by itself")
                replies.append(message)
        return replies

    def _first(self, count: int) -> FloatArray:
        """The first ``count`` raw samples of the stream, still to be read. Raises LinkLost when they do not come."""
        deadline = time.monotonic() + FIRST_TIMEOUT
        while sum(len(samples.time) for samples, _ in self._pending) < count:
            if time.monotonic() > deadline:
                raise LinkLost(f"{self.name}: the stream was switched on, but no {count} samples came")
            self._receive(0.05)
        return np.concatenate([samples.values for samples, _ in self._pending])[:count]

    def _block(self, arrived: list[tuple[msg.Samples, float]]) -> Block:
        counts = [len(samples.time) for samples, _ in arrived]
        return Block(
            values=self._convert(np.concatenate([samples.values for samples, _ in arrived])),
            seq=np.concatenate([np.arange(s.first, s.first + n) for (s, _), n in zip(arrived, counts, strict=True)]),
            time=np.concatenate([samples.time for samples, _ in arrived]),
            time_host=np.repeat([host for _, host in arrived], counts),
        )
