"""A link with its queue of bytes to send: the control port in an instrument's dialect, the camera port with frames."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from drivers import messages as msg
from drivers.aspiration import framelink
from drivers.aspiration.framelink import Picture
from drivers.device import Identity, Status
from drivers.signals import FloatArray
from drivers.stream import Codec
from sim_devices.servers.faults import Faults
from sim_devices.servers.links import Link

#: From apex height in m and device time in s to an image (height, width).
Render = Callable[[float, float], NDArray[np.uint8]]


#: First frames of a stream, in which the tissue is at rest: from them the initial height is taken.
UNLOADED_FRAMES = 3


class Port:
    """Sends queued bytes as the link takes them; bytes for nobody are dropped."""

    #: Bytes that may wait before the instrument's time stands still.
    depth: int

    def __init__(self, link: Link, faults: Faults) -> None:
        self.link = link
        self.streaming = False
        self.faults = faults
        self._waiting: deque[memoryview] = deque()
        self._half = False  # whether a part of the first one is sent
        self.backlog = 0
        self._progress = 0.0

    def flush(self, wall: float) -> None:
        """Send as much as the link takes at ``wall`` (monotonic s)."""
        if self.faults.stalled(wall):
            self._progress = wall
            return
        if not self.backlog:
            self._progress = wall
        while self._waiting:
            part = self._waiting[0]
            if self.faults.short:
                part = part[: self.faults.short]
            sent = self.link.send(part)
            if not sent:
                return
            self._progress = wall
            self.backlog -= sent
            if sent < len(self._waiting[0]):
                self._waiting[0], self._half = self._waiting[0][sent:], True
            else:
                self._waiting.popleft()
                self._half = False
            if self.faults.short:
                return

    def silent(self, wall: float) -> float:
        """For how long (wall s) the host has taken nothing of the queue."""
        return wall - self._progress if self.backlog else 0.0

    def drop(self) -> None:
        """Forget the queue, save the rest of a half-sent message: a host that comes back finds a whole stream."""
        half = [self._waiting[0]] if self._half else []
        self._waiting = deque(half)
        self.backlog = sum(map(len, half))

    def reset(self) -> None:
        """Forget host, stream and queue."""
        self.streaming = False
        self._waiting.clear()
        self._half = False
        self.backlog = 0

    def _receive(self) -> bytes:
        data = self.link.receive()
        if self.link.fresh:
            self.link.fresh = False
            self.reset()
        elif not self.link.connected and (self.streaming or self.backlog):
            self.reset()
        return data

    def _queue(self, data: bytes) -> None:
        if self.link.connected:
            data = self.faults.transmit(data)
            if data:
                self._waiting.append(memoryview(data))
                self.backlog += len(data)


class ControlPort(Port):
    """Requests in, replies and samples out."""

    depth = 16384

    def __init__(self, link: Link, codec: Callable[[], Codec], channels: int, faults: Faults) -> None:
        super().__init__(link, faults)
        self._new_codec = codec
        self._codec = codec()
        self._last_reply: msg.Reply | None = None
        self._packets = 0
        self._none = np.empty((0, channels))

    def receive(self) -> list[msg.Message]:
        """The messages that arrived."""
        data = self._receive()
        return self._codec.decode(data) if data else []

    def answered(self, number: int) -> msg.Reply | None:
        """The reply to the last request, if it had this number: the host asks again because it did not hear it."""
        return self._last_reply if self._last_reply and self._last_reply.number == number else None

    def outdated(self, request: msg.Request) -> bool:
        """Whether a request is an old one that comes again, or late: it must not be obeyed now.

        Whoever asks who is there begins anew, and with new numbers.
        """
        if self._last_reply is None or isinstance(request.body, msg.Identify):
            return False
        return 0 < (self._last_reply.number - request.number) % msg.LAST_NUMBER < msg.LAST_NUMBER // 2

    def reply(self, reply: msg.Reply) -> None:
        """Answer, and remember the answer."""
        self._last_reply = reply
        self._queue(self._codec.encode(reply))

    def announce(self, identity: Identity) -> None:
        """After a boot: say who is there, unasked."""
        self._queue(self._codec.encode(msg.Reply(0, identity=identity)))

    def status(self, status: Status) -> None:
        """Send a status without samples."""
        self._send(0, self._none[:, 0], self._none, status)

    def samples(self, first: int, time: FloatArray, values: FloatArray, status: Status) -> None:
        """Send a block, if the host asked for the stream."""
        if self.streaming:
            self._send(first, time, values, status)

    def _send(self, first: int, time: FloatArray, values: FloatArray, status: Status) -> None:
        self._packets += 1
        samples = msg.Samples(first, time, values, status, self._packets)
        self._queue(self.faults.packet(self._codec.encode(samples)))

    def reset(self) -> None:
        super().reset()
        self._codec = self._new_codec()
        self._last_reply = None


class CameraPort(Port):
    """Frames out, a few plain commands in."""

    depth = 2**21

    def __init__(self, link: Link, identity: Identity, render: Render) -> None:
        super().__init__(link, Faults())
        self._identity = identity
        self._render = render
        self._heard = b""
        self._unloaded = 0  # frames still to come in which the tissue is at rest

    def prepare(self) -> None:
        """Render one image for nobody, so that the first frame does not wait for the compiler."""
        self._render(0.0, 0.0)

    def receive(self) -> None:
        """Obey new commands."""
        *lines, self._heard = (self._heard + self._receive()).split(b"\r")
        for line in lines:
            match line + b"\r":
                case framelink.STREAM_ON:
                    self.streaming = True
                    self._unloaded = UNLOADED_FRAMES
                case framelink.STREAM_OFF:
                    self.streaming = False
                case framelink.IDENTIFY:
                    self._queue(framelink.encode(self._identity))

    def frames(self, first: int, time: FloatArray, heights: FloatArray) -> None:
        """Render and send one frame a sample, if the host asked for them; none where the height is not a number."""
        if not self.streaming:
            return
        for k in np.flatnonzero(np.isfinite(heights)).tolist():
            moment, height = float(time[k]), 0.0 if self._unloaded else float(heights[k])
            self._unloaded = max(0, self._unloaded - 1)
            self._queue(self.faults.packet(framelink.encode(Picture(self._render(height, moment), first + k, moment))))

    def reset(self) -> None:
        super().reset()
        self._heard = b""
