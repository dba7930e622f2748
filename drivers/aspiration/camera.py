"""Cameras as sources: the framed link of simulated cameras, and UVC cameras through OpenCV."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from drivers.aspiration import framelink
from drivers.aspiration.framelink import FrameDecoder, Picture
from drivers.claims import Claim
from drivers.device import Identity, LinkLost, ProtocolFault, Source
from drivers.signals import Block, Channel, Frame, Region
from drivers.transports import Transport, open_transport

if TYPE_CHECKING:
    from drivers.aspiration.contour import Settings
    from drivers.contour import Contour


class Measure(Protocol):
    """From an image to the apex height in m, not a number where no contour is found (see `live.LiveApex`)."""

    def __call__(self, image: NDArray[np.uint8], /) -> float:
        """Measure one frame."""

    @property
    def latest(self) -> Contour | None:
        """The contour of the frame that was measured last."""

    @property
    def settings(self) -> Settings:
        """How frames are read, with the grey-value threshold in use."""

    @property
    def proposes(self) -> bool:
        """Whether that threshold is proposed, not set."""

    @property
    def looked(self) -> bool:
        """Whether a frame was read with the latest settings."""

    def region(self, highest: float) -> Region | None:
        """Where in a frame the edge can be while the apex is at most ``highest`` m above the rim; None: anywhere."""

    def use(self, gvt: float | None) -> None:
        """Another threshold from the next frame on; None for a proposed one. From any thread."""

    def rest(self) -> None:
        """The next frame shows the tissue at rest. From any thread."""

    def reset(self) -> None:
        """Begin anew: light, threshold and rest are those of the next frame."""


_REPLY_TIMEOUT = 2.0
#: Wall time in s for which the rest of a frame is awaited once it has begun.
_WITHIN_FRAME = 0.005


class Camera(Source):
    """A source of frames and, with ``measure``, of the apex height measured in each.

    A frame carries the contour that its height was read from: the window shows the recorded one.
    """

    def __init__(self, name: str, channels: tuple[Channel, ...], measure: Measure | None) -> None:
        self.name = name
        self._channels = channels if measure else ()
        self.measure = measure

    @property
    def channels(self) -> tuple[Channel, ...]:
        return self._channels

    def make_safe(self) -> None:
        """A camera drives nothing."""

    def _rest(self) -> None:
        if self.measure is not None:
            self.measure.reset()

    def _deliver(self, frames: list[Frame]) -> Sequence[Block | Frame]:
        if not frames or self.measure is None:
            return frames
        heights, read = [], []
        for frame in frames:
            heights.append(self.measure(frame.image))
            read.append(replace(frame, contour=self.measure.latest))
        block = Block(
            values={self._channels[0].name: np.array(heights)},
            seq=np.array([frame.seq for frame in frames]),
            time=np.array([frame.time for frame in frames]),
            time_host=np.array([frame.time_host for frame in frames]),
        )
        return [*read, block]


class FramedCamera(Camera):
    """A camera that sends raw frames over a byte link (see `framelink`)."""

    def __init__(self, name: str, address: str, channels: tuple[Channel, ...], measure: Measure | None) -> None:
        super().__init__(name, channels, measure)
        self._address = address
        self._link: Transport | None = None
        self._decoder = FrameDecoder()

    @property
    def discarded(self) -> int:
        return self._decoder.tally.discarded

    def connect(self) -> Identity:
        self.close()
        self._link = open_transport(self._address)
        self._decoder = FrameDecoder()
        self._link.write(framelink.STREAM_OFF + framelink.IDENTIFY)
        deadline = time.monotonic() + _REPLY_TIMEOUT
        while (left := deadline - time.monotonic()) > 0:
            for message in self._decoder.feed(self._link.read(left)):
                if isinstance(message, Identity):
                    return message
        fault = self._decoder.tally.last_fault
        if fault:
            raise ProtocolFault(f"{self.name} on {self._address}: no valid answer ({fault})")
        raise LinkLost(f"{self.name} on {self._address}: no answer within {_REPLY_TIMEOUT:g} s")

    def start_stream(self) -> None:
        self._rest()
        self._need_link().write(framelink.STREAM_ON)

    def read(self, timeout: float) -> Sequence[Block | Frame]:
        link = self._need_link()
        arrived = self._decoder.feed(link.read(timeout))
        while not arrived and self._decoder.incomplete and (more := link.read(_WITHIN_FRAME)):
            arrived += self._decoder.feed(more)
        now = time.monotonic()
        return self._deliver([Frame(p.image, p.seq, p.time, now) for p in arrived if isinstance(p, Picture)])

    def close(self) -> None:
        if self._link is not None:
            self._link.close()
            self._link = None

    def _need_link(self) -> Transport:
        if self._link is None:
            raise LinkLost(f"{self.name}: not connected")
        return self._link


class UvcCamera(Camera):
    """A USB video class camera through OpenCV, ``uvc:INDEX``. Never run on real hardware.

    OpenCV tells neither a frame's own time nor its number: both are taken at arrival, so that a frame lost before does
    not show. A camera with hardware time stamps should get a source of its own.
    """

    def __init__(self, name: str, address: str, channels: tuple[Channel, ...], measure: Measure | None) -> None:
        super().__init__(name, channels, measure)
        self._address = address
        try:
            self._index = int(address.removeprefix("uvc:"))
        except ValueError:
            raise ValueError(f"{address!r} is not a camera; write uvc:0 for the first one") from None
        self._capture: Any = None
        self._claim: Claim | None = None
        self._seq = 0
        self._started = 0.0

    def connect(self) -> Identity:
        import cv2

        self.close()
        self._claim = Claim(self._address)
        self._capture = cv2.VideoCapture(self._index)
        if not self._capture.isOpened():
            self.close()
            raise LinkLost(f"{self.name}: OpenCV cannot open {self._address}")
        return Identity("UVC camera", str(self._index), f"OpenCV {cv2.__version__}")

    def start_stream(self) -> None:
        self._rest()
        self._seq = 0
        self._started = time.monotonic()

    def read(self, timeout: float) -> Sequence[Block | Frame]:
        """One frame. OpenCV blocks until the camera has it and knows no time-out."""
        import cv2

        if self._capture is None:
            raise LinkLost(f"{self.name}: not connected")
        arrived, image = self._capture.read()
        now = time.monotonic()
        if not arrived:
            raise LinkLost(f"{self.name} on {self._address}: the camera delivers no more frames")
        grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        frame = Frame(np.asarray(grey, np.uint8), self._seq, now - self._started, now)
        self._seq += 1
        return self._deliver([frame])

    def close(self) -> None:
        if self._capture is not None:
            self._capture.release()
            self._capture = None
        if self._claim is not None:
            self._claim.release()
            self._claim = None
